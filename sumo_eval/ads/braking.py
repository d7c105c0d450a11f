"""Brakes in continuous time, for rules that are called once a step.

The braking that a rule intends is a path: a deceleration over time that may begin, rise, hold and
end anywhere within a step. The vehicle model's brakes can do less: from the beginning of a step on
they move to the commanded level at a finite rate, and then hold it. So the command is the level
that takes off the same speed over the step as the path, not the path's value at some instant.

Users: `ads/known_answers.py`, `ads/lane_changer.py`, `ads/pedals.py`, `ads/r157.py`,
`ads/r157_careful_driver.py`.
"""

from collections.abc import Callable
from math import inf, sqrt
from typing import Any, NamedTuple

from sumo_eval.kernels import fields, flags, kernel

_Demand = Callable[..., float]  # (scene, s after now) -> demanded deceleration, m/s2; 0: none
_HALVINGS = 20  # bisections that find an instant in a step: to 5e-8 s at 0.05 s
# m/s2 by which a demand must change within a step to count as a jump: 10 m/s3 at 0.05 s
JUMP = 0.5
# share of an interval by which its ends are left out: at an end the demand may already have jumped
_INSIDE = 1e-3

BRAKE_PATH = fields("level", "brakes", "owed")
"""The braking that a rule intends, and the vehicle's own, which follows it; all 0 at the beginning.

level: intended deceleration, m/s2.
brakes: the vehicle's deceleration, m/s2.
owed: speed that the vehicle has yet to lose to be as slow as intended, m/s.
"""
SAFETY_BRAKING = [("path", BRAKE_PATH), *fields("alarmed"), *flags("is_alarmed", "looks")]
"""Memory of `follow_demand`; all 0 at the beginning.

alarmed: time of the first demand, s.
is_alarmed: 1 once there was a demand.
looks: number of steps in which a demand was looked for.
"""


class Braked(NamedTuple):
    """Result of braking for a time.

    lost: speed taken off within that time, m/s.
    level: deceleration at its end, m/s2.
    """

    lost: float
    level: float


@kernel
def moved(level: float, target: float, rate: float, duration: float) -> Braked:
    """Braking for `duration` s that goes from `level` to `target` (m/s2) at `rate` (m/s3) and then
    stays at `target`.
    """
    change = target - level
    reach = rate * duration
    if abs(change) >= reach:
        end = level + reach if change > 0.0 else level - reach
        return Braked(0.5 * (level + end) * duration, end)
    return Braked(target * duration - 0.5 * change * abs(change) / rate, target)


@kernel
def switched(level: float, target: float, wait: float, rate: float, step: float) -> float:
    """Command for a step, m/s2, that acts as if brakes left `level` for `target` only after `wait`.

    Brakes obey from the beginning of a step on. So a smaller change is commanded at once and held
    to the end of the step. If the next command is `target`, the speed taken off is the same as if
    they had waited:

        change = j / 2 (h + b - sqrt((h + b)^2 - 4 b (h - wait))),  b = |target - level| / j

    level, target: decelerations, m/s2.
    wait: s from the beginning of the step.
    rate: j, of the brakes, m/s3.
    step: h, s.
    """
    if wait >= step:
        return level
    if wait <= 0.0:
        return target
    longest = abs(target - level) / rate  # b: s that the whole change takes
    both = step + longest
    change = 0.5 * rate * (both - sqrt(both * both - 4.0 * longest * (step - wait)))
    return level + change if target > level else level - change


@kernel
def mean_level(level: float, mean: float, rate: float, step: float) -> float:
    """Command for brakes at `level`, m/s2, whose mean over the step is `mean`, or as near to it
    as they can come.
    """
    change = abs(mean - level)
    if change == 0.0:
        return level
    # 0 or less: the fastest change does not reach the mean
    square = step * step - 2.0 * change * step / rate
    change = rate * (step - sqrt(square)) if square > 0.0 else rate * step
    return level + change if mean > level else level - change


@kernel
def released_level(level: float, lost: float, rate: float, step: float, most: float) -> float:
    """Command for brakes at `level`, m/s2, that takes off `lost` m/s until they are released; at
    most `most` m/s2.

    They go at `rate` j to the commanded level c, hold it to the end of the step h, and then go to
    0 at the same rate. Where they only open:

        lost = level^2 / (2 j) + c (h - (level - c) / j)

    and where they brake harder first, as far as they come within the step:

        lost = c (h + level / j) - level^2 / (2 j)
    """
    square = level * level / rate
    if lost > level * step + 0.5 * square:  # more than holding `level` and releasing takes off
        harder = (lost + 0.5 * square) / (step + level / rate)
        # a level that is above `most` already stays where it is
        return min(harder, level + rate * step, max(most, level))
    # solution of the first equation, which is quadratic in c
    spare = step - level / rate
    inside = spare * spare + 4.0 * (lost - 0.5 * square) / rate
    command = 0.5 * rate * (sqrt(inside) - spare) if inside > 0.0 else 0.0
    return min(max(command, 0.0), level)


@kernel
def path_towards(path: Any, target: float, duration: float, rise: float, vehicle: Any) -> float:
    """Speed lost, m/s, while the intended braking goes towards `target` m/s2 for `duration` s.

    It rises at `rise` m/s3, or as fast as the brakes can if that is less, and falls as fast as they
    can. `path.level` becomes the braking at the end.

    path: of `BRAKE_PATH`. vehicle: of a `SCENARIO` record.
    """
    fall = vehicle.brake_jerk
    braked = moved(path.level, target, min(rise, fall) if target > path.level else fall, duration)
    path.level = braked.level
    return braked.lost


