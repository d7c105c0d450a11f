"""Skilled human drivers as controllers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.ads.car_following import PARAMETERS
from sumo_eval.ads.lane_change import (
    path_at,
    rear_axle_next,
    smooth_step,
    smooth_step_bend,
    smooth_step_rate,
    steering,
)
from sumo_eval.ads.overtaking import HABITS, OVERTAKING, WATCHED, OvertakingHabits, overtake
from sumo_eval.ads.perception import carry_on, is_visible, take
from sumo_eval.cosim.compiled import Compiled, unknown
from sumo_eval.cosim.records import MOVER, Records, fields, flags
from sumo_eval.cosim.step_rules import first_of
from sumo_eval.drivers.synthetic.population import AS_RECORDED, Driver, draw_driver
from sumo_eval.drivers.synthetic.wander import SmoothNoise, noise_at
from sumo_eval.errors import must_be
from sumo_eval.kernels import kernel, rows
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import PopulationSettings
from sumo_eval.settings.random_streams import random_stream

WANDER_DEVIATION = 0.25  # m, within a driver (DLR Highway Traffic)
WANDER_CORRELATION_TIME = 2.2
"""l of exp(-t^2 / (2 l^2)), s: fits the in-lane wander of 80 recorded cars at 1, 2, 3, 4 and 5 s to
0.04. By the usual integral measure, 2.8 s."""
# m/s; slower vehicles wander by distance instead of time, so that they need no sharper curves
WANDER_PACE = 10.0
SETTLING_TIME = 5.0
"""s.

Every case begins in the middle of the lane at a given steady speed; in this time a driver's own
line, own speed and wander take over.
"""
# s, time constant in which a driver who is about to pass something stops wandering, and starts
# again
FOCUS_TIME = 0.3

PEDAL_DEVIATION = 0.39
"""Wander of the pedals, m/s2.

