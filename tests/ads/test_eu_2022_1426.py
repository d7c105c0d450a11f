"""Reference drivers of Regulation (EU) 2022/1426: the twelve values of its table through SUMO."""

import pytest
from road_scenes import clear_drive

from sumo_eval.ads.eu_2022_1426 import SEATED, STANDING
from sumo_eval.ads.reg157 import avoidable_ttc
from sumo_eval.cosim import simulate
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start, constant_lateral

ROAD = Road("eu_2022_1426_2x3.5m", 2000.0, 2, 3.5, 200.0)
TABLE = [(SEATED, ttc, 10.0 * k) for k, ttc in enumerate((0.48, 0.71, 0.94, 1.18, 1.41, 1.64), 1)]
TABLE += [
    (STANDING, ttc, 10.0 * k) for k, ttc in enumerate((0.74, 1.32, 1.90, 2.47, 3.05, 3.63), 1)
]


def cut_in(closing, ttc):
    """Somebody who crosses at 1 m/s, closing m/s slower, with that TTC when 0.30 m over the line.

    Bodies are 1.8 m wide, lanes 3.5 m: the side is 0.30 m over the line when the centre has moved
    3.5 - 2.35 = 1.15 m."""
    speed = 60.0 / 3.6 + 10.0
    start = Start(100.0 + 4.5 + closing * (ttc + 1.15), 3.5, speed - closing)
    other = Actor("other", start, (constant_lateral(0.0, 1.0, -3.5),), slides=True)
    return ConcreteScenario(
        "eu_2022_1426", {"closing": closing}, 1.0, ROAD, Start(100.0, 0.0, speed), (other,)
    )


@pytest.mark.parametrize("granted, ttc, kph", TABLE)
def test_a_cut_in_above_the_value_of_the_table_is_avoided_by_the_margin_that_physics_gives(
    granted, ttc, kph
):
    """It begins where v TTC = v (tau/2 + 0.1) + v^2 / 2a + 0.1 m are left, 0.1 m being what it
    takes off every gap.

    In 0.1 s and while braking builds up over tau it loses v (0.1 + tau) - a tau^2 / 6, and the rest
    of the speed
    v - a tau / 2 takes (v - a tau / 2)^2 / 2a: together a tau^2 / 24 less than is left.
    """
    recording = clear_drive(cut_in(kph / 3.6, ttc + 0.05), granted.ads)
    other = recording.actors["other"]
    least = min(x2 - x - 4.5 for x, x2 in zip(recording.ego.x, other.x, strict=True))
    assert least == pytest.approx(0.1 + granted.braking * granted.build_up**2 / 24.0, abs=0.01)


@pytest.mark.parametrize("granted", [SEATED, STANDING])
def test_a_cut_in_far_below_the_value_is_not_avoided(granted):
    """Otherwise the test above would say nothing of the driver."""
    assert (
        simulate(
            cut_in(30.0 / 3.6, avoidable_ttc(30.0 / 3.6, granted) - 0.25), granted.ads
        ).collision
        is not None
    )
