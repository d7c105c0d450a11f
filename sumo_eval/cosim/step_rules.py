"""What happens in a step, one row after the other: vehicles move, scripts go on, bodies touch, cases end.

On a straight road frame and map are the same numbers, and nobody looks at the map. On one that bends the vehicle model
moves the ego on the map, and contact is judged there.
"""

from __future__ import annotations

import math
from typing import Any

from sumo_eval.cosim.contact import Body, between, keeps_apart, share_at_touch, within_a_turn
from sumo_eval.cosim.records import (
    ADS_ERROR,
    ALONG,
    ALONG_A_BEND,
    CONTACT,
    DECIDED,
    DEGREES,
    MODEL,
    OFF_ROAD,
    OFF_SCRIPT,
    PLANT,
    ROAD_END,
    ROUNDING,
    SCRIPT_TOLERANCE,
    STANDSTILL,
    STRAIGHT,
    SUMO,
    TIME_LIMIT,
    Records,
)
from sumo_eval.cosim.sumo.session import NOWHERE
from sumo_eval.cosim.vehicle_model import count_clip, moved, moved_dynamic
from sumo_eval.kernels import kernel, rows
from sumo_eval.scenario.motion import (
    along_heading,
    braked_distance_at,
    braked_speed_at,
    braking_acceleration,
    lateral,
    lateral_acceleration,
    lateral_speed,
)
from sumo_eval.scenario.road.lanes import left_edge_at, right_edge_at
from sumo_eval.scenario.road.reference_line import line_at, to_frame, to_map
from sumo_eval.trajectory import FloatArray

# -- what rules see ----------------------------------------------------------------------------------------------------


@kernel
def show(mover: Any, x: float, y: float, heading: float, speed: float, length: float, width: float) -> None:
    """Write into `mover` what a sensor shows of a body: its centre, its speeds and extents by the road's axes."""
    half_length, half_width = 0.5 * length, 0.5 * width
    mover.x, mover.y, mover.speed, mover.braking, mover.curvature = x, y, speed, 0.0, 0.0
    if abs(heading) < ALONG:
        mover.heading, mover.along, mover.across = 0.0, speed, 0.0
        mover.half_length, mover.half_width = half_length, half_width
        return
    heading = within_a_turn(heading)
    c, s = math.cos(heading), math.sin(heading)
    mover.heading, mover.along, mover.across = heading, speed * c, speed * s
    mover.half_length = half_length * abs(c) + half_width * abs(s)
    mover.half_width = half_length * abs(s) + half_width * abs(c)


@kernel
def show_bend(mover: Any, length: float, width: float, line: Any, rear: float) -> None:
    """Add to what `show` has written what the road's bend is to it. line: the road's, of no knots if straight.

    rear: m from the centre back to the axle that runs along the lane. A body that follows a bend leans out of it there
    by atan(rear * curvature), which takes no more of the road from others than on a straight.
    """
    if len(line):
        _, _, _, curvature = line_at(line, mover.x)
        inner = 1.0 - curvature * mover.y
        mover.along, mover.curvature = mover.along / inner, curvature / inner
        lean = mover.heading + math.atan(rear * mover.curvature)
        c, s = abs(math.cos(lean)), abs(math.sin(lean))
        if s < ALONG:
            c, s = 1.0, 0.0
        mover.half_length, mover.half_width = 0.5 * (length * c + width * s), 0.5 * (length * s + width * c)


@kernel
def show_body(mover: Any, body: Any, line: Any, rear: float) -> None:
    """Write into `mover` what a sensor shows of a vehicle. line, rear: as in `show_bend`."""
    show(mover, body.x, body.y, body.heading, body.speed, body.length, body.width)
    show_bend(mover, body.length, body.width, line, rear)


@kernel
def put_on_map(body: Any, line: Any) -> float:
    """Put a vehicle of which the frame is known on the map; the share of a metre along the line that it drives there
    for each metre of the line.
    """
    at = body.map
    at.x, at.y, at.heading, curvature = to_map(line, body.x, body.y, body.heading)
    return float(1.0 - curvature * body.y)


