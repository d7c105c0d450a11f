"""One step of every row: vehicles move, scripts continue, bodies touch, cases end.

Map: where the vehicle model moves the ego, and where contact is found. Frame: along and across the
road's line, where actors' scripts and the ends of cases are defined. On a straight road frame and
map are the same numbers.

The order of operations decides the last bits of recorded values: keep it.

`cosim/world.py` runs the functions marked `@rows`: in every step `move_rows` before SUMO's step,
`see_rows` after it. `cosim/loop.py` runs `stop_rows` where a step is broken off. Kernels of other
files call `show_body` and `first_of`.

Users: `cosim/compiled.py`, `cosim/loop.py`, `cosim/world.py`,
`drivers/synthetic/driver.py`, `record/loops.py`.
"""

import math
from typing import Any

from sumo_eval.cosim.impossible import (
    FARTHEST,
    FASTEST,
    JUMP_TOLERANCE,
    LIMIT_TOLERANCE,
    LOSS_MARGIN,
    LOWEST_SPEED,
)
from sumo_eval.cosim.records import (
    ADS_ERROR,
    ALONG,
    ALONG_A_BEND,
    CONTACT,
    DECIDED,
    DEGREES,
    LEFT_TO_SUMO,
    MODEL,
    NOT_SENT,
    OFF_ROAD,
    OFF_SCRIPT,
    PLANT,
    ROAD_END,
    SAME_TIME,
    SCRIPT_TOLERANCE,
    SENT,
    STANDSTILL,
    STRAIGHT,
    SUMO,
    TIME_LIMIT,
    Scenes,
)
from sumo_eval.cosim.vehicle_model import GRAVITY, count_clip, move, move_dynamic
from sumo_eval.kernels import Records, kernel, rows
from sumo_eval.scenario.played import BEGUN, Cast, play_actor
from sumo_eval.scenario.road.lanes import left_edge_at, right_edge_at
from sumo_eval.scenario.road.reference_line import line_at, to_frame, to_map
from sumo_eval.scenario.touch import (
    between,
    body_of,
    keeps_apart,
    share_at_touch,
    velocity,
    within_a_turn,
)
from sumo_eval.trajectory import FloatArray

# -- what rules see --------------------------------------------------------------------------------


@kernel
def show_body(mover: Any, body: Any, line: Any, rear: float) -> None:
    """Write into `mover` what rules see of a vehicle: its centre, its speeds and half extents along
    and across the road.

    line: knots of the road's line; none: it is straight.
    rear: m from the centre back to the axle that follows the lane. In a curve a body that keeps its
        lane points out of the curve, by atan(rear * curvature) from the lane at its centre. The
        extents leave this angle out: such a body is as wide as on a straight road.
    """
    curvature = line_at(line, body.x).curvature
    # inner: m driven at the offset y for each metre of the line
    inner, speed = 1.0 - curvature * body.y, body.speed
    length, width = body.length, body.width
    heading = 0.0 if abs(body.heading) < ALONG else within_a_turn(body.heading)
    mover.x, mover.y, mover.heading = body.x, body.y, heading
    mover.speed = speed
    mover.braking = 0.0  # only a rule that predicts braking writes another value, into its copy
    mover.along, mover.across = speed * math.cos(heading) / inner, speed * math.sin(heading)
    mover.curvature = curvature / inner
    # angle from the heading of a body that keeps its lane
    lean = heading + math.atan(rear * mover.curvature)
    c, s = abs(math.cos(lean)), abs(math.sin(lean))
    if s < ALONG:  # rounding; so small an angle equals its sine
        c, s = 1.0, 0.0
    mover.half_length = 0.5 * (length * c + width * s)
    mover.half_width = 0.5 * (length * s + width * c)


@kernel
def put_on_map(body: Any, line: Any) -> float:
    """Write a vehicle's place and front bumper on the map, from its place in the frame; return the
    metres that it drives for each metre of the line.
    """
    at, pose = body.map, to_map(line, body.x, body.y, body.heading)
    at.x, at.y, at.heading = pose[:3]
    _put_front(body)
    return float(1.0 - pose[3] * body.y)


@kernel
def _restate(to: Any, source: Any) -> None:
    """Copy a vehicle's motion: from now to before the step, or back."""
    to.x, to.y, to.heading = source.x, source.y, source.heading
    to.speed, to.across, to.acceleration = source.speed, source.across, source.acceleration
    to.map.x, to.map.y, to.map.heading = source.map.x, source.map.y, source.map.heading


