"""Common parts of the baselines of UN Regulation No. 157, of `rss` and of `lane_changer`: brakes
that build up, distances and headways, what an actor shows (sighting), where it will be (foresight).

Each rule has its own time from a danger to the demand to brake. From there to full braking it takes
`response` + `braking` / `jerk` (`Brakes`).

Users: `ads/fuzzy_safety_model.py`, `ads/lane_changer.py`, `ads/r157_careful_driver.py`,
`ads/reg157.py`, `ads/rss.py`.
"""

from collections.abc import Callable
from math import inf, isnan
from typing import Any, NamedTuple

from sumo_eval.ads.braking import SAFETY_BRAKING, follow_demand
from sumo_eval.ads.lane_change import lane_kept
from sumo_eval.ads.perception import bumper_gap, carry_on, is_in_sight, take
from sumo_eval.cosim.compiled import decides, each_row
from sumo_eval.cosim.records import MOVER
from sumo_eval.kernels import fields, flags, kernel

GRAVITY = 9.81  # m/s2
HUMAN_JERK = 12.65  # m/s3 at which the regulation's human builds up its braking, in 0.6 s
HUMAN_BRAKING = 0.774 * GRAVITY  # m/s2, the strongest of the regulation's human
# s, headway up to which the regulation's human reacts to what the lead does
FOLLOWING_HEADWAY = 2.0
HEADWAY_ROUNDING = 0.01  # s, see `within_headway`
# largest covered share of a vehicle's width at which it is still seen: of 1.9 m, 0.38 m must show
MOST_COVERED = 0.8


@kernel
def brake_ramp(elapsed: float, level: float, build_up: float) -> float:
    """Deceleration of a brake ramp `elapsed` s after it began, m/s2: it rises from 0 to `level`
    linearly over `build_up` s, then stays; 0 before it began.
    """
    if elapsed <= 0.0:
        return 0.0
    return level * min(elapsed / build_up, 1.0) if build_up > 0.0 else level


@kernel
def brake_ramp_lost(elapsed: float, level: float, build_up: float) -> float:
    """Speed lost by a `brake_ramp`, `elapsed` s after it began, m/s; 0 before."""
    if elapsed <= 0.0:
        return 0.0
    if elapsed < build_up:
        return 0.5 * level * elapsed * elapsed / build_up
    return level * (elapsed - 0.5 * build_up)


@kernel
def time_to_collision(me: Any, other: Any) -> float:
    """TTC = d / (v - w), s: bumper gap d over closing speed, the ego's v less the other's w; inf if
    they do not close, 0 or less if the bodies overlap along the road.
    """
    closing = me.along - other.along
    return bumper_gap(me, other) / closing if closing > 0.0 else inf


@kernel
def time_headway(me: Any, other: Any) -> float:
    """THW = d / v, s: bumper gap d over the ego's speed v; inf at standstill."""
    return bumper_gap(me, other) / me.along if me.along > 0.0 else inf


@kernel
def lateral_gap(me: Any, other: Any) -> float:
    """Free space between both bodies across the road, m; negative if they share a strip of road."""
    return float(abs(other.y - me.y) - me.half_width - other.half_width)


@kernel
def within_headway(me: Any, other: Any) -> bool:
    """Whether the time headway is at most `FOLLOWING_HEADWAY`, or above it by no more than
    rounding: a scenario may begin at just this headway.
    """
    return time_headway(me, other) <= FOLLOWING_HEADWAY + HEADWAY_ROUNDING


@kernel
def closing_across(me: Any, other: Any) -> float:
    """Speed at which both come nearer to each other across the road, m/s; negative: apart."""
    relative = other.across - me.across
    return float(-relative if other.y > me.y else relative)


SIGHTING = [*fields("last_speed", "last_y", "across", "gain"), ("mover", MOVER)]
"""An actor as the last steps show it; nan before it was seen.

last_speed, last_y: at the last look, m/s along the road, and m.
across: mean speed across the road over the last step, m/s, which is the speed in its middle.
gain: change of `across` since the step before, m/s2; 0 if the motion began or turned round.
mover: the actor at the last look, x nan if it was gone; with the braking that its last two speeds
    show, and from the second look on the speed across that its last two positions show.
"""
SIGHTED = [("sighting", SIGHTING)]
"""Memory of an actor, for rules that need no more."""
SAFETY_MEMORY = [
    ("braking", SAFETY_BRAKING),
    ("me", MOVER),
    ("then", MOVER),
    *fields("commanded"),
    *flags("steps"),
]
"""Memory of a baseline with safety braking; all 0 at the beginning.

me: the ego as it is, with the baseline's braking.
then: the ego at some instant, as foreseen.
commanded: acceleration of this cycle, m/s2.
steps: number of steps so far.
"""
# parameter of a rule: its `Brakes`
BRAKES = ("brakes", fields("response", "braking", "jerk"))


