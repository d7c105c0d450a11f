"""Fields by boxes are the plain sum, wherever the samples are; and the plain sum where boxes would
not do."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from road_scenes import at_point

from sumo_eval import Trajectory
from sumo_eval.cosim import simulate
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.method import shared_fields as module
from sumo_eval.method.compared_drives import lateral_position, slice_points, slice_positions
from sumo_eval.method.shared_fields import SharedFields, Stretch
from sumo_eval.method.trajectory_field import trajectory_fields
from sumo_eval.settings import FieldSettings

PLAIN = FieldSettings()
ERROR = 1e-11  # relative, what the module promises
X = np.linspace(50.0, 600.0, 551)
Y = np.broadcast_to(np.linspace(-1.75, 5.25, 8), (551, 8))


def plain(x, y, drives, constants):
    points = np.column_stack((np.repeat(x, y.shape[1]), y.ravel()))
    return trajectory_fields(points, drives, constants).reshape(len(drives), *y.shape)


def standing(x, y, heading=0.0, speed=0.0):
    return Trajectory([0.0], [x], [y], heading=[heading], speed=[speed])


def around(x, y):
    """The stretch in which the points lie; of none, a short one."""
    return Stretch(x.min(), x.max(), y.min(), y.max()) if x.size else Stretch(0.0, 1.0, 0.0, 1.0)


def shared(x, y, drives, constants=PLAIN):
    return SharedFields(drives, around(x, y), constants, y.size)


def shared_fields(x, y, drives, constants):
    return shared(x, y, drives, constants).at(x, y, range(len(drives)))


def assert_plain(x, y, drives, constants, error=ERROR):
    found, expected = (of(x, y, drives, constants) for of in (shared_fields, plain))
    np.testing.assert_allclose(found, expected, rtol=error)


def by_boxes(x, y):
    return module._pays(y.size, around(x, y)) and around(x, y).levels > 2


# --- the clever against the plain -----------------------------------------------------------------


@given(
    x=st.floats(-300.0, 900.0) | st.just(1e5),
    y=st.floats(-30.0, 30.0),
    heading=st.floats(-3.2, 3.2),
    speed=st.floats(0.0, 70.0),
    k1=st.sampled_from([0.0, 0.3, 0.5, 0.7, 1.0]),
)
def test_one_sample_alone_is_within_the_bound_at_every_point(x, y, heading, speed, k1):
    # A single sample is the hardest: in a sum the near ones, which are exact, outweigh those
    # interpolated.
    constants, sample = FieldSettings(k1=k1), [standing(x, y, heading, speed)]
    assert by_boxes(X, Y)
    assert_plain(X, Y, sample, constants)


@pytest.mark.parametrize("k1", [0.0, 0.5, 1.0])
def test_samples_just_far_enough_from_the_shortest_boxes_are_within_the_bound(k1):
    # 32 boxes of 17.2 m, the strip as wide as they allow; one length away from a box is where
    # another one ends.
    length, random = 550.0 / 32, np.random.default_rng(3)
    half = length / (module.SLENDER + 0.01)
    y, constants = np.broadcast_to(np.linspace(-half, half, 9), (551, 9)), FieldSettings(k1=k1)
    assert around(X, y).levels == 5
    for _ in range(40):
        place = 50.0 + length * random.integers(-2, 34) + random.choice([-1e-6, 1e-6])
        across = random.choice([0.0, half, -1.5 * half])
        sample = [standing(place, across, random.uniform(-3.2, 3.2), 70.0)]
        assert_plain(X, y, sample, constants)


@pytest.fixture(scope="module")
def driven():
    """Three drivers of a cut-out in SUMO, and x and y of the points of their own slices, on many of
    which they are themselves."""
    concrete = at_point("front_vehicle_cut_out", 20.0, 5.0, 110.0)
    drives = [
        simulate(concrete, human_controller(index, 10, 1, concrete)).ego for index in range(3)
    ]
    sets = []
    for drive, spacing in zip(drives, (0.5, 0.5, 2.5), strict=True):
        slices = np.append(slice_positions(50.0, 550.0, spacing), drive.x[drive.x < 600.0])
        sets.append(slice_points(slices, lateral_position(drive, slices), concrete.road))
    points = np.concatenate(sets)
    return drives, points[:, 0, 0], points[..., 1]


@pytest.mark.parametrize("k1", [0.5, 0.75])
def test_real_drives_are_within_a_tenth_of_the_bound(driven, k1):
    drives, x, y = driven
    assert by_boxes(x, y)
    assert_plain(x, y, drives, FieldSettings(k1=k1), ERROR / 10)


def test_samples_and_points_on_a_line_are_within_the_bound():
    # No width at all: the strip is treated as if it had some.
    line, drives = np.zeros((551, 8)), [standing(321.0, 0.0, 0.0, 30.0), standing(10.0, 0.0)]
    assert_plain(X, line, drives, PLAIN)


@pytest.mark.parametrize("asked_before", [False, True])
def test_points_off_the_stretch_are_within_the_bound(driven, asked_before):
    drives, x, y = driven
    stretch = Stretch(80.0, 500.0, -1.76, 4.9)
    fields, inside = SharedFields(drives, stretch, PLAIN, y.size), stretch.holds(x, y)
    assert 0.3 < inside.mean() < 0.9
    if asked_before:
        fields.at(x[inside], y[inside], [0, 1, 2])
    np.testing.assert_allclose(
        fields.at(x, y, [0, 1, 2]), plain(x, y, drives, PLAIN), rtol=ERROR / 10
    )


def test_earlier_questions_change_no_bit(driven):
    drives, x, y = driven
    fields = shared(x, y, drives)
    fields.at(x[::2], y[::2], [2, 0])
    alone = shared(x, y, drives[1:])
    assert fields.at(x, y, [1, 2]).tobytes() == alone.at(x, y, [0, 1]).tobytes()


def test_company_changes_no_bit(driven):
    drives, x, y = driven
    plainly_summed = standing(200.0, 1.0, 0.1, 120.0)
    fields = shared(x, y, [*drives, plainly_summed])
    last = len(drives)
    both = fields.at(x, y, [last, 0])
    for number, place in enumerate((last, 0)):
        assert both[number].tobytes() == fields.at(x, y, [place])[0].tobytes()


def test_far_samples_are_summed_once(driven, monkeypatch):
    from sumo_eval.method import field_loops

    drives, x, y = driven
    fields = shared(x, y, drives)
    first = fields.at(x, y, [0, 1, 2])
    monkeypatch.setattr(field_loops, "far_values", None)
    assert fields.at(x, y, [0, 1, 2]).tobytes() == first.tobytes()
    few = fields.at(x[:9], y[:9], [2])  # too few to sum anything for, but it is there
    np.testing.assert_allclose(few, plain(x[:9], y[:9], drives[2:], PLAIN), rtol=ERROR / 10)


# --- where the plain sum is taken -----------------------------------------------------------------


@pytest.mark.parametrize(
    "constants",
    [
        FieldSettings(superposition="vector"),
        FieldSettings(k1=1.01),
        FieldSettings(k1=20.0),
        FieldSettings(k2=0.011),  # 0.55 at 50 m/s
        FieldSettings(k2=1.0),
    ],
)
def test_large_constants_and_vectors_are_summed_plainly(constants):
    drives = [standing(200.0, 1.0, 0.1, 50.0), standing(400.0, 1.0, 0.0, 50.0)]
    assert_plain(X, Y, drives, constants, 0.0)


def test_few_points_and_a_short_road_are_summed_plainly():
    drives = [standing(55.0, 1.0, 0.1, 50.0)]
    for x, y in (
        (X[::50], Y[::50]),
        (np.linspace(50.0, 55.0, 551), Y),
        (X[:1], Y[:1]),
        (X[:0], Y[:0]),
    ):
        assert not module._pays(y.size, around(x, y))
        assert_plain(x, y, drives, PLAIN, 0.0)


def test_no_trajectories_are_an_empty_answer():
    assert shared_fields(X, Y, [], PLAIN).shape == (0, 551, 8)