@kernel
def _put_front(body: Any) -> None:
    """Write the centre of a vehicle's front bumper on the map."""
    body.front_x = body.map.x + 0.5 * body.length * math.cos(body.map.heading)
    body.front_y = body.map.y + 0.5 * body.length * math.sin(body.map.heading)


@kernel
def _tell(tell: Any, count: int, number: int, body: Any, line: Any, along: float) -> int:
    """Append a vehicle's row to `tell`, as in `move_rows`; return the new number of rows.

    count: rows of `tell` so far.
    number: of the vehicle, as in `tell`.
    along: dx/dt, m/s.
    """
    near = body.x + 0.5 * body.length  # m, near its front: where the search along the line begins
    s, d = to_frame(line, body.front_x, body.front_y, body.map.heading, near)[:2]
    angle = STRAIGHT - body.map.heading * DEGREES
    tell[count] = float(number), body.front_x, body.front_y, angle, body.speed, s, d, along
    return count + 1


@kernel
def first_of(scenario: Any, row: int) -> int:
    """Index of a row's first `SCENARIO` record; the second follows it.

    Two records serve all rows; where cases change the vehicle, each row has two of its own.
    """
    return 2 * row if len(scenario) > 2 else 0


# -- samples ---------------------------------------------------------------------------------------


@kernel
def _sample(samples: Any, vehicle: Any, time: float, acceleration: float, steering: float) -> None:
    """Record a vehicle as it is now, unless there is a sample of this instant.

    samples: (instants, channels), in the order of `trajectory.CHANNELS`.
    """
    count = vehicle.samples
    if count > 0 and time - samples[count - 1, 0] < SAME_TIME:
        return
    values = time, vehicle.x, vehicle.y, vehicle.heading, vehicle.speed, acceleration, steering
    for k, value in enumerate(values):
        samples[count, k] = value
    vehicle.samples = count + 1


@kernel
def _sample_row(ego: Any, others: Any, samples: Any) -> None:
    """Record every vehicle of a case at the case's time."""
    steering = math.nan if ego.placed == SUMO else ego.steering
    _sample(samples[0], ego, ego.time, ego.acceleration, steering)
    for j in range(len(others)):
        if others[j].present:
            _sample(samples[1 + j], others[j], ego.time, others[j].acceleration, math.nan)


@rows
def begin_rows(cast: Cast, seen: Records, samples: FloatArray, scenario: Records) -> None:
    """Show and record every vehicle at its start."""
    egos, others, line = cast.egos, cast.others, cast.line
    for i in range(len(egos)):
        ego = egos[i]
        put_on_map(ego, line)
        _restate(ego.before, ego)
        for j in range(len(others[i])):
            other = others[i, j]
            play_actor(cast, i, j, 0.0)
            put_on_map(other, line)
            _restate(other.before, other)
        _show_row(ego, others[i], seen[i], line, scenario[0].vehicle)
        _sample_row(ego, others[i], samples[i])


@rows
def stop_rows(egos: Records, others: Records, samples: FloatArray, back: int) -> None:
    """Record a case that is alone where an error or SUMO has broken it off.

    back: not 0 within a step, which does not count: its vehicles return to the step's start.
    """
    ego, actors = egos[0], others[0]
    if back:
        _restate(ego, ego.before)
        ego.steering = ego.before.steering
        for j in range(len(actors)):
            _restate(actors[j], actors[j].before)
    _sample_row(ego, actors, samples[0])


# -- one step, before and after SUMO's -------------------------------------------------------------


@rows
def move_rows(
    cast: Cast, clips: Records, tell: FloatArray, scenario: Records, steps: int, to_sumo: int
) -> int:
    """Move all vehicles by one step; return how many rows of `tell` there are.

    tell: receives what is to be sent to SUMO, a row for each vehicle, (rows, 8). 0: the vehicle's
        number (row by row, each ego first). 1, 2: x and y of the front bumper's centre on the map,
        m. 3: SUMO's angle, deg. 4: speed, m/s. 5, 6: the front bumper along and across the road,
        m. 7: dx/dt, m/s.
    steps: of the world, this one included.
    to_sumo: 0: SUMO receives nothing, 1: all, 2: egos, and actors that it cannot move by itself.
    """
    count = _move_egos(cast, clips, tell, scenario, to_sumo)
    return _move_actors(cast, tell, scenario, steps, count, to_sumo)