@kernel
def path_command(
    path: Any, lost: float, releases: bool, brakes: Any, vehicle: Any, step: float
) -> float:
    """Command for the vehicle in the coming step, m/s2, if the intended braking takes off `lost`
    m/s in it.

    Call once a step.

    path: of `BRAKE_PATH`; `level` is the intended braking at the end of the step.
    releases: whether the intended braking ends in this step, or has ended.
    brakes: limits of the rule: deceleration `braking`, m/s2, and its rise `jerk`, m/s3.
    """
    before, fall = path.brakes, vehicle.brake_jerk
    if releases and before == 0.0 and lost == 0.0:
        path.owed = 0.0
        return 0.0
    most = vehicle.max_deceleration
    if brakes.jerk < fall:  # else the vehicle's brakes lag, and may exceed `braking` to catch up
        most = min(brakes.braking, most)
    if releases:
        # speed to take off until the brakes are open, m/s: also while `level` goes to 0
        until_open = lost + path.owed + 0.5 * path.level * path.level / fall
        command = released_level(before, until_open, fall, step, most)
    else:
        command = min(max(mean_level(before, (lost + path.owed) / step, fall, step), 0.0), most)
    braked = moved(before, command, fall, step)
    path.brakes = braked.level
    path.owed += lost - braked.lost
    return command


@kernel
def first_instant(demand: _Demand, scene: Any, above: float, begin: float, end: float) -> float:
    """Instant within begin..end, s, at which a demand crosses the limit `above`, m/s2, upwards or
    downwards.

    demand: called with the scene and a time; at just one of both ends it is above the limit.
    """
    above_at_end = demand(scene, end) > above
    for _ in range(_HALVINGS):
        middle = 0.5 * (begin + end)
        if (demand(scene, middle) > above) == above_at_end:
            end = middle
        else:
            begin = middle
    return end


@kernel
def demand_jump(demand: _Demand, scene: Any, begin: float, end: float) -> float:
    """Instant within begin..end, s, at which a demand passes half of its change; `end` if it
    changes by less than `JUMP`.

    It is for `path_along`, which takes the demand in the middle of an interval. That is exact to
    second order where the demand is smooth, but only to first order where it jumps: there the
    interval is split.
    """
    inside = _INSIDE * (end - begin)
    early, late = demand(scene, begin + inside), demand(scene, end - inside)
    if abs(late - early) < JUMP:
        return end
    return first_instant(demand, scene, 0.5 * (early + late), begin + inside, end - inside)


@kernel
def path_along(
    path: Any, demand: _Demand, scene: Any, begin: float, end: float, brakes: Any,
    vehicle: Any,
) -> float:  # fmt: skip
    """Speed lost, m/s, while the intended braking follows the demand from `begin` to `end`, s after
    now.
    """
    jump = demand_jump(demand, scene, begin, end)
    lost = 0.0
    for first, last in ((begin, jump), (jump, end)):
        if last > first:
            target = min(demand(scene, 0.5 * (first + last)), brakes.braking)
            lost += path_towards(path, target, last - first, brakes.jerk, vehicle)
    return lost


@kernel
def follow_demand(
    braking: Any, demand: _Demand, scene: Any, time: float, brakes: Any, scenario: Any
) -> float:
    """Command for the vehicle in the coming step, m/s2. Call once a step.

    The brakes act once a response time has passed since the first demand. It passes only once:
    after an alarm the rule stays alert.

    braking: memory, `SAFETY_BRAKING`.
    demand: called with the scene and a time after now, s, from -1.5 steps to 1 step; gives the
        deceleration that is demanded then, as far as it can be foreseen, m/s2, or 0.
    time: now, s.
    brakes: they act `response` s after the first demand, rise at `jerk`, m/s3, up to `braking`,
        m/s2.
    """
    path, jerk = braking.path, brakes.jerk
    vehicle, step = scenario.vehicle, scenario.step
    _look_for_demand(braking, demand, scene, time, step)
    wait = max(braking.alarmed + brakes.response - time, 0.0) if braking.is_alarmed else inf
    if wait >= step:
        return path_command(
            path, path_towards(path, 0.0, step, jerk, vehicle), True, brakes, vehicle, step
        )
    # whether braking is demanded when the wait is over, and at the end of the step
    before, after = demand(scene, wait) > 0.0, demand(scene, step) > 0.0
    change = step if before == after else first_instant(demand, scene, 0.0, wait, step)
    lost = 0.0
    # parts of the step as (begin, end, whether the rule brakes then): the rest of the response
    # time, the time up to a change of demand, the time after it
    for begin, end, brakes_then in (
        (0.0, wait, False),
        (wait, change, before),
        (change, step, after),
    ):
        if end > begin and brakes_then:
            lost += path_along(path, demand, scene, begin, end, brakes, vehicle)
        elif end > begin:
            lost += path_towards(path, 0.0, end - begin, jerk, vehicle)
    return path_command(path, lost, not after, brakes, vehicle, step)


@kernel
def _look_for_demand(braking: Any, demand: _Demand, scene: Any, time: float, step: float) -> None:
    """Write the time of the first demand to `braking`, once there is a demand.

    It is looked for half a step ago: speeds that follow from two positions belong to that instant.
    A demand that, as seen now, was there at the last look already came with a jump: it is taken to
    have begun a step ago.
    """
    if braking.looks == 0:
        if demand(scene, 0.0) > 0.0:
            braking.is_alarmed = 1
            braking.alarmed = time
    elif braking.is_alarmed == 0 and demand(scene, -0.5 * step) > 0.0:
        began = -step  # s from now
        earlier = -1.5 * step if braking.looks > 1 else -step
        if not demand(scene, earlier) > 0.0:
            began = first_instant(demand, scene, 0.0, earlier, -0.5 * step)
        braking.is_alarmed = 1
        braking.alarmed = time + began
    braking.looks += 1
