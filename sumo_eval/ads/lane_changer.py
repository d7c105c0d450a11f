"""The ADS `lane_changer`: keeps its speed and overtakes a slower vehicle smoothly when it pays, else follows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_eval.ads.braking import JUMP, first_instant
from sumo_eval.ads.car_following import PARAMETERS, IdmParameters, free_acceleration
from sumo_eval.ads.cycle import cycles_of
from sumo_eval.ads.lane_change import path_at, rear_axle_next, steering
from sumo_eval.ads.overtaking import HABITS, OVERTAKING, WATCHED, OvertakingHabits, overtake
from sumo_eval.ads.pedals import PEDALS, gained_towards, pedal_command
from sumo_eval.ads.perception import is_visible, take
from sumo_eval.ads.r157 import SIGHTING, foresee, sight
from sumo_eval.cosim.compiled import Compiled, records, unknown
from sumo_eval.cosim.records import MOVER, Records, fields, flags
from sumo_eval.kernels import kernel, rows

SMOOTH = OvertakingHabits(inclined=True, onset_headway=2.5, onset_ttc=10.0, duration=8.0)

_MEMORY = np.dtype(
    [
        ("decided", OVERTAKING), ("tried", OVERTAKING), ("pedals", PEDALS), ("then", MOVER),
        *fields("desired_speed", "told"), *flags("steps"),
    ]
)  # fmt: skip
"""decided: what it is about. tried: what it would be about at some instant of the cycle. then: where the ego is at it,
as far as can be foreseen. told: acceleration, m/s2. steps: how many there have been."""


@kernel
def _remember(to: Any, decided: Any) -> None:
    """Write what is decided into another record."""
    path, goes = decided.path, to.path
    goes.start, goes.offset, goes.begin, goes.length = path.start, path.offset, path.begin, path.length
    to.cruising_speed, to.began = decided.cruising_speed, decided.began
    to.passing, to.changing, to.curvature = decided.passing, decided.changing, decided.curvature


@kernel
def _foresee_ego(then: Any, me: Any, acceleration: float, time: float) -> None:
    """Write into `then` the ego `time` s from now, if it goes on with an acceleration, m/s2."""
    take(then, me)
    gained = max(acceleration * time, -me.along)
    then.x, then.y = me.x + (me.along + 0.5 * gained) * time, me.y + me.across * time
    then.along, then.speed = me.along + gained, max(me.speed + gained, 0.0)


@kernel
def wanted_at(scene: Any, after: float) -> float:
    """Acceleration wanted `after` s from now, if everybody goes on as now, m/s2. What would be decided then is in
    `memory.tried`. scene: as the rule makes it.
    """
    me, memory, sightings, watched, later, tried, habits, p, way, scenario = scene
    _foresee_ego(memory.then, me, memory.pedals.level, after)
    for j in range(len(later)):
        foresee(later[j], sightings[j], after, scenario.step)
    for j in range(len(later)):
        tried[j].leads = 1 if is_visible(memory.then, later, j, 0.0) else 0
        tried[j].accepted = watched[j].accepted
    for j in range(len(later)):
        later[j].braking = 0.0
        if tried[j].leads == 0:
            later[j].x = math.nan
    _remember(memory.tried, memory.decided)
    free = free_acceleration(memory.then.speed, memory.desired_speed, p)
    return float(
        overtake(memory.tried, memory.then, later, tried, habits, p, memory.desired_speed, free, way, scenario)
    )


@kernel
def _changes_at(scene: Any, after: float) -> float:
    """1 if it would be changing lane `after` s from now, else 0."""
    wanted_at(scene, after)
    return float(scene[1].tried.changing)


@kernel
def _decide_at(scene: Any, after: float) -> float:
    """Decide as `after` s from now; the acceleration wanted then, m/s2. Call once a step."""
    wanted = wanted_at(scene, after)
    _, memory, _, watched, _, tried, _, _, _, _ = scene
    _remember(memory.decided, memory.tried)
    for j in range(len(watched)):
        watched[j].accepted = tried[j].accepted
    return wanted


@kernel
def _turn_in(scene: Any, step: float) -> float:
    """When in the coming `step` the lane change begins, or the acceleration that is wanted jumps, s; `step`: never."""
    memory = scene[1]
    now, changes_now = wanted_at(scene, 0.0), memory.tried.changing
    end, changes = wanted_at(scene, step), memory.tried.changing
    if changes_now != memory.decided.changing:
        return 0.0
    if changes != changes_now:
        return first_instant(_changes_at, scene, 0.5, 0.0, step)
    if abs(end - now) >= JUMP:
        return first_instant(wanted_at, scene, 0.5 * (now + end), 0.0, step)
    return step


@kernel
def _decide(scene: Any) -> float:
    """What to tell the vehicle in the coming cycle, m/s2.

    What is wanted counts as in the middle of the parts of the cycle before and after the instant at which it jumps or
    the lane change begins; that begins at that instant.
    """
    me, memory, _, _, _, _, _, _, _, scenario = scene
    step, vehicle = scenario.step, scenario.vehicle
    turn = _turn_in(scene, step)
    gained, lasts = 0.0, step
    if turn >= step:
        wanted = _decide_at(scene, 0.5 * step)
    else:
        if turn > 0.0:
            before = max(wanted_at(scene, 0.5 * turn), -vehicle.max_deceleration)
            gained, lasts = gained_towards(memory.pedals, before, turn, vehicle), step - turn
        _decide_at(scene, turn)
        wanted = wanted_at(scene, 0.5 * (turn + step))
    gained += gained_towards(memory.pedals, max(wanted, -vehicle.max_deceleration), lasts, vehicle)
    return float(pedal_command(memory.pedals, me.speed, gained, vehicle, step))


@kernel
def lane_changer(
    me: Any, others: Any, memory: Any, sightings: Any, watched: Any, later: Any, tried: Any, habits: Any, p: Any,
    way: Any, cycle: Any, scenario: Any,
) -> tuple[float, float]:  # fmt: skip
    """Acceleration, m/s2, and steering wheel angle, rad: decide once a cycle, then steer along the path decided on.

    Beside a lead that it passes the rule brakes or does not: who is just clear is let go, and is not clear any more.
    way: the lane change that the ego has to make, if it has to. cycle: the scenario, with a cycle as its step.
    """
    if memory.steps == 0:
        memory.desired_speed = me.speed
    if memory.steps % round(cycle.step / scenario.step) == 0:
        for j in range(len(others)):
            sight(sightings[j], others[j], cycle.step)
        memory.told = _decide((me, memory, sightings, watched, later, tried, habits, p, way, cycle))
    memory.steps += 1
    y, slope, bend = path_at(memory.decided.path, rear_axle_next(me, scenario))
    return memory.told, steering(memory.decided, me, y, slope, bend, scenario)


@rows
def lane_changer_rows(
    egos: Records, seen: Records, memory: Records, sightings: Records, watched: Records, later: Records,
    tried: Records, habits: Records, parameters: Records, cycles: Records, scenario: Records, time: float,
) -> None:  # fmt: skip
    """`lane_changer` for every row."""
    for i in range(len(egos)):
        if egos[i].live:
            command = egos[i].command
            command.acceleration, command.steering = lane_changer(
                egos[i].seen, seen[i], memory[i], sightings[i], watched[i], later[i], tried[i], habits[i],
                parameters[i], egos[i].way, cycles[i], scenario[0],
            )  # fmt: skip


class LaneChanger(Compiled):
    """Overtakes a lead that is 2 m/s slower than its own initial speed: one smooth lane change, and it stays left.

    It begins at 10 s TTC or 2.5 s headway (the medians of recorded drivers, DLR-HT 2024) and takes 8 s, or the time
    that is left to be clear of the lead, but not less than a lateral acceleration of 2 m/s2 allows (3.2 s); where
    braking alone would need over 80 % of the brakes, 4 m/s2 (2.25 s). The left lane must be free: see
    `sumo_eval.ads.overtaking`. If it cannot change, it follows by the enhanced IDM. It sees a hidden vehicle once
    nothing covers any of it.
    """

    loop = staticmethod(lane_changer_rows)

    def __init__(self, habits: OvertakingHabits = SMOOTH, parameters: IdmParameters | None = None) -> None:
        self.habits = habits
        self.parameters = parameters or IdmParameters()

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Memory, what is remembered of the others, room for where they are foreseen to be, habits, parameters and what
        a cycle is.
        """
        count = len(together)
        return (
            np.zeros(count, _MEMORY),
            unknown(count, others, SIGHTING),
            unknown(count, others, WATCHED),
            np.zeros((count, others), MOVER),
            unknown(count, others, WATCHED),
            records([each.habits for each in together], HABITS),
            records([each.parameters for each in together], PARAMETERS),
            cycles_of(scenario, count),
        )