@kernel
def find_in_frame(body: Any, line: Any, near: float) -> None:
    """Find a vehicle of which the place on the map is known in the frame. near: about its x there, m."""
    at = body.map
    body.x, body.y, body.heading, _ = to_frame(line, at.x, at.y, at.heading, near)


@kernel
def _keep_map(body: Any) -> None:
    was, at = body.before.map, body.map
    was.x, was.y, was.heading = at.x, at.y, at.heading


@kernel
def _map_body(at: Any, speed: float, across: float, body: Any) -> Body:
    """A vehicle on the map. at: its place there."""
    return Body(at.x, at.y, at.heading, speed, body.length, body.width, across)


@kernel
def _put_front(body: Any, at: Any) -> None:
    """The centre of a vehicle's front bumper. at: what holds its place on the map."""
    body.front_x = at.x + 0.5 * body.length * math.cos(at.heading)
    body.front_y = at.y + 0.5 * body.length * math.sin(at.heading)


@kernel
def _tell(tell: Any, told: int, number: int, body: Any, at: Any) -> None:
    """Write what SUMO hears of a vehicle into a row of `tell`. at: what holds its place on the map."""
    tell[told, 0] = number
    tell[told, 1] = body.front_x
    tell[told, 2] = body.front_y
    tell[told, 3] = STRAIGHT - at.heading * DEGREES
    tell[told, 4] = body.speed


@kernel
def _tell_on_bend(tell: Any, told: int, number: int, body: Any, line: Any, along: float) -> None:
    """Write what SUMO hears of a vehicle on a bend into a row of `tell`. along: dx/dt, m/s."""
    _put_front(body, body.map)
    _tell(tell, told, number, body, body.map)
    s, d, _, _ = to_frame(line, body.front_x, body.front_y, body.map.heading, body.x + 0.5 * body.length)
    tell[told, 5] = s
    tell[told, 6] = d
    tell[told, 7] = along


# -- scripts -----------------------------------------------------------------------------------------------------------


@kernel
def _is_scripted(other: Any, moves: Any, time: float, step: float) -> bool:
    """Whether the harness moves it at a time; straight on at constant speed, or standing, SUMO does."""
    if time > other.leaves:
        return True
    if not other.script_begin < time < other.script_end:
        return False
    for q in range(other.moves):
        if moves[q].begin < time < moves[q].begin + moves[q].duration + step:
            return True
    return bool(other.brakes and other.brake.begin < time < other.brake.end + step)


@kernel
def _script_x(other: Any, time: float) -> float:
    if other.brakes:
        return float(other.start.x + braked_distance_at(other.brake, other.start.speed, time))
    return float(other.start.x + other.start.speed * time)


@kernel
def _script_y(other: Any, moves: Any, time: float) -> float:
    covered = 0.0
    for q in range(other.moves):
        covered += lateral(moves[q], time)
    return float(other.start.y + covered)


@kernel
def _script_speed(other: Any, time: float) -> float:
    return braked_speed_at(other.brake, other.start.speed, time) if other.brakes else float(other.start.speed)


@kernel
def _script_across(other: Any, moves: Any, time: float) -> float:
    speed = 0.0
    for q in range(other.moves):
        speed += lateral_speed(moves[q], time)
    return speed


@kernel
def _script_acceleration(other: Any, moves: Any, time: float) -> float:
    """Acceleration of another vehicle along its heading as its script has it at a time, m/s2."""
    if not other.script_begin <= time <= other.script_end:
        return 0.0
    braking = braking_acceleration(other.brake, other.start.speed, time) if other.brakes else 0.0
    if other.slides or other.moves == 0:
        return braking
    sideways = 0.0
    for q in range(other.moves):
        sideways += lateral_acceleration(moves[q], time)
    return along_heading(_script_speed(other, time), _script_across(other, moves, time), braking, sideways)


# -- samples -----------------------------------------------------------------------------------------------------------


@kernel
def _sample(samples: Any, vehicle: Any, time: float, acceleration: float, steering: float) -> None:
    """Record a vehicle as it is now, unless it has been at this instant. samples: (instants, channels)."""
    count = vehicle.samples
    if count > 0 and time - samples[count - 1, 0] < 1e-9:
        return
    samples[count, 0] = time
    samples[count, 1] = vehicle.x
    samples[count, 2] = vehicle.y
    samples[count, 3] = vehicle.heading
    samples[count, 4] = vehicle.speed
    samples[count, 5] = acceleration
    samples[count, 6] = steering
    vehicle.samples = count + 1