@kernel
def _move_egos(
    cast: Cast, clips: Records, tell: FloatArray, scenario: Records, to_sumo: int
) -> int:
    """Move the egos by one step; return how many rows of `tell` there are.

    Copies the motion of egos and actors to `before`, except of actors whose ego's command is
    refused. SUMO receives only egos that are `stale`.
    """
    count = 0
    egos, others, step = cast.egos, cast.others, scenario[0].step
    for i in range(len(egos)):
        ego = egos[i]
        if ego.live == 0 or ego.reason != 0:
            continue
        _restate(ego.before, ego)
        ego.before.steering = ego.steering
        _move_on_map(ego, scenario[first_of(scenario, i)].vehicle, step, clips[i])
        if ego.reason != 0:
            continue
        if ego.placed != SUMO:
            curvature = _place_in_frame(ego, cast.line, step)
            if to_sumo and ego.stale:
                ego.stale = 0
                along = ego.speed * math.cos(ego.heading) / (1.0 - curvature * ego.y)
                count = _tell(tell, count, i * (1 + len(others[i])), ego, cast.line, along)
        for j in range(len(others[i])):
            other = others[i, j]
            _restate(other.before, other)
            other.told = LEFT_TO_SUMO
    return count


@kernel
def _move_on_map(ego: Any, limits: Any, step: float, clips: Any) -> None:
    """Move an ego by its vehicle model as commanded, or as its plant says; end a case whose command
    is not finite.

    clips: as of `move`.
    """
    at = ego.map
    if ego.placed == MODEL:
        wanted, steering = ego.command.acceleration, ego.command.steering
        if not (math.isfinite(wanted) and math.isfinite(steering)):
            ego.reason = ADS_ERROR
        elif limits.dynamic > 0.0:
            move_dynamic(ego, at, wanted, steering, limits, step, clips)
        else:
            move(ego, at, wanted, steering, limits, step, clips)
    elif ego.placed == PLANT:
        state = ego.next
        at.x, at.y, at.heading = state.x, state.y, state.heading
        ego.speed, ego.acceleration, ego.steering = state.speed, state.acceleration, state.steering


@kernel
def _place_in_frame(ego: Any, line: Any, step: float) -> float:
    """Write an ego's place in the frame, and its front bumper, from its place on the map; return
    the curvature of the road's line there, 1/m.
    """
    before = ego.before
    near = before.x + before.speed * step  # where the search along the line begins
    pose = to_frame(line, ego.map.x, ego.map.y, ego.map.heading, near)
    ego.x, ego.y, ego.heading = pose[:3]
    _put_front(ego)
    # SUMO continues a straight motion at one speed by itself, but not along a curve
    turned = ego.heading != 0.0 or before.heading != 0.0
    if len(line) or turned or ego.speed != before.speed:
        ego.stale = 1
    return float(pose[3])


@kernel
def goes_straight(
    ahead: float, aside: float, speed: float, first_speed: float, step: float, vehicle: Any
) -> bool:
    """Whether an ego drove straight on, by as much as its speeds allow.

    ahead, aside: its motion along and across the road in the step, m.
    speed, first_speed: at the step's end and start, m/s.
    """
    acceleration, half = (speed - first_speed) / step, 0.5 * step
    # off: m by which the ego drove more or less than at the mean of both speeds. most: what that
    # would be if it had driven the whole step at one of them.
    off = abs(ahead - half * (speed + first_speed))
    most = half * abs(speed - first_speed) + JUMP_TOLERANCE
    grip = vehicle.friction * GRAVITY
    # strictly within the limits: at a limit, SUMO may have held the ego back
    return (
        aside == 0.0
        and off <= most
        and LOWEST_SPEED < speed < FASTEST
        and LIMIT_TOLERANCE - min(vehicle.max_deceleration, grip) <= acceleration
        and acceleration <= min(vehicle.max_acceleration, grip) - LIMIT_TOLERANCE
    )


@kernel
def _goes_along(ego: Any, shown: FloatArray, road: Any) -> bool:
    """Whether SUMO moved an ego along a straight road, and on it, not for the first time.

    shown: as of `_read_ego`.
    """
    along = ego.map.heading == 0.0 and shown[2] == STRAIGHT and road.bent == 0
    again = ego.placed == SUMO and ego.stale == 0  # stale: SUMO moves it for the first time
    return bool(along and again and road.right_edge <= shown[1] <= road.left_edge)


