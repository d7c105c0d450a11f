"""Skilled synthetic drivers as controllers; drives of ADSs are compared with theirs.

`human_controller` makes one for a case; the loop of `cosim` runs the kernels.

Users: `extras/bench/costs.py`, `record/loops.py`, `record/worker.py`.
"""

import math
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sumo_eval.ads.car_following import PARAMETERS
from sumo_eval.ads.lane_change import (
    path_at,
    rear_axle_next,
    smooth_step,
    smooth_step_at,
    steering,
)
from sumo_eval.ads.overtaking import HABITS, OVERTAKING, WATCHED, overtake
from sumo_eval.ads.perception import carry_on, is_visible, take
from sumo_eval.cosim.compiled import Compiled, unseen
from sumo_eval.cosim.records import MOVER
from sumo_eval.cosim.step_rules import first_of
from sumo_eval.drivers import CLOSING_SPEED
from sumo_eval.drivers.synthetic.population import AS_RECORDED, Driver, draw_driver
from sumo_eval.drivers.synthetic.wander import noise_at, random_waves
from sumo_eval.errors import must_be
from sumo_eval.kernels import Records, fields, flags, kernel, rows
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import PopulationSettings
from sumo_eval.settings.random_streams import random_stream

WANDER_DEVIATION = 0.25  # m, of one driver's wander in the lane (DLR Highway Traffic)
WANDER_CORRELATION_TIME = 2.2
"""The l of the wander's correlation exp(-t^2 / (2 l^2)), s.

It agrees within 0.04 with the correlation of 80 recorded cars after 1, 2, 3, 4 and 5 s. Its
integral from 0 on is 2.8 s.
"""
# m/s; slower vehicles wander by distance instead of time, so that they need no sharper curves
WANDER_PACE = 10.0
SETTLING_TIME = 5.0
"""Time in which a driver's own line, own speed and wander take over, s.

Before, every case begins in the middle of the lane at a given steady speed.
"""
# s, time constant in which the wander stops before the driver passes something, and starts again
FOCUS_TIME = 0.3

PEDAL_DEVIATION = 0.39
"""Deviation of the pedals' wander, m/s2.

The acceleration wanders less, because the driver holds the speed. With this value the acceleration
of drivers who overtake changes within 0.5, 1, 2, 3 and 4 s by 0.09, 0.18, 0.33, 0.44 and 0.51 m/s2
(root mean square): as in 64 recorded overtakers, within 3 % (DLR Highway Traffic).
"""
PEDAL_CORRELATION_TIME = 2.0  # s (DLR Highway Traffic: the correlation is 0.59 at 2 s, 0.28 at 3 s)
SPEED_RELAXATION = 8.0  # s, time constant in which a driver approaches the desired speed

# share of a vehicle's width that may be hidden: the rest, with one rear lamp, shows it
HIDING_SHARE = 0.7
# m/s2; weaker braking of a vehicle ahead is not noticed: engine braking lights no lamps
NOTICED_BRAKING = 0.5
CROSSING_SPEED = 0.3  # m/s across the road, above which a vehicle ahead begins to change lane

LOOK = np.dtype([*fields("time"), ("mover", MOVER)])
"""A look at a vehicle: when, s, and the vehicle then."""
LOOKS = [*fields("first_seen"), *flags("begun", "first", "count")]
"""Facts on the looks at a vehicle. The looks stand in an array of `LOOK`, a ring: number k at place
k % its size.

first_seen: time of the first look, s.
begun: 1 if there was one.
first: number of the look that the driver acts upon.
count: number of looks so far.
"""
ATTENTION = [*fields("delay"), *flags("attends")]
"""delay: present reaction time, s. attends: 1 once it is set."""


class Mind(NamedTuple):
    """Arrays of n drivers, each with m other vehicles; of one driver without the first axis.

    looks: the last k looks at each vehicle, `LOOK`, (n, m, k).
    memories: `LOOKS`, (n, m).
    known: vehicles as the driver assumes them, `MOVER`, (n, m); x is nan: not known.
    watched: memory of `overtake` for each vehicle, (n, m).
    waves: `random_waves` of the wander, then of the pedals, (n, 2, 8, 2).
    """

    looks: Any
    memories: Any
    known: Any
    watched: Any
    waves: Any