@kernel
def _sample_row(ego: Any, others: Any, moves: Any, samples: Any) -> None:
    """Record every vehicle of a case at its time."""
    _sample(samples[0], ego, ego.time, ego.acceleration, math.nan if ego.placed == SUMO else ego.steering)
    for j in range(len(others)):
        if others[j].present:
            acceleration = others[j].acceleration
            if others[j].played == 0:
                acceleration = _script_acceleration(others[j], moves[j], ego.time)
            _sample(samples[1 + j], others[j], ego.time, acceleration, math.nan)


@rows
def begin_rows(
    egos: Records, others: Records, moves: Records, seen: Records, samples: FloatArray, scenario: Records,
    line: Records,
) -> None:  # fmt: skip
    """Show and record every vehicle at its start."""
    for i in range(len(egos)):
        ego = egos[i]
        if len(line):
            put_on_map(ego, line)
            _keep_map(ego)
        show_body(ego.seen, ego, line, 0.5 * scenario[0].vehicle.wheelbase)
        for j in range(len(others[i])):
            other = others[i][j]
            if len(line):
                put_on_map(other, line)
                _keep_map(other)
            show_body(seen[i][j], other, line, 0.0)
        _sample_row(ego, others[i], moves[i], samples[i])


@rows
def stop_rows(egos: Records, others: Records, moves: Records, samples: FloatArray, row: int, back: int) -> None:
    """Record a case as it is when it is broken off; back: within a step, of which nothing counts."""
    ego = egos[row]
    if back:
        was = ego.before
        ego.x, ego.y, ego.heading, ego.speed = was.x, was.y, was.heading, was.speed
        ego.map.x, ego.map.y, ego.map.heading = was.map.x, was.map.y, was.map.heading
        for j in range(len(others[row])):
            other = others[row][j]
            was = other.before
            other.x, other.y, other.heading, other.speed = was.x, was.y, was.heading, was.speed
            other.across = was.across
            other.map.x, other.map.y, other.map.heading = was.map.x, was.map.y, was.map.heading
    _sample_row(ego, others[row], moves[row], samples[row])


# -- one step, before and after SUMO's ---------------------------------------------------------------------------------