class Brakes(NamedTuple):
    """Brakes of a rule: they act `response` s after a first demand, with up to `braking` m/s2,
    rising at `jerk` m/s3.
    """

    response: float
    braking: float
    jerk: float


@kernel
def sight(sighting: Any, other: Any, step: float) -> None:
    """Update a sighting with what an actor shows at this step. Call once a step and actor.

    Speeds across the road come from positions, as a body may move across without turning.

    step: time since the last call, s.
    """
    mover = sighting.mover
    take(mover, other)
    if isnan(other.x):  # not on the road yet, or no longer
        return
    last_speed = other.along if isnan(sighting.last_speed) else sighting.last_speed
    last_y = sighting.last_y
    before = 0.0 if isnan(sighting.across) else sighting.across
    # `along` of an oncoming vehicle is below 0 and falls as it speeds up, which is no braking
    mover.braking = max((last_speed - other.along) / step, 0.0) if last_speed > 0.0 else 0.0
    sighting.last_speed = other.along
    sighting.last_y = other.y
    sighting.gain = 0.0
    if isnan(last_y):
        return
    across = (other.y - last_y) / step
    mover.across = sighting.across = across
    if across * before > 0.0:
        sighting.gain = (across - before) / step


@kernel
def foresee(then: Any, sighting: Any, time: float, step: float) -> None:
    """Write into `then` the actor `time` s from now, if it continues as now; for a negative time,
    as it was.

    step: time between two updates of the sighting, s.
    """
    take(then, sighting.mover)
    carry_on(then, time)
    if sighting.gain != 0.0 and not isnan(sighting.gain):
        # For times before the middle of the last step, in which the actor had the speed `across`:
        # before that it changed by `gain` a second. Its y is that at constant speed.
        middle = -0.5 * step
        then.across += sighting.gain * (min(time, middle) - middle)


@kernel
def foresee_all(own: Any, watched: Any, others_then: Any, time: float, step: float) -> None:
    """Write into `own.then` and `others_then` the ego and all actors `time` s from now, if all
    continue as now: the ego as in `own.me`, the actors as in their sightings.
    """
    take(own.then, own.me)
    carry_on(own.then, time)
    for j in range(len(watched)):
        foresee(others_then[j], watched[j].sighting, time, step)


def braking_loop(braking_for: Callable[..., float], clocks: int = 2) -> Callable[..., None]:
    """Loop of a rule that commands the braking that an actor ahead demands, and keeps the lane.

    braking_for: gives the deceleration that an actor demands, m/s2; 0: none. Its arguments: the
        ego; the actor, which is in sight ahead; the rule's parameters (with `BRAKES`); and the
        `SCENARIO` record whose `step` is the time between two decisions.
    clocks: 1: the rule decides at every step; 2: once a cycle. So many of the two `SCENARIO`
        records are used, and the `step` of the last is the time between two decisions.
    """

    @kernel
    def demand(scene: Any, after: float) -> float:
        # the strongest braking that any actor demands `after` s from now, if all continue as now;
        # scene: (own, watched, others_then, `SCENARIO` record of the time between decisions)
        own, watched, others_then = scene[:3]
        cycle = scene[3]
        foresee_all(own, watched, others_then, after, cycle.step)
        me = own.then
        demanded = 0.0
        for j in range(len(others_then)):
            if others_then[j].x > me.x and is_in_sight(me, others_then, j, MOST_COVERED):
                demanded = max(demanded, braking_for(me, others_then[j], own.p, cycle))
        return demanded

    @kernel
    def rule(
        ego: Any, others: Any, own: Any, watched: Any, others_then: Any, scenario: Any
    ) -> None:
        if decides(own, scenario[:clocks]):
            cycle = scenario[clocks - 1]
            take(own.me, ego.seen)
            # what the ego's own brakes (`SAFETY_BRAKING`) intend now
            own.me.braking = own.braking.path.level
            for j in range(len(others)):
                sight(watched[j].sighting, others[j], cycle.step)
            scene = (own, watched, others_then, cycle)
            own.commanded = -follow_demand(
                own.braking, demand, scene, ego.time, own.p.brakes, cycle
            )
        ego.command.acceleration = own.commanded
        ego.command.steering = lane_kept(ego, scenario[0])

    return each_row(rule)