The resulting drive is steadier, because the driver holds the speed: with this the acceleration of
drivers who overtake changes within 0.5, 1, 2, 3 and 4 s by as much as that of 64 recorded
overtakers, to 3 % (root mean square 0.09, 0.18, 0.33, 0.44 and 0.51 m/s2; DLR Highway Traffic).
"""
PEDAL_CORRELATION_TIME = 2.0  # s (DLR Highway Traffic: the correlation is 0.59 at 2 s, 0.28 at 3 s)
SPEED_RELAXATION = 8.0  # s in which a driver approaches the speed at which he settles

# a driver recognises a vehicle once 30 % of its width shows: the lamp of one side
HIDING_SHARE = 0.7
NOTICED_BRAKING = 0.5  # m/s2 of a vehicle ahead; brake lights tell, engine braking is hardly seen
CROSSING_SPEED = 0.3  # m/s across the road: a vehicle ahead that begins to change lane
# m/s: one that is being approached (the rule by which the recorded approaches were chosen)
CLOSING_SPEED = 2.0


LOOK = np.dtype([*fields("time"), ("mover", MOVER)])
LOOKS = [*fields("first_seen"), *flags("begun", "first", "count")]
"""Of the looks at a vehicle, which are written round and round: when the first was, which is the
oldest that counts, and how many there have been."""
ATTENTION = [*fields("delay"), *flags("attends")]


class Mind(NamedTuple):
    """Arrays of drivers, (n, m) for the m other vehicles.

    looks: `LOOK`, (n, m, k), at each vehicle; memories: `LOOKS`, of these.
    known: `MOVER`, the vehicles that the driver acts upon; nan: not known.
    watched: of `overtake`.
    waves: of the wander and of the pedal, (n, 2, 8, 2).
    """

    looks: Any
    memories: Any
    known: Any
    watched: Any
    waves: Any


@kernel
def attend(attention: Any, me: Any, others: Any, mind: Any, p: Any, time: float) -> None:
    """Look at the true scene at `time`, and write the vehicles that the driver acts upon to
    `mind.known`.

    The driver knows each vehicle as it was one reaction time ago, extrapolated to now as it moved
    then. So a steady vehicle is perceived exactly, and a change (a new vehicle, braking, a lane
    change) one reaction time late: the human driver model's delay with anticipation (Treiber,
    Kesting, Helbing, Physica A 360, 71 (2006)). The reaction time is the alerted one from the
    moment at which a vehicle in front crosses, is closed upon or appears.
    """
    looks, memories, known = mind.looks, mind.memories, mind.known
    if attention.attends == 0:
        attention.attends, attention.delay = 1, p.reaction_time
    for j in range(len(others)):
        if not is_visible(me, others, j, HIDING_SHARE):
            continue
        other, memory, ring = others[j], memories[j], looks[j]
        if memory.begun == 0:
            memory.begun, memory.first_seen = 1, time
            if time > 0.0:
                attention.delay = p.alerted_reaction_time
        elif other.x > me.x and (
            abs(other.across) > CROSSING_SPEED or me.along - other.along > CLOSING_SPEED
        ):
            attention.delay = p.alerted_reaction_time
        braking = 0.0
        if memory.count > 0:
            last = ring[(memory.count - 1) % len(ring)]
            braking = (last.mover.along - other.along) / (time - last.time)
        look = ring[memory.count % len(ring)]
        take(look.mover, other)
        look.time, look.mover.braking = time, braking if braking > NOTICED_BRAKING else 0.0
        memory.count += 1
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


_MEMORY = np.dtype([*OVERTAKING, *ATTENTION, *fields("clock", "ease")])
_PARAMETERS = np.dtype(
    [
        *fields("reaction_time", "alerted_reaction_time", "gain", "lane_offset",
            "wander_amplitude", "pedal_amplitude"),
        ("idm", PARAMETERS), ("habits", HABITS),
    ]
)  # fmt: skip


@kernel
def synthetic_driver(
    ego: Any, others: Any, memory: Any, mind: Any, p: Any, scenario: Any, time: float
) -> tuple[float, float]:
    """Acceleration, m/s2, and steering wheel angle, rad: look, decide, work the pedals and the
    wheel.
    """
    me, way, waves = ego.seen, ego.way, mind.waves
    if memory.began == 0:
        memory.ease = 1.0
    attend(memory, me, others, mind, p, time)
    start = memory.cruising_speed if memory.began else me.speed
    desired = start * p.gain
    pedal = noise_at(waves[1], p.pedal_amplitude, time)[0]
    free = (desired - me.speed) / SPEED_RELAXATION + pedal
    memory.desired_speed, memory.free = desired, free * smooth_step(time / SETTLING_TIME)
    wanted = overtake(memory, me, mind.known, mind.watched, p, way, scenario)
    y, slope, bend = _line(memory, me, waves, p, scenario)
    return max(wanted, -scenario.vehicle.max_deceleration), steering(
        memory, me, y, slope, bend, scenario
    )


@kernel
def _line(memory: Any, me: Any, waves: Any, p: Any, scenario: Any) -> tuple[float, float, float]:
    """The path, with the driver's own place in the lane and wander on top.

    The wander runs on a clock of its own, which stands while the driver steers closely past
    something.
    """
    focus = 0.0 if memory.passing else 1.0
    memory.ease += (focus - memory.ease) * min(scenario.step / FOCUS_TIME, 1.0)
    pace = max(me.speed, WANDER_PACE) / max(memory.ease, 1e-3)
    memory.clock += scenario.step * me.speed / pace
    y, slope, curve = path_at(memory.path, rear_axle_next(me, scenario))
    value, noise_rate, noise_bend = noise_at(waves[0], p.wander_amplitude, memory.clock)
    shift = p.lane_offset + value
    share = memory.clock / SETTLING_TIME
    if share >= 1.0:
        return y + shift, slope + noise_rate / pace, curve + noise_bend / (pace * pace)
    blend = smooth_step(share)
    rate = smooth_step_rate(share) / SETTLING_TIME
    bend = smooth_step_bend(share) / (SETTLING_TIME * SETTLING_TIME)
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
    parameters: Records,
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
                egos[i], seen[i], memory[i], own, parameters[i],
                scenario[first_of(scenario, i)], time,
            )  # fmt: skip


class SyntheticDriver(Compiled):
    """A driver that controls the ego in one concrete scenario: the same (seed, driver, scenario)
    drives the same to the bit.
    """

    loop = staticmethod(synthetic_driver_rows)

    def __init__(self, driver: Driver, concrete: ConcreteScenario, seed: int) -> None:
        self.driver = driver
        point = (f"{name}={float(value)!r}" for name, value in sorted(concrete.values.items()))
        stream = random_stream(seed, "driving", driver.index, concrete.scenario, *point)
        self.wander = SmoothNoise(stream, WANDER_DEVIATION, WANDER_CORRELATION_TIME)
        self.pedal = SmoothNoise(stream, PEDAL_DEVIATION, PEDAL_CORRELATION_TIME)

    @property
    def habits(self) -> OvertakingHabits:
        """Overtaking habits of the driver."""
        driver = self.driver
        return OvertakingHabits(
            inclined=driver.overtakes,
            onset_headway=driver.onset_headway,
            onset_ttc=driver.onset_ttc,
            duration=driver.lane_change_duration,
        )

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> Any:
        """Memory, mind and parameters."""
        count, step = len(together), float(scenario["step"][0])
        longest = max(
            max(it.driver.reaction_time, it.driver.alerted_reaction_time) for it in together
        )
        mind = Mind(
            np.zeros((count, others, math.ceil(longest / step) + 3), LOOK),
            np.zeros((count, others), LOOKS),
            np.zeros((count, others), MOVER),
            unknown(count, others, WATCHED),
            np.array([(it.wander.waves, it.pedal.waves) for it in together]),
        )
        return np.zeros(count, _MEMORY), mind, parameters(together)


def parameters(together: Sequence[SyntheticDriver]) -> Records:
    """The drivers' parameters, a record each."""
    found = np.zeros(len(together), _PARAMETERS)
    for i, each in enumerate(together):
        who, habits = each.driver, each.habits
        found[i] = (
            who.reaction_time, who.alerted_reaction_time, who.gain, who.lane_offset,
            each.wander.amplitude,
            each.pedal.amplitude, tuple(getattr(who.idm, name) for name, _ in PARAMETERS),
            tuple(getattr(habits, name) for name, _ in HABITS),
        )  # fmt: skip
    return found


def human_controller(
    index: int,
    count: int,
    seed: int,
    concrete: ConcreteScenario,
    population: PopulationSettings = AS_RECORDED,
) -> SyntheticDriver:
    """Driver number `index` of the `count` drivers of the population `seed`, ready for a concrete
    scenario.

    Everything is made from these, so a pool of processes can run each human run as a case of its
    own.
    """
    if not 0 <= index < count:
        raise must_be(
            "`index`", f"a population of {count} drivers", f"within 0..{count - 1}", index
        )
    return SyntheticDriver(draw_driver(index, seed, population), concrete, seed)