@kernel
def attend(attention: Any, me: Any, others: Any, mind: Any, p: Any, time: float) -> None:
    """Look at the true scene, and write `mind.known`, the vehicles as the driver assumes them.

    The driver knows each vehicle as it was one reaction time ago, extrapolated to now as it moved
    then. So a steady vehicle is perceived exactly, and a change (a new vehicle, braking, a lane
    change) one reaction time late: the human driver model's delay with anticipation (Treiber,
    Kesting, Helbing, Physica A 360, 71 (2006)). The reaction time becomes the alerted one when a
    vehicle appears, or when one in front moves across the road or is approached.

    attention: `ATTENTION`.
    me, others: the ego and the vehicles, as they truly are.
    p: parameters of the driver, `SyntheticDriver.numbers`.
    time: since the start, s.
    """
    looks, memories, known = mind.looks, mind.memories, mind.known
    if attention.attends == 0:
        attention.attends = 1
        attention.delay = p.reaction_time

    # look at the vehicles in sight
    for j in range(len(others)):
        if not is_visible(me, others, j, HIDING_SHARE):
            continue
        other, memory, ring = others[j], memories[j], looks[j]
        if memory.begun == 0:
            memory.begun = 1
            memory.first_seen = time
            if time > 0.0:
                attention.delay = p.alerted_reaction_time
        elif other.x > me.x and (
            abs(other.across) > CROSSING_SPEED or me.along - other.along > CLOSING_SPEED
        ):
            attention.delay = p.alerted_reaction_time
        braking = 0.0
        if memory.count > 0:
            last = ring[(memory.count - 1) % len(ring)]
            if last.mover.along > 0.0:  # an oncoming vehicle that speeds up does not brake
                braking = (last.mover.along - other.along) / (time - last.time)
        look = ring[memory.count % len(ring)]
        take(look.mover, other)  # copies `other` into the look
        look.time = time
        look.mover.braking = braking if braking > NOTICED_BRAKING else 0.0
        memory.count += 1

    # act upon the newest look that is at least a reaction time old; 1e-9 s against rounding
    past = time - attention.delay + 1e-9
    for j in range(len(others)):
        memory, ring = memories[j], looks[j]
        if memory.begun == 0 or memory.first_seen > past:
            known[j].x = math.nan
            continue
        while memory.count - memory.first > 1 and ring[(memory.first + 1) % len(ring)].time <= past:
            memory.first += 1
        look = ring[memory.first % len(ring)]
        take(known[j], look.mover)
        carry_on(known[j], time - look.time)


@kernel
def synthetic_driver(
    ego: Any, others: Any, memory: Any, mind: Any, scenario: Any, time: float
) -> tuple[float, float]:
    """A driver: acceleration, m/s2, and steering wheel angle, rad.

    ego, others: records of the vehicles.
    memory: a record of `SyntheticDriver.own_records`.
    mind: of this driver alone.
    time: since the start, s.
    """
    me, waves, p = ego.seen, mind.waves, memory.p
    if memory.began == 0:  # the first step; `overtake` below sets `began`
        memory.ease = 1.0
    attend(memory, me, others, mind, p, time)

    # `overtake` keeps the speed of the first step as the cruising speed
    first_speed = memory.cruising_speed if memory.began else me.speed
    desired = first_speed * p.gain
    pedal = noise_at(waves[1], PEDAL_DEVIATION, time)[0]
    free = (desired - me.speed) / SPEED_RELAXATION + pedal
    # `overtake` reads both: the speed to reach, m/s, and the acceleration on a free road, m/s2
    memory.desired_speed = desired
    memory.free = free * smooth_step(time / SETTLING_TIME)
    acceleration = overtake(memory, me, mind.known, mind.watched, p, ego.way, scenario)

    y, slope, curve = _line(memory, me, waves, p, scenario)
    wheel = steering(memory, me, y, slope, curve, scenario)
    return max(acceleration, -scenario.vehicle.max_deceleration), wheel