@kernel
def _read_ego(ego: Any, shown: FloatArray, scenario: Any) -> bool:
    """Take in an ego from SUMO if it drove straight on along a lane; return whether it did.

    shown: x and y of its front bumper, m, angle, deg, and speed, m/s.
    """
    if not _goes_along(ego, shown, scenario.road):
        return False
    at, step = ego.map, scenario.step
    # of its centre: the ego points along the road, so its bumper has the same y
    x, y = shown[0] - 0.5 * ego.length, shown[1]
    speed, first_speed = shown[3], ego.next.speed  # SUMO showed the first one a step ago
    if not goes_straight(x - at.x, y - at.y, speed, first_speed, step, scenario.vehicle):
        return False
    ego.x = x
    at.x = x
    ego.heading = 0.0
    ego.speed, ego.next.speed, ego.acceleration = speed, speed, (speed - first_speed) / step
    return True


@kernel
def _read_actor(last: FloatArray, shown: FloatArray) -> bool:
    """Take in an actor from SUMO, unless its motion is impossible; return whether it was possible.

    last: receives `shown`; holds what SUMO showed a step ago.
    shown: as of `_read_ego`.
    """
    near = abs(shown[0] - last[0]) < FARTHEST and abs(shown[1] - last[1]) < FARTHEST
    if not (near and 0.0 <= shown[2] <= 360.0 and LOWEST_SPEED < shown[3] < FASTEST):
        return False
    for k in range(4):
        last[k] = shown[k]
    return True


@rows
def read_rows(
    egos: Records, last: FloatArray, scenario: Records, numbers: Any, read: FloatArray, odd: Any
) -> int:
    """Take in vehicles as SUMO shows them; return how many remain to be read one by one.

    These are egos that `_read_ego` does not take in, such as all that SUMO does not move, and
    actors whose motion is impossible.

    last: of each actor, as of `_read_actor`, (n, m, 4).
    numbers: of the vehicles, as in `tell` of `move_rows`.
    read: what SUMO shows of each, as `shown` of `_read_ego`, (k, 4).
    odd: receives the numbers of the vehicles that remain.
    """
    remaining = 0
    width = 1 + last.shape[1]  # vehicles of a row
    for k, number in enumerate(numbers):
        row, j = number // width, number % width
        if j > 0:
            is_read = _read_actor(last[row, j - 1], read[k])
        else:
            is_read = _read_ego(egos[row], read[k], scenario[first_of(scenario, row)])
        if not is_read:
            odd[remaining] = number
            remaining += 1
    return remaining


@kernel
def _on_lanes(body: Any, road: Any, end: float) -> bool:
    """Whether SUMO has a lane for a vehicle.

    Beside a straight road SUMO shows other places than it received; beside a curved one the
    tolerance of the comparison (`session.bend_tolerance`) allows for that.

    end: of the last lane, m, less `LOSS_MARGIN`.
    """
    half, reach = 0.5 * body.length, 0.5 * body.width - LOSS_MARGIN
    if not (body.x - half >= 0.0 and body.x + half < end):
        return False
    y = body.front_y
    return bool(road.bent) or not (y <= road.right_edge - reach or y >= road.left_edge + reach)


@rows
def received_rows(cast: Cast, scenario: Records, end: float, received: FloatArray) -> int:
    """Write the vehicles that SUMO received in this step and has a lane for; return how many.

    end: of the last lane, m, less `LOSS_MARGIN`.
    received: a row a vehicle: its number as in `move_rows`, x and y of its front bumper's centre on
        the map, its centre's y across the road.
    """
    egos, others, road = cast.egos, cast.others, scenario[0].road
    count = 0
    for i in range(len(egos)):
        ego, number = egos[i], i * (1 + len(others[i]))
        if ego.live == 0 or ego.reason != 0:
            continue
        if ego.placed != SUMO and _on_lanes(ego, road, end):
            received[count] = float(number), ego.front_x, ego.front_y, ego.y
            count += 1
        for j in range(len(others[i])):
            it = others[i, j]
            if it.told == SENT and it.present == 1 and _on_lanes(it, road, end):
                received[count] = float(number + 1 + j), it.front_x, it.front_y, it.y
                count += 1
    return count


@kernel
def _stand(other: Any, shown: FloatArray, line: Any) -> None:
    """Put an actor where SUMO shows it.

    shown: as of `_read_ego`.
    """
    half, at, angle = 0.5 * other.length, other.map, shown[2]
    at.heading = within_a_turn((STRAIGHT - angle) / DEGREES) if angle != STRAIGHT else 0.0
    at.x, at.y = shown[0] - half * math.cos(at.heading), shown[1] - half * math.sin(at.heading)
    other.x, other.y, other.heading = to_frame(line, at.x, at.y, at.heading, other.x)[:3]
    other.speed = shown[3]