@rows
def move_rows(
    egos: Records, others: Records, moves: Records, clips: Records, tell: FloatArray, scenario: Records,
    line: Records, steps: int, closely: int,
) -> int:  # fmt: skip
    """Move the egos as they are commanded and the others as their scripts say to the end of so many steps.

    What SUMO has to hear of it is written to `tell`, a row each: number of the vehicle, x and y of the front bumper's
    centre on the map, angle and speed; on a road that bends its place along and across the line and dx/dt besides.
    closely: SUMO hears of everybody; else of those that it takes over in the next step. line: the road's, of no knots
    if it is straight. Returns how many rows of `tell` there are.
    """
    told = 0
    bent = len(line) > 0
    step, limits = scenario[0].step, scenario[0].vehicle
    for i in range(len(egos)):
        ego = egos[i]
        if ego.live == 0 or ego.reason != 0:
            continue
        now = (steps - ego.begun) * step
        before = ego.before
        before.x, before.y, before.heading, before.speed = ego.x, ego.y, ego.heading, ego.speed
        if bent:
            _keep_map(ego)
        if ego.placed == MODEL:
            wanted, steering = ego.command.acceleration, ego.command.steering
            if not math.isfinite(wanted + steering):
                ego.reason = ADS_ERROR
                continue
            if bent:
                _drive(ego, ego.map, wanted, steering, limits, step, clips[i])
            else:
                _drive(ego, ego, wanted, steering, limits, step, clips[i])
        elif ego.placed == PLANT:
            if bent:
                _go_on(ego, ego.map)
            else:
                _go_on(ego, ego)
        if bent and ego.placed != SUMO:
            find_in_frame(ego, line, before.x + before.speed * step)
            if closely:
                _, _, _, curvature = line_at(line, ego.x)
                along = ego.speed * math.cos(ego.heading) / (1.0 - curvature * ego.y)
                _tell_on_bend(tell, told, i * (1 + len(others[i])), ego, line, along)
                told += 1
        elif ego.placed != SUMO:
            if ego.speed != before.speed or ego.heading != 0.0 or before.heading != 0.0:
                ego.stale = 1
            if closely and ego.stale:
                ego.stale = 0
                _put_front(ego, ego)
                _tell(tell, told, i * (1 + len(others[i])), ego, ego)
                told += 1
        for j in range(len(others[i])):
            other = others[i][j]
            last = other.before
            last.x, last.y, last.heading, last.speed = other.x, other.y, other.heading, other.speed
            last.across = other.across
            other.told = 0
            if bent:
                _keep_map(other)
            if other.present == 0 or other.played or not (bent or _is_scripted(other, moves[i][j], now, step)):
                continue
            other.told = 1
            other.x, other.y = _script_x(other, now), _script_y(other, moves[i][j], now)
            along, across = _script_speed(other, now), _script_across(other, moves[i][j], now)
            ground = along
            if bent:
                if not _is_scripted(other, moves[i][j], now, step):
                    across = 0.0  # as where SUMO drives it
                _, _, _, curvature = line_at(line, other.x)
                ground = along * (1.0 - curvature * other.y)
            if other.slides:
                other.heading, other.speed, other.across = 0.0, ground, across
            else:
                other.heading, other.across = math.atan2(across, ground), 0.0
                other.speed = math.sqrt(ground * ground + across * across)
            if bent:
                put_on_map(other, line)
                if closely or (
                    _is_scripted(other, moves[i][j], now, step)
                    and not _is_scripted(other, moves[i][j], now + step, step)
                ):
                    other.told = 2
                    _tell_on_bend(tell, told, i * (1 + len(others[i])) + 1 + j, other, line, along)
                    told += 1
                continue
            _put_front(other, other)
            if closely or not _is_scripted(other, moves[i][j], now + step, step):
                other.told = 2
                _tell(tell, told, i * (1 + len(others[i])) + 1 + j, other, other)
                told += 1
    return told


@kernel
def _drive(ego: Any, at: Any, wanted: float, steering: float, limits: Any, step: float, clips: Any) -> None:
    """Move an ego by the vehicle model. at: what holds its place on the map."""
    if limits.dynamic > 0.0:
        (
            at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering, ego.slip, ego.yaw_rate,
        ) = moved_dynamic(
            at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering, ego.slip, ego.yaw_rate, wanted, steering,
            limits, step, ego.time, clips,
        )  # fmt: skip
        return
    at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering = moved(
        at.x, at.y, at.heading, ego.speed, ego.acceleration, ego.steering, wanted, steering, limits, step, ego.time,
        clips,
    )  # fmt: skip


@kernel
def _go_on(ego: Any, at: Any) -> None:
    """Move an ego to where a plant has it next. at: what holds its place on the map."""
    ahead = ego.next
    at.x, at.y, at.heading, ego.speed = ahead.x, ahead.y, ahead.heading, ahead.speed
    ego.acceleration, ego.steering = ahead.acceleration, ahead.steering


@kernel
def _stand(other: Any, at: Any, x: float, y: float, heading: float, speed: float) -> None:
    """Put another vehicle where SUMO shows its front bumper. at: what holds its place on the map."""
    half = 0.5 * other.length
    at.x, at.y = x - half * math.cos(heading), y - half * math.sin(heading)
    at.heading, other.speed, other.across = heading, speed, 0.0


