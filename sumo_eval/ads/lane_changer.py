"""The ADS `lane_changer`: keeps its speed and overtakes a slower vehicle smoothly when it pays,
else follows.

It decides once a cycle, but a lane change or a jump of the wanted acceleration may come at any
instant of the cycle. So the rule evaluates its decision (`overtaking.overtake`) at several instants
of the coming cycle: each try works on copies (`tried`, `then`, `others_then`), and one of them
becomes `decided`.

Users: `cosim/doors/controller.py`, by name.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

from sumo_eval.ads.braking import JUMP, first_instant
from sumo_eval.ads.car_following import PARAMETERS, IdmParameters, free_acceleration
from sumo_eval.ads.lane_change import path_at, rear_axle_next, steering
from sumo_eval.ads.overtaking import HABITS, OVERTAKING, WATCHED, OvertakingHabits, overtake
from sumo_eval.ads.pedals import PEDALS, gained_towards, pedal_command
from sumo_eval.ads.perception import is_visible, take
from sumo_eval.ads.r157 import SIGHTED, foresee, sight
from sumo_eval.cosim.compiled import Compiled, decides, each_row
from sumo_eval.cosim.records import MOVER
from sumo_eval.kernels import fields, flags, kernel

# it overtakes when not in danger, too (`inclined`); times in s
SMOOTH = OvertakingHabits(inclined=True, onset_headway=2.5, onset_ttc=10.0, duration=8.0)


class Scene(NamedTuple):
    """Records that a decision reads and writes.

    me: the ego. own: `LaneChanger.memory`.
    watched: `LaneChanger.watched`, of each actor.
    others_then: scratch records for the foreseen actors.
    way: the requested lane change.
    scenario: the `SCENARIO` record whose step is a cycle.
    """

    me: Any
    own: Any
    watched: Any
    others_then: Any
    way: Any
    scenario: Any


@kernel
def _copy_decision(to: Any, source: Any) -> None:
    """Copy a record of `OVERTAKING`, except `desired_speed` and `free`, which are of one step."""
    path, copied = source.path, to.path
    copied.start, copied.offset = path.start, path.offset
    copied.begin, copied.length = path.begin, path.length
    to.cruising_speed, to.began = source.cruising_speed, source.began
    to.passing, to.changing, to.curvature = source.passing, source.changing, source.curvature


@kernel
def _foresee_ego(then: Any, me: Any, acceleration: float, time: float) -> None:
    """Write into `then` the ego `time` s from now, if it continues with an acceleration, m/s2."""
    take(then, me)
    gained = max(acceleration * time, -me.along)  # m/s; it does not roll back
    then.x, then.y = me.x + (me.along + 0.5 * gained) * time, me.y + me.across * time
    then.along, then.speed = me.along + gained, max(me.speed + gained, 0.0)


@kernel
def wanted_at(scene: Any, after: float) -> float:
    """Acceleration wanted `after` s from now, if all continue as now, m/s2; writes the decision at
    that instant into `own.tried`.

    scene: a `Scene`, here and below.
    """
    own, watched, others_then = scene.own, scene.watched, scene.others_then
    _foresee_ego(own.then, scene.me, own.pedals.level, after)
    for j in range(len(others_then)):
        known = watched[j]
        foresee(others_then[j], known.sighting, after, scene.scenario.step)
        # each try starts from the headways that were decided, and expects no actor to brake
        others_then[j].braking = 0.0
        known.accepted = known.kept
    _remove_hidden(own.then, others_then, watched)
    _copy_decision(own.tried, own.decided)
    tried = own.tried
    tried.desired_speed = own.desired_speed
    tried.free = free_acceleration(own.then.speed, own.desired_speed, own.p.idm)
    return overtake(tried, own.then, others_then, watched, own.p, scene.way, scene.scenario)


@kernel
def _remove_hidden(me: Any, others: Any, watched: Any) -> None:
    """Make x nan of the actors that the ego does not see."""
    # `leads` holds here whether the actor is seen; `overtake` writes it again. An actor is removed
    # only after all have been looked for, as a hidden actor may hide another.
    for j in range(len(others)):
        watched[j].leads = 1 if is_visible(me, others, j, 0.0) else 0
    for j in range(len(others)):
        if watched[j].leads == 0:
            others[j].x = math.nan


@kernel
def _changes_at(scene: Any, after: float) -> float:
    """1 if the ego would be changing lane `after` s from now, else 0."""
    wanted_at(scene, after)
    return float(scene.own.tried.changing)


@kernel
def _decide_at(scene: Any, after: float) -> float:
    """Make the decision of the instant `after` s from now the decision of the rule; returns the
    acceleration wanted then, m/s2.

    Call once a cycle.
    """
    wanted = wanted_at(scene, after)
    _copy_decision(scene.own.decided, scene.own.tried)
    for j in range(len(scene.watched)):
        scene.watched[j].kept = scene.watched[j].accepted
    return wanted


@kernel
def _split_at(scene: Any, step: float) -> float:
    """Instant within the coming cycle, 0..`step` s, at which the lane change begins, or the wanted
    acceleration jumps; `step`: neither.
    """
    own = scene.own
    # the order matters: `wanted_at` also writes `own.tried`, which is read after it
    now, changes_now = wanted_at(scene, 0.0), own.tried.changing
    end, changes = wanted_at(scene, step), own.tried.changing
    if changes_now != own.decided.changing:
        return 0.0
    if changes != changes_now:
        return first_instant(_changes_at, scene, 0.5, 0.0, step)  # 0.5: between 0 and 1
    if abs(end - now) >= JUMP:
        return first_instant(wanted_at, scene, 0.5 * (now + end), 0.0, step)
    return step


@kernel
def _decide(scene: Any) -> float:
    """Command for the vehicle in the coming cycle, m/s2.

    The cycle is split at the instant at which the lane change begins, or the wanted acceleration
    jumps. In each part, the acceleration that is wanted in its middle counts.
    """
    own, step, vehicle = scene.own, scene.scenario.step, scene.scenario.vehicle
    split = _split_at(scene, step)
    gained, rest = 0.0, step  # speed gained so far, m/s; rest of the cycle, s
    if split >= step:
        wanted = _decide_at(scene, 0.5 * step)
    else:
        if split > 0.0:
            before = max(wanted_at(scene, 0.5 * split), -vehicle.max_deceleration)
            gained, rest = gained_towards(own.pedals, before, split, vehicle), step - split
        _decide_at(scene, split)  # this decision holds for the rest of the cycle
        wanted = wanted_at(scene, 0.5 * (split + step))
    gained += gained_towards(own.pedals, max(wanted, -vehicle.max_deceleration), rest, vehicle)
    return pedal_command(own.pedals, scene.me.speed, gained, vehicle, step)


@kernel
def lane_changer(
    ego: Any, others: Any, own: Any, watched: Any, others_then: Any, scenario: Any
) -> None:
    """Write acceleration and steering wheel angle of the ego: the acceleration is decided once a
    cycle, the steering follows the decided path in every step.

    While passing, the rule may brake in every other cycle: once clear of the lead it stops
    following and speeds up, which may make it less than clear.

    scenario: two records; the step of the first is the simulation's, that of the second a cycle.
    """
    me = ego.seen
    if own.steps == 0:
        own.desired_speed = me.speed
    if decides(own, scenario):
        for j in range(len(others)):
            sight(watched[j].sighting, others[j], scenario[1].step)
        own.commanded = _decide(Scene(me, own, watched, others_then, ego.way, scenario[1]))
    y, slope, bend = path_at(own.decided.path, rear_axle_next(me, scenario[0]))
    ego.command.acceleration = own.commanded
    ego.command.steering = steering(own.decided, me, y, slope, bend, scenario[0])


class LaneChanger(Compiled):
    """ADS `lane_changer`: overtakes a lead that is at least 2 m/s slower than the ego was at the
    start, by one smooth lane change, and stays in the left lane.

    The change begins at 10 s TTC or 2.5 s headway (the medians of recorded drivers, DLR-HT 2024).
    It takes 8 s, or less where the ego would not be clear of the lead in time, but not less than a
    lateral acceleration of 2 m/s2 allows (3.2 s). In danger, where braking alone would need over
    80 % of the brakes, it allows 4 m/s2 across (2.25 s). The left lane must be free: see
    `sumo_eval.ads.overtaking`. An ego that cannot change follows by the enhanced IDM. It sees a
    hidden vehicle once nothing covers any of it.
    """

    loop = each_row(lane_changer)
    memory: ClassVar = [
        ("decided", OVERTAKING), ("tried", OVERTAKING), ("pedals", PEDALS), ("then", MOVER),
        *fields("desired_speed", "commanded"), *flags("steps"),
    ]  # fmt: skip
    """decided: its decision, by which it drives.
    tried: its decision at some instant of the cycle.
    then: the ego at that instant, as foreseen.
    desired_speed: speed at the start, m/s.
    commanded: acceleration in this cycle, m/s2.
    steps: number of steps so far.
    """
    watched: ClassVar = [*WATCHED, *fields("kept"), *SIGHTED]
    """`WATCHED`: memory of an actor for `tried`. kept: headway that `decided` accepts, s."""
    numbers: ClassVar = [("idm", PARAMETERS), ("habits", HABITS)]

    def __init__(
        self,
        habits: OvertakingHabits | Mapping[str, Any] = SMOOTH,
        parameters: IdmParameters | Mapping[str, float] | None = None,
    ) -> None:
        self.habits = habits if isinstance(habits, OvertakingHabits) else replace(SMOOTH, **habits)
        self.idm = IdmParameters.of(parameters)