@kernel
def _go_back(body: Any, share: float) -> None:
    """Put a vehicle where it was when a share of the step had passed."""
    was, at = body.before, body.map
    # `body_of` takes a pose (on the map, then in the frame), the speeds of that time, and the size
    on_map = between(body_of(was.map, was, body), body_of(at, body, body), share)
    at.x, at.y, at.heading = on_map.x, on_map.y, on_map.heading
    in_frame = between(body_of(was, was, body), body_of(body, body, body), share)
    body.x, body.y, body.heading = in_frame.x, in_frame.y, in_frame.heading
    body.speed, body.across = in_frame.speed, in_frame.across


@kernel
def _end(ego: Any, others: Any, scenario: Any, now: float) -> int:
    """Reason why a case ends, as in `records.REASONS`; 0: it continues."""
    road = scenario.road
    ego.stood = ego.stood + scenario.step if ego.speed < scenario.standstill_speed else 0.0
    if not right_edge_at(road, ego.x) <= ego.y <= left_edge_at(road, ego.x):
        return OFF_ROAD
    if ego.x >= road.length:
        return ROAD_END
    if ego.stood >= scenario.standstill_time - SAME_TIME:
        return STANDSTILL
    if now >= scenario.time_limit - SAME_TIME:
        return TIME_LIMIT
    # decided: the ego keeps its motion, and no vehicle that also does would touch it
    if scenario.end_when_decided == 0 or ego.settled == 0 or ego.acceleration != 0.0:
        return 0
    if abs(ego.heading) > (ALONG_A_BEND if road.bent else 0.0):
        return 0
    if now < ego.scripted_until or ego.way.asked:  # scripts or a lane change to come
        return 0
    body = body_of(ego, ego, ego)
    for j in range(len(others)):
        other = others[j]
        if other.present and not keeps_apart(body, body_of(other, other, other)):
            return 0
    return DECIDED


@kernel
def _keep(numbers: FloatArray, ego: Any) -> None:
    """Keep what moved an ego in a step: `cosim/no_return.py` replays it.

    numbers: receives the command, 2 numbers, or the motion, 7, as `commands` of `Scenes`.
    """
    command, at = ego.command, ego.map
    if len(numbers) == 2:
        numbers[0], numbers[1] = command.acceleration, command.steering
        return
    # also the heading at the step's start: between two steps `corner` may turn an ego
    first = ego.before.map.heading
    values = first, at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering
    for k, value in enumerate(values):
        numbers[k] = value


@rows
def see_rows(
    scenes: Scenes, scenario: Records, line: Records, steps: int, sampling: int, as_read: int
) -> int:
    """Finish a step after SUMO's: positions, contact, ends, samples, what rules see next; return
    how many cases have ended.

    Of several reasons the first in this order wins: the reason that a row already has; contact,
    unless the ego is then beyond the road's length; the reasons of `_end`, as it tests them. The
    numbers of `records.REASONS` have another order.

    line: knots of the road's line; none: it is straight.
    steps: of the world, this one included.
    sampling: not 0 if this step is recorded.
    as_read: not 0 if the actors are where SUMO shows them, not where their scripts put them.
    """
    egos, others, seen = scenes.egos, scenes.others, scenes.seen
    samples, commands = scenes.samples, scenes.commands
    ended = 0
    step = scenario[0].step
    for i in range(len(egos)):
        ego = egos[i]
        if ego.live == 0:
            continue
        if ego.reason != 0:  # broken off in this step
            _sample_row(ego, others[i], samples[i])
            ended += 1
            continue
        # false only in `EpisodeRows`, which steps without end and never reads `commands`
        if steps <= commands.shape[1]:
            _keep(commands[i, steps - 1], ego)
        now = (steps - ego.begun) * step
        if as_read:
            _stand_row(ego, others[i], scenes.shown[i], scenes.clips[i], line, now, sampling)
        share = _first_touch(ego, others[i], step)
        # a touch beyond `length` does not count: the case ends there
        touched_at = ego.before.x + share * (ego.x - ego.before.x)
        if share <= 1.0 and not touched_at > scenario[0].road.length:
            ego.reason, ego.share = CONTACT, share
            _go_back(ego, share)
            ego.time = now - step + share * step
            for j in range(len(others[i])):
                _go_back(others[i, j], share)
        else:
            ego.time = now
            ego.reason = _end(ego, others[i], scenario[0], now)
            _show_row(ego, others[i], seen[i], line, scenario[0].vehicle)
        if sampling or ego.reason != 0:
            _sample_row(ego, others[i], samples[i])
        if ego.reason != 0:
            ended += 1
    return ended