@kernel
def _place(
    other: Any, moves: Any, x: float, y: float, angle: float, speed: float, line: Any, now: float, as_read: int,
    lane_width: float,
) -> None:  # fmt: skip
    """Where another vehicle is at the end of a step: where SUMO shows its front bumper, unless its script moved it.

    as_read: SUMO's angle and speed count too, and its place in any case. Who is on a lane's centre line and has not
    moved is exactly there: on the one lane of `sumo.shared_files` SUMO shows the line and the rounding of an offset.
    """
    half = 0.5 * other.length
    if as_read:
        heading = within_a_turn((STRAIGHT - angle) / DEGREES) if angle != STRAIGHT else 0.0
        if len(line):
            _stand(other, other.map, x, y, heading, speed)
            find_in_frame(other, line, _script_x(other, now))
        else:
            _stand(other, other, x, y, heading, speed)
        if other.slides and other.script_begin <= now <= other.script_end:
            other.across = _script_across(other, moves, now)
        return
    if other.told:
        return
    other.heading, other.across, other.speed = 0.0, 0.0, _script_speed(other, now)
    if x > NOWHERE:
        other.x, other.y = x - half, y
        centre = lane_width * round(y / lane_width)
        if centre > 0.0 and now <= other.script_begin and other.start.y == centre and abs(y - centre) < ROUNDING:
            other.y = centre
    else:
        other.x, other.y = _script_x(other, now), _script_y(other, moves, now)


@kernel
def _map_back(body: Any, share: float) -> None:
    """Where a vehicle stood on the map a share of the way through the step."""
    was, at = _map_body(body.before.map, 0.0, 0.0, body), _map_body(body.map, 0.0, 0.0, body)
    here = between(was, at, share)
    body.map.x, body.map.y, body.map.heading = here.x, here.y, here.heading


@kernel
def _go_back(ego: Any, others: Any, share: float, step: float, now: float) -> None:
    """The case as it was a share of the way through the step, when something touched the ego."""
    was = ego.before
    _map_back(ego, share)
    before = Body(was.x, was.y, was.heading, was.speed, ego.length, ego.width, 0.0)
    here = between(before, Body(ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width, 0.0), share)
    ego.x, ego.y, ego.heading, ego.speed = here.x, here.y, here.heading, here.speed
    ego.time = now - step + share * step
    for j in range(len(others)):
        other = others[j]
        was = other.before
        _map_back(other, share)
        before = Body(was.x, was.y, was.heading, was.speed, other.length, other.width, was.across)
        after = Body(other.x, other.y, other.heading, other.speed, other.length, other.width, other.across)
        here = between(before, after, share)
        other.x, other.y, other.heading, other.speed = here.x, here.y, here.heading, here.speed
        other.across = here.across


@kernel
def _was_past_the_end(ego: Any, share: float, length: float) -> bool:
    """Whether the ego has passed the road's end, m, where its case ends, before this share of the step."""
    return bool(ego.before.x + share * (ego.x - ego.before.x) > length)


@kernel
def _end(ego: Any, others: Any, scenario: Any, now: float) -> int:
    """Why a case ends, 0 while it goes on."""
    road = scenario.road
    ego.stood = ego.stood + scenario.step if ego.speed < scenario.standstill_speed else 0.0
    if not right_edge_at(road, ego.x) <= ego.y <= left_edge_at(road, ego.x):
        return OFF_ROAD
    if ego.x >= road.length:
        return ROAD_END
    if ego.stood >= scenario.standstill_time - 1e-9:
        return STANDSTILL
    if now >= scenario.time_limit - 1e-9:
        return TIME_LIMIT
    if scenario.end_when_decided == 0 or ego.settled == 0 or ego.acceleration != 0.0:
        return 0
    if abs(ego.heading) > (ALONG_A_BEND if road.bent else 0.0):
        return 0
    if now < ego.scripted_until or ego.way.asked:  # its scripts are not over
        return 0
    body = Body(ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width, 0.0)
    for j in range(len(others)):
        other = others[j]
        there = Body(other.x, other.y, other.heading, other.speed, other.length, other.width, other.across)
        if other.present and not keeps_apart(body, there):
            return 0
    return DECIDED