@kernel
def _line(memory: Any, me: Any, waves: Any, p: Any, scenario: Any) -> tuple[float, float, float]:
    """The line to drive, at the ego's rear axle: y, m; slope; second derivative, 1/m.

    It is the path, shifted by the driver's own place in the lane and by the wander. The wander runs
    on a clock of its own, `memory.clock`: it follows the distance at low speed, and stands while
    the driver steers closely past something (`memory.ease` near 0).
    """
    target = 0.0 if memory.passing else 1.0  # of `ease`
    memory.ease += (target - memory.ease) * min(scenario.step / FOCUS_TIME, 1.0)
    # m of road a second of the clock; 1e-3: with `ease` 0 it nearly stops
    pace = max(me.speed, WANDER_PACE) / max(memory.ease, 1e-3)
    memory.clock += scenario.step * me.speed / pace
    y, slope, curve = path_at(memory.path, rear_axle_next(me, scenario))
    value, noise_rate, noise_bend = noise_at(waves[0], WANDER_DEVIATION, memory.clock)
    shift = p.lane_offset + value
    # the shift grows smoothly: derivatives of blend * shift by the product rule
    blend, rate, bend = smooth_step_at(memory.clock / SETTLING_TIME)
    rate /= SETTLING_TIME
    bend /= SETTLING_TIME * SETTLING_TIME
    return (
        y + blend * shift,
        slope + (rate * shift + blend * noise_rate) / pace,
        curve + (bend * shift + 2.0 * rate * noise_rate + blend * noise_bend) / (pace * pace),
    )


@rows
def synthetic_driver_rows(
    egos: Records,
    seen: Records,
    memory: Records,
    mind: Mind,
    scenario: Records,
    time: float,
) -> None:
    """`synthetic_driver` for every row."""
    for i in range(len(egos)):
        if egos[i].live:
            command = egos[i].command
            own = Mind(
                mind.looks[i], mind.memories[i], mind.known[i], mind.watched[i], mind.waves[i]
            )
            command.acceleration, command.steering = synthetic_driver(
                egos[i], seen[i], memory[i], own, scenario[first_of(scenario, i)], time
            )


class SyntheticDriver(Compiled):
    """A driver that controls the ego in one concrete scenario: the same (seed, driver, scenario)
    drives the same to the bit.
    """

    loop = synthetic_driver_rows
    # clock: time of the wander, s; ease: share of its usual pace at which this clock runs, 0..1
    memory: ClassVar = [*OVERTAKING, *ATTENTION, *fields("clock", "ease")]
    numbers: ClassVar = [
        *fields("reaction_time", "alerted_reaction_time", "gain", "lane_offset"),
        ("idm", PARAMETERS), ("habits", HABITS),
    ]  # fmt: skip

    def __init__(self, driver: Driver, concrete: ConcreteScenario, seed: int) -> None:
        self.driver = driver
        point = (f"{name}={float(value)!r}" for name, value in sorted(concrete.values.items()))
        stream = random_stream(seed, "driving", driver.index, concrete.scenario, *point)
        times = WANDER_CORRELATION_TIME, PEDAL_CORRELATION_TIME
        self.waves = [random_waves(stream, each) for each in times]

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> Any:
        """Memory and mind of drivers whose cases run together.

        others: number of other vehicles in each case.
        """
        count = len(together)
        own = cls.own_records([it.driver for it in together])
        # The longest reaction time is the one without an alert. Looks are kept at each step within
        # it and at its ends, and two in reserve.
        looks = math.ceil(own["p"]["reaction_time"].max() / scenario["step"][0]) + 3
        mind = Mind(
            np.zeros((count, others, looks), LOOK),
            np.zeros((count, others), LOOKS),
            np.zeros((count, others), MOVER),
            unseen(count, others, WATCHED),
            np.array([it.waves for it in together]),
        )
        return own, mind


def human_controller(
    index: int,
    count: int,
    seed: int,
    concrete: ConcreteScenario,
    population: PopulationSettings = AS_RECORDED,
) -> SyntheticDriver:
    """Controller of one synthetic driver, ready for a concrete scenario.

    index: number of the driver, below `count`, the number of drivers of the population.
    seed: of the population.

    The driver depends on these arguments alone, so every drive can run in any worker.
    """
    if not 0 <= index < count:
        raise must_be(
            "`index`", f"a population of {count} drivers", f"within 0..{count - 1}", index
        )
    return SyntheticDriver(draw_driver(index, seed, population), concrete, seed)