@kernel
def _stand_row(
    ego: Any, others: Any, shown: FloatArray, clips: Any, line: Any, now: float, sampling: int
) -> None:
    """Put the actors of a row where SUMO shows them, and count those that are off their scripts.

    shown: of each actor, as of `_read_ego`.
    now: time of the case, s. sampling: as of `see_rows`.
    """
    for j in range(len(others)):
        other, at = others[j], shown[j]
        if other.present == 0:
            continue
        ahead, left = at[0] - other.front_x, at[1] - other.front_y
        off = math.sqrt(ahead * ahead + left * left)
        # `scripted_until` is inf of `lively` scenarios: SUMO's models may drive their actors, so no
        # script gives a place to compare with
        if sampling and off > SCRIPT_TOLERANCE and ego.scripted_until < math.inf:
            count_clip(clips, OFF_SCRIPT, now, 0.0, off)
        _stand(other, at, line)


@kernel
def _first_touch(ego: Any, others: Any, step: float) -> float:
    """Share of the step that had passed when the ego first touched an actor, its `struck`; above 1:
    it touched none. Also writes the actors' `rate`.
    """
    before, body = body_of(ego.before.map, ego.before, ego), body_of(ego.map, ego, ego)
    first = 2.0
    for j in range(len(others)):
        other = others[j]
        if other.present == 0:
            continue
        was = other.before
        other.rate = (other.speed - was.speed) / step
        share = share_at_touch(
            before, body, body_of(was.map, was, other), body_of(other.map, other, other)
        )
        # below 0: they do not touch
        if 0.0 <= share < first:
            first, ego.struck = share, j
    return first


@kernel
def _show_row(ego: Any, others: Any, seen: Any, line: Any, vehicle: Any) -> None:
    """Write what rules see of the vehicles of a row."""
    show_body(ego.seen, ego, line, 0.5 * vehicle.wheelbase)
    for j in range(len(others)):
        show_body(seen[j], others[j], line, 0.0)
        if others[j].present == 0:
            seen[j].x = math.nan


@kernel
def _at_work(other: Any, play: Any, acts: Any, now: float, scenario: Any) -> bool:
    """Whether SUMO cannot move an actor by itself: it carries out an act, is turned from the road's
    direction, or has been beside the lanes once.
    """
    road, reach = scenario.road, 0.5 * other.width - LOSS_MARGIN
    if not road.right_edge - reach <= other.y <= road.left_edge + reach:
        other.strays = 1
    if other.strays or other.heading != 0.0:
        return True
    for q in range(play.acts):  # noqa: SIM110 - kernels have no generators
        if acts[q].state == BEGUN and acts[q].begin < now < acts[q].end + scenario.step:
            return True
    return False


@kernel
def _move_actors(
    cast: Cast, tell: FloatArray, scenario: Records, steps: int, count: int, to_sumo: int
) -> int:
    """Move the actors by one step of their scripts, and append their rows to `tell`; return the new
    number of rows.

    Also writes their `told`, as in `records.OTHER`.

    count: rows of `tell` so far.
    """
    egos, others = cast.egos, cast.others
    plays, acts = cast.plays, cast.acts
    for i in range(len(egos)):
        if egos[i].live == 0 or egos[i].reason != 0:
            continue
        now = (steps - egos[i].begun) * scenario[0].step
        for j in range(len(others[i])):
            other, play = others[i, j], plays[i, j]
            play_actor(cast, i, j, now)
            other.told = NOT_SENT
            if play.model or other.present == 0:
                continue
            inner = put_on_map(other, cast.line)
            if to_sumo == 2 and not _at_work(other, play, acts[i, j], now, scenario[0]):
                other.told = LEFT_TO_SUMO
            elif to_sumo:
                other.told = SENT
                along = velocity(other)[0] / inner
                count = _tell(
                    tell, count, i * (1 + len(others[i])) + 1 + j, other, cast.line, along
                )
    return count


@rows
def map_rows(others: Records, line: Records) -> None:
    """Put all actors on the map, without a step."""
    for i in range(len(others)):
        for j in range(len(others[i])):
            put_on_map(others[i, j], line)
