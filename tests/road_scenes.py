"""Scenes on a straight road that the tests of the ADSs, the drivers and the loop share."""

import itertools
import math
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sumo_eval.cosim import Briefing, simulate, simulate_many
from sumo_eval.cosim.doors.traci_program import sumo_binary
from sumo_eval.cosim.vehicle_model import LIMITED, EgoState, move
from sumo_eval.errors import InputError
from sumo_eval.method.collision_avoidance import impact_severity
from sumo_eval.method.criticality import max_inverse_ttc
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start, catalogue
from sumo_eval.scenario.file import scenario_from
from sumo_eval.scenario.sampling.grid import full_grid
from sumo_eval.scenario.sampling.request import Request
from sumo_eval.scenario.sampling.samples import central_point, sample
from sumo_eval.settings import ConditionSettings, SimulationSettings, VehicleSettings

ROAD = Road(name="test_road", length=600.0, lanes=2, lane_width=3.5, run_out=5400.0)
DECIDED = SimulationSettings(end_when_decided=True)
HALF_SECOND = SimulationSettings(time_limit=0.5)
BRIEFING = Briefing("test", ROAD, VehicleSettings(), 0.05)


def advance(state, command, limits, step):
    """The state one `step` (s) later and every limit that the command ran into; see `move`."""
    clips = [SimpleNamespace(count=0, first=0.0, requested=0.0, applied=0.0) for _ in LIMITED]
    x, y, heading, speed, acceleration, wheel = state
    ego = SimpleNamespace(
        x=x, y=y, heading=heading, speed=speed, acceleration=acceleration, steering=wheel, time=0.0
    )
    move(ego, ego, command.acceleration, command.steering, limits, step, clips)
    met = zip(LIMITED, clips, strict=True)
    after = EgoState(ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, ego.steering)
    return after, tuple((what, clip.requested, clip.applied) for what, clip in met if clip.count)


class Mover(SimpleNamespace):
    """A vehicle as a rule sees it, outside of any loop: the fields of a `MOVER` record, and a
    name."""

    @property
    def speed(self):
        """Along the heading, m/s."""
        return math.hypot(self.along, self.across)

    def _replace(self, **changes):
        return Mover(**{**vars(self), **changes})


def mover(name, x, y=0.0, along=20.0, across=0.0):
    """A vehicle of 4.5 m x 1.8 m, straight along the road."""
    size = {"half_length": 2.25, "half_width": 0.9}
    motion = {"heading": 0.0, "along": along, "across": across, "braking": 0.0, "curvature": 0.0}
    return Mover(name=name, x=x, y=y, **motion, **size)


def fresh(layout):
    """A record as a rule finds it at the start: nothing is known (nan), nothing has happened
    (0)."""
    dtype = np.dtype(layout)
    if dtype.names is None:
        return math.nan if dtype == np.float64 else 0
    return SimpleNamespace(**{name: fresh(dtype[name]) for name in dtype.names})


def case(*actors, speed=20.0, x=50.0, y=0.0, road=ROAD, **values):
    """The ego at x m and `speed` m/s, and the given others."""
    return ConcreteScenario("test", values, 1.0, road, Start(x, y, speed), actors)


def actor(name, gap, speed=0.0, y=0.0, *acts, x=50.0, **body):
    """A vehicle `gap` m (bumper to bumper) ahead of an ego at x."""
    return Actor(name, Start(x + 4.5 + gap, y, speed), acts, **body)


lead = partial(actor, "lead")


def points(name, every):
    logical = catalogue.load(name)
    return list(logical.concretes(sample(logical).points[::every]))


def under(**conditions):
    """Half a second under conditions."""
    return replace(HALF_SECOND, conditions=ConditionSettings(**conditions))


def once(action, moment=0.3):
    """An ADS that does something at a moment, s, and otherwise nothing."""
    return lambda traci, ego, time: action(traci) if abs(time - moment) < 1e-9 else None


class Watches:
    """A policy over arrays that keeps its speed and keeps what `look` says of each step."""

    batch = True

    def __init__(self, look):
        self.look, self.shown = look, []

    def act(self, seen):
        self.shown.append(self.look(seen))
        return np.zeros(len(seen.number))


def clips_of(recording):
    return {clip.what: clip for clip in recording.clips}


def need_sumo():
    """Skip the test or the file where SUMO's program is not installed."""
    try:
        sumo_binary()
    except InputError as error:
        pytest.skip(str(error), allow_module_level=True)


def assert_as_alone(cases, together, ads, *settings):
    """Cases of one batch were driven as each is alone."""
    for concrete, found in zip(cases, together, strict=True):
        assert found.same_drive(simulate(concrete, ads, *settings)), concrete