@rows
def see_rows(
    egos: Records, others: Records, moves: Records, clips: Records, seen: Records, samples: FloatArray,
    shown: FloatArray, scenario: Records, line: Records, steps: int, sampling: int, as_read: int,
) -> int:  # fmt: skip
    """Take in what SUMO shows at the end of so many steps: places, contact, ends, samples, what rules see next.

    shown: (n, m, 4), x and y of the front bumper, angle and speed; the last two count if `as_read`. line: the road's,
    of no knots if it is straight. Returns how many cases have ended.
    """
    ended = 0
    bent = len(line) > 0
    step, width = scenario[0].step, scenario[0].road.lane_width
    for i in range(len(egos)):
        ego = egos[i]
        if ego.live == 0:
            continue
        if ego.reason != 0:  # broken off in this step
            _sample_row(ego, others[i], moves[i], samples[i])
            ended += 1
            continue
        now = (steps - ego.begun) * step
        was = ego.before
        if bent:
            before = _map_body(was.map, was.speed, 0.0, ego)
            body = _map_body(ego.map, ego.speed, 0.0, ego)
        else:
            before = Body(was.x, was.y, was.heading, was.speed, ego.length, ego.width, 0.0)
            body = Body(ego.x, ego.y, ego.heading, ego.speed, ego.length, ego.width, 0.0)
        first = 2.0
        for j in range(len(others[i])):
            other = others[i][j]
            if other.present == 0:
                continue
            _place(
                other, moves[i][j], shown[i, j, 0], shown[i, j, 1], shown[i, j, 2], shown[i, j, 3], line, now, as_read,
                width,
            )  # fmt: skip
            was = other.before
            if other.played == 0:
                other.acceleration = (other.speed - was.speed) / step
            if bent:
                there = _map_body(was.map, was.speed, was.across, other)
                here = _map_body(other.map, other.speed, other.across, other)
            else:
                there = Body(was.x, was.y, was.heading, was.speed, other.length, other.width, was.across)
                here = Body(other.x, other.y, other.heading, other.speed, other.length, other.width, other.across)
            share = share_at_touch(before, body, there, here)
            if 0.0 <= share < first:
                first, ego.struck = share, j
        if first <= 1.0 and not _was_past_the_end(ego, first, scenario[0].road.length):
            ego.reason, ego.share = CONTACT, first
            _go_back(ego, others[i], first, step, now)
        else:
            ego.time = now
            ego.reason = _end(ego, others[i], scenario[0], now)
            show_body(ego.seen, ego, line, 0.5 * scenario[0].vehicle.wheelbase)
            for j in range(len(others[i])):
                other = others[i][j]
                show_body(seen[i][j], other, line, 0.0)
                if other.present == 0:
                    seen[i][j].x = math.nan
        if sampling or ego.reason != 0:
            _sample_row(ego, others[i], moves[i], samples[i])
            for j in range(len(others[i])):
                other = others[i][j]
                ahead = other.x - _script_x(other, ego.time)
                left = other.y - _script_y(other, moves[i][j], ego.time)
                off = math.sqrt(ahead * ahead + left * left)
                if other.present and other.played == 0 and off > SCRIPT_TOLERANCE:
                    count_clip(clips[i], OFF_SCRIPT, now, 0.0, off)
        if ego.reason != 0:
            ended += 1
    return ended


@rows
def tell_played_rows(
    egos: Records, others: Records, plays: Records, tell: FloatArray, told: int, closely: int, line: Records
) -> int:
    """Write what SUMO has to hear of the played vehicles to `tell`, behind `told` rows of it; how many it then has.

    On a road that bends they are put on the map as well.
    """
    bent = len(line) > 0
    for i in range(len(egos)):
        if egos[i].live == 0 or egos[i].reason != 0:
            continue
        for j in range(len(others[i])):
            other = others[i][j]
            other.told = 1
            if plays[i][j].model or other.present == 0:
                continue
            if bent:
                inner = put_on_map(other, line)
            if bent and closely:
                other.told = 2
                along = (other.speed * math.cos(other.heading) - other.across * math.sin(other.heading)) / inner
                _tell_on_bend(tell, told, i * (1 + len(others[i])) + 1 + j, other, line, along)
                told += 1
            elif not bent:
                _put_front(other, other)
                if closely:
                    other.told = 2
                    _tell(tell, told, i * (1 + len(others[i])) + 1 + j, other, other)
                    told += 1
    return told


@rows
def map_played_rows(others: Records, line: Records) -> None:
    """Put the played vehicles on the map of a road that bends."""
    for i in range(len(others)):
        for j in range(len(others[i])):
            if others[i][j].played:
                put_on_map(others[i][j], line)