def half_second(ads, *actors, **options):
    """Half a second of an ADS at 20 m/s on the road with these actors."""
    return simulate(case(*actors), ads, HALF_SECOND, **options)


def assert_ended(found, reason="time_limit", words=None):
    """The drive ended for this reason: with these words in its error, or without an error."""
    assert found.end_reason == reason, found.error
    assert found.error is None if words is None else words in found.error, found.error


def assert_last(found, within=None, **channels):
    """The ego's channels have these values at its last sample, to `within` or to 1e-6 of them."""
    for name, value in channels.items():
        assert getattr(found.ego, name)[-1] == pytest.approx(value, abs=within), name


def clear_drive(concrete, ads, *settings, **options):
    """The recording of a drive, which must end without an error and without a collision."""
    found = simulate(concrete, ads, *settings, **options)
    assert found.error is None, (concrete.label, found.error, found.log)
    assert found.collision is None, concrete.label
    return found


def table(keys):
    """A vehicle, a move or a road by its keys in a scenario file."""
    return tomllib.loads(f"it = {{{keys}}}")["it"]


def scenario_of(content):
    """The scenario of a file with this content, or text."""
    content = tomllib.loads(content) if isinstance(content, str) else content
    return scenario_from(content, "t", Path())


def at_point(name, *values):
    """A shipped scenario with values in the order of its parameters."""
    return catalogue.load(name).concretes([values])[0]


def at_values(name, **values):
    """A shipped scenario at the point of these values."""
    return catalogue.load(name).concrete(**values)


def central_case(name):
    """A shipped scenario at its central point."""
    logical = catalogue.load(name)
    return logical.concretes(central_point(logical)[None])[0]


def drawn_points(logical, count, seed):
    """Possible points of a space, drawn at random."""
    shares = np.random.default_rng(seed).random((8 * count, len(logical.names)))
    points = logical.from_shares(shares)
    return points[logical.feasible(points)][:count]


def drawn_cases(name, count, seed):
    """Concrete scenarios at possible points of a shipped scenario, drawn at random."""
    logical = catalogue.load(name)
    return list(logical.concretes(drawn_points(logical, count, seed)))


def grid(logical):
    """The feasible points of a space at its own steps."""
    axes = [np.arange(p.low, p.high + 1e-9, p.step) for p in logical.parameters]
    points = np.array(list(itertools.product(*axes)))
    return points[logical.feasible(points)]


def every_point(logical, **request):
    """Every point of the grid, possible or not; `request` as in `Request`."""
    return full_grid(logical, Request(**request)).points


def peak_inverse_ttc(logical, points):
    """Max ITTC of the points at 5 m/s2, 1/s, in closed form: below 0.7 lies the exact safe zone."""
    approach = logical.approach(logical.columns(points))
    return max_inverse_ttc(
        approach.ego_speed,
        approach.obstacle_speed,
        approach.gap,
        deceleration=5.0,
        delay=approach.delay,
    )


def low_speed():
    """All feasible points of front_vehicle_low_speed."""
    logical = catalogue.load("front_vehicle_low_speed")
    return list(logical.concretes(grid(logical)))


def safe_cut_outs(every):
    """Every so-manyth safe point of front_vehicle_cut_out."""
    logical = catalogue.load("front_vehicle_cut_out")
    points = grid(logical)
    return list(logical.concretes(points[peak_inverse_ttc(logical, points) < 0.7][::every]))


def cut_outs_at_the_edge(count, seed):
    """Safe points of front_vehicle_cut_out that would be hazardous with a gap 5 % smaller."""
    logical = catalogue.load("front_vehicle_cut_out")
    rng = np.random.default_rng(seed)
    points = logical.from_unit(rng.random((40_000, len(logical.parameters))))
    # slower obstacles take minutes to follow
    points = points[logical.feasible(points) & (points[:, 1] > 4.0)]
    safe = peak_inverse_ttc(logical, points) < 0.7
    hazardous_if_nearer = peak_inverse_ttc(logical, points * np.array([1.0, 1.0, 0.95])) >= 0.7
    return list(logical.concretes(points[safe & hazardous_if_nearer][:count]))


def severity(recording):
    """U, 0 without contact, m/s."""
    hit = recording.collision
    return (
        0.0
        if hit is None
        else float(impact_severity(hit.ego_velocity, hit.other_velocity, hit.overlap))
    )


def severities(cases, ads, settings=DECIDED):
    return np.array([severity(recording) for recording in simulate_many(cases, ads, settings)])
