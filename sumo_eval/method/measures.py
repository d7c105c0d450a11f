"""Criticality measures of one recorded case, in the terms of traffic safety and type approval: TTC,
THW, DRAC, PET, delta-v, and how well a lane was kept.

Distances and speeds are along the road, x, at the ego's samples, unless a measure says otherwise. A
vehicle is in the ego's path if the two bodies overlap across the road, |y_other - y_ego| <
(w_ego + w_other)/2, and ahead if its centre is in front of the ego's. Of the vehicles ahead in the
path the nearest counts, sample by sample. A measure is nan if it is not defined in the case, inf if
it is unbounded.

Users: `scoring/` (which puts the measures into cases.csv), `method/`. Fixed: the smoothing of
`smooth_motion`, with which `plausibility.MOTORWAY_PEOPLE` was measured; names of the fields of
`CriticalityMeasures` and `LaneKeeping`, which are columns of cases.csv.
"""

from typing import NamedTuple

import numpy as np

from sumo_eval.frozen import frozen
from sumo_eval.method.checks import quotient
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.road.reference_line import curvatures
from sumo_eval.trajectory import (
    BoolArray,
    Collision,
    FloatArray,
    Trajectories,
    Trajectory,
    half_extents,
)

TOUCH = 1e-3
"""m; bodies nearer than this touch. A quotient by such a small gap, as in the last sample before a
contact, would mean nothing."""
CLOCK = 0.1
"""Time between two samples of `smooth_motion`, s, whatever the recording's own rate."""
SLOPE_SAMPLES = 11
"""Samples of the line that `smooth_motion` fits for a derivative: 1 s, so that a tracker's noise of
a few centimetres adds less than 0.1 m/s and 0.2 m/s2."""
UNREST_SAMPLES, UNREST_CHANGES = 7, 20
"""Samples of a line fitted to the speed (0.6 s), and steps of 0.1 s (2 s). Unrest is the sum of the
line's |changes of slope| over these steps: noise of 0.05 m/s adds less than 2 m/s2."""
STANDING = 0.1
"""Below this speed, m/s, a vehicle stands."""


@frozen
class CriticalityMeasures:
    """Criticality measures of a case: how close it came to a collision, and how hard the ego acted.

    min_ttc: least time to collision, s.
    max_ittc: 1 / min_ttc, 1/s.
    min_thw: least time headway, s.
    min_gap: least gap to the lead vehicle, m.
    max_drac: largest deceleration needed to avoid a collision, m/s2.
    pet: post-encroachment time along the road, s.
    max_deceleration: m/s2; 0 if the ego never braked.
    max_jerk: m/s3, along the ego's heading.
    delta_v: change of the ego's speed by a collision, m/s; nan without a collision.
    max_lateral_jerk: m/s3, across the ego's heading.

    A frontal contact of an ego that moves has min_thw, min_gap and pet 0; if the ego was closing,
    also min_ttc 0, and max_ittc and max_drac inf. An ego that never closes on a lead vehicle has
    min_ttc inf, max_ittc and max_drac 0. Without a lead vehicle in the path, min_ttc to max_drac
    are nan.
    """

    min_ttc: float
    max_ittc: float
    min_thw: float
    min_gap: float
    max_drac: float
    pet: float
    max_deceleration: float
    max_jerk: float
    delta_v: float
    max_lateral_jerk: float


class SmoothMotion(NamedTuple):
    """Derivatives of a recorded or simulated drive, smoothed against noise. The arrays differ in
    length; that of a derivative for which the drive is too short is empty.

    acceleration: slope of the speed, m/s2.
    jerk: slope of the acceleration, m/s3.
    lateral_speed: slope of y, positive to the road's left, m/s.
    lateral_acceleration: slope of the lateral speed, m/s2.
    unrest: sum of changes of acceleration, up and down, within 2 s, m/s2.
    """

    acceleration: FloatArray
    jerk: FloatArray
    lateral_speed: FloatArray
    lateral_acceleration: FloatArray
    unrest: FloatArray


class Course(NamedTuple):
    """Series of a drive, for its measures and extremes.

    gap: to the nearest lead vehicle in the path, at the ego's samples, (n,), m.
    closing: closing speed to this vehicle, (n,), m/s.
    ttc: time to collision with it, (n,), s.
    thw: time headway to it, (n,), s.
    motion: the drive's derivatives.
    """

    gap: FloatArray
    closing: FloatArray
    ttc: FloatArray
    thw: FloatArray
    motion: SmoothMotion


def course_of(
    ego: Trajectory, actors: Trajectories, collision: Collision | None, road: Road
) -> Course:
    """The course of a drive.

    ego: trajectory of the ego, n samples.
    actors: trajectories of the other vehicles by name.
    collision: the ego's first contact, if any.
    road: in whose coordinates the trajectories are.
    """
    gap, closing = vehicle_ahead(ego, actors, collision, road)
    return Course(
        gap,
        closing,
        time_to_collision(gap, closing),
        time_headway(gap, speed_along(ego, road)),
        smooth_motion(ego),
    )


def measures(
    ego: Trajectory, actors: Trajectories, collision: Collision | None, course: Course
) -> CriticalityMeasures:
    """The criticality measures of a case.

    ego: trajectory of the ego.
    actors: trajectories of the other vehicles by name.
    collision: the ego's first contact, if any.
    course: of the same drive, from `course_of`.
    """
    ttc = least(course.ttc)
    steps = np.diff(ego.time)
    # The sample of a contact may come right after another. It counts as if a whole interval later:
    # else any change of acceleration in this short time would be a jerk of hundreds of m/s3.
    interval = np.median(steps) if len(steps) > 1 else CLOCK
    whole = np.where(steps < 0.99 * interval, interval, steps)
    # acceleration across the heading, m/s2: speed times rate of turn
    lateral = ego.speed[1:] * np.diff(np.unwrap(ego.heading)) / steps
    return CriticalityMeasures(
        min_ttc=ttc,
        max_ittc=1.0 / ttc if ttc else np.inf,  # nan stays nan
        min_thw=least(course.thw),
        min_gap=least(course.gap),
        max_drac=largest(deceleration_to_avoid(course.gap, course.closing)),
        pet=post_encroachment_time(ego, actors, collision),
        max_deceleration=max(0.0, -float(ego.acceleration.min())),
        max_jerk=largest(np.abs(np.diff(ego.acceleration) / whole)),
        delta_v=np.nan if collision is None else velocity_change(collision),
        max_lateral_jerk=largest(np.abs(np.diff(lateral) / whole[1:])),
    )


IN_THE_MIDDLE = 0.15
"""m; an offset from the lane's middle up to this counts as none (Autoware's UC-PLN-003-0001)."""


@frozen
class LaneKeeping:
    """Measures of how an ego kept the lane in which it began.

    largest_offset: from the lane's middle, to either side, m.
    overshoot: largest offset to the side opposite to its first offset beyond 0.15 m, m; 0 without
        such an offset.
    over_line_time: time during which its body reached over a line of the lane, s.
    settling_time: time from which on it stayed within 0.15 m of the middle, s; inf if it was
        further away at the end.
    """

    largest_offset: float
    overshoot: float
    over_line_time: float
    settling_time: float


def lane_keeping(ego: Trajectory, lane_width: float) -> LaneKeeping:
    """Measures of how the ego kept the lane whose middle is nearest at its start.

    ego: trajectory of the ego; y = 0 is the middle of the right lane.
    lane_width: of every lane, m.
    """
    offset = ego.y - lane_width * np.round(ego.y[0] / lane_width)
    _, across = half_extents(ego.heading, ego.length, ego.width)
    reach = np.abs(offset) + across
    steps = np.diff(ego.time, append=ego.time[-1])
    away = np.flatnonzero(np.abs(offset) > IN_THE_MIDDLE)  # samples
    overshoot, settling = 0.0, 0.0
    if len(away):
        first = away[0]
        settled = away[-1] + 1
        overshoot = max(0.0, float(np.max(-np.sign(offset[first]) * offset[first:])))
        settling = float(ego.time[settled]) if settled < len(offset) else np.inf
    return LaneKeeping(
        float(np.abs(offset).max()),
        overshoot,
        float(steps[reach > 0.5 * lane_width].sum()),
        settling,
    )


def smooth_motion(drive: Trajectory) -> SmoothMotion:
    """A drive's derivatives, by one rule for recorded vehicles, whose positions are noisy, and for
    simulated ones.

    Speed and y are interpolated every 0.1 s from the start on. A derivative is the slope of the
    least-squares line through 11 samples (1 s), all of which must exist. A second derivative is the
    slope of such slopes (2 s). Windows in which the vehicle stands are left out of acceleration,
    jerk and unrest, because releasing the brake at a standstill is a jump in any car.
    """
    # 1e-6 is rounding: a last sample just short of a full 0.1 s counts
    clock = drive.time[0] + CLOCK * np.arange(int(drive.duration / CLOCK + 1e-6) + 1)
    speed, y = (np.interp(clock, drive.time, channel) for channel in (drive.speed, drive.y))
    acceleration, lateral_speed = _slopes(speed), _slopes(y)
    jerk, lateral_acceleration = _slopes(acceleration), _slopes(lateral_speed)
    unrest = _unrest(speed)
    # standing[i]: number of samples before sample i at which the vehicle stands
    standing = np.concatenate([[0], np.cumsum(speed < STANDING)])

    def moving(values: FloatArray) -> FloatArray:
        """The derivatives in whose window the vehicle never stands."""
        window = clock.size - values.size + 1  # samples
        before, after = standing[: values.size], standing[window:]
        return np.asarray(values[after == before])

    return SmoothMotion(
        moving(acceleration), moving(jerk), lateral_speed, lateral_acceleration, moving(unrest)
    )


def _unrest(speed: FloatArray) -> FloatArray:
    """Sum of changes of acceleration, up and down, within each 2 s, m/s2. It shows an oscillation
    that slopes over 1 s average out.

    speed: every `CLOCK` s, (n,), m/s.
    """
    changes = np.abs(np.diff(_slopes(speed, UNREST_SAMPLES)))
    if changes.size < UNREST_CHANGES:
        return np.zeros(0)
    return np.convolve(changes, np.ones(UNREST_CHANGES), mode="valid")


def _slopes(values: FloatArray, samples: int = SLOPE_SAMPLES) -> FloatArray:
    """Slope per second of the least-squares line through each run of values, (n - samples + 1,).

    values: every `CLOCK` s, (n,).
    samples: of a run, an odd number.
    """
    if values.size < samples:
        return np.zeros(0)
    offsets = np.arange(samples) - samples // 2  # from the middle of a run, in samples
    # slope = sum(t v) / sum(t^2) with times t from the middle of the run
    return np.correlate(values, offsets / (CLOCK * np.sum(offsets**2)), mode="valid")


def speed_along(drive: Trajectory, road: Road) -> FloatArray:
    """Speed along the road's line, dx/dt, m/s, (n,); `drive.speed` is over the ground."""
    # beside a curved line (y) the way is shorter inside the curve and longer outside
    return drive.speed * np.cos(drive.heading) / (1.0 - curvatures(road.line, drive.x) * drive.y)


def vehicle_ahead(
    ego: Trajectory, actors: Trajectories, collision: Collision | None, road: Road
) -> tuple[FloatArray, FloatArray]:
    """Gap d, m, and closing speed, m/s, to the nearest lead vehicle in the ego's path, (n,) each;
    nan without one.

    ego: trajectory of the ego, n samples.
    actors: trajectories of the other vehicles by name.
    collision: the ego's first contact, if any. From a frontal contact on the gap is 0, because
        bodies at an angle touch a little before the gap along the road closes.
    road: in whose coordinates the trajectories are.

    d = x_other - x_ego - (l_ego + l_other)/2, bumper to bumper, at least 0. The length and width of
    a turned body are its extents along and across the road. The ego counts as parallel to the road,
    because `plausibility.MOTORWAY_PEOPLE` was measured with this rule. The closing speed is
    v_ego - v_other along the road.
    """
    gap, closing = np.full(len(ego), np.inf), np.full(len(ego), np.nan)
    own_speed = speed_along(ego, road)
    for name, actor in actors.items():
        # of the actor at the ego's samples, (n,) each
        x, y, speed = _at(ego.time, actor, actor.x, actor.y, speed_along(actor, road))
        extents = half_extents(actor.heading, actor.length, actor.width)
        along, across = _at(ego.time, actor, *extents)
        distance = x - ego.x - ego.length / 2.0 - along
        beside = np.abs(y - ego.y) > ego.width / 2.0 + across - TOUCH
        # inf: the actor is behind, beside the path, or not recorded at this time
        distance = np.where((x <= ego.x) | beside | np.isnan(x), np.inf, np.maximum(distance, 0.0))
        if collision is not None and (collision.other, collision.side) == (name, "front"):
            distance[(ego.time >= collision.time) & ~np.isnan(x)] = 0.0
        nearer = distance < gap
        gap = np.minimum(gap, distance)
        closing = np.where(nearer, own_speed - speed, closing)
    return np.where(np.isinf(gap), np.nan, gap), closing


def time_to_collision(gap: FloatArray, closing: FloatArray) -> FloatArray:
    """Eq. 1 of a recorded drive: TTC = d / (v_ego - v_other), s, (n,), if both keep their speeds
    (Hayward 1972).

    gap: d, (n,), m, from `vehicle_ahead`.
    closing: v_ego - v_other, (n,), m/s, from `vehicle_ahead`.

    inf where the ego is not closing, 0 where it touches, nan without a gap.
    """
    touching = (gap < TOUCH) & (closing > 0.0)
    ttc = np.where(touching, 0.0, quotient(gap, closing, closing > 0.0))
    return np.where(np.isnan(gap), np.nan, ttc)


def time_headway(gap: FloatArray, ego_speed: FloatArray) -> FloatArray:
    """THW = d / v_ego, s, (n,): time in which the ego reaches the present position of the lead
    vehicle's rear (ISO 15622, time gap).

    gap: d, (n,), m, from `vehicle_ahead`.
    ego_speed: v_ego along the road, (n,), m/s, from `speed_along`.

    inf where the ego does not move forward, nan without a gap.
    """
    return np.where(np.isnan(gap), np.nan, quotient(gap, ego_speed, ego_speed > 0.0))


def deceleration_to_avoid(gap: FloatArray, closing: FloatArray) -> FloatArray:
    """DRAC = (v_ego - v_other)^2 / (2 d), m/s2, (n,): constant braking that just avoids contact
    (Almqvist et al. 1991).

    gap: d, (n,), m, from `vehicle_ahead`.
    closing: v_ego - v_other, (n,), m/s, from `vehicle_ahead`.

    0 where the ego is not closing, inf where it touches, nan without a gap.
    """
    needed = quotient(closing**2, 2.0 * gap, gap >= TOUCH)
    return np.where(np.isnan(gap), np.nan, np.where(closing > 0.0, needed, 0.0))


def post_encroachment_time(
    ego: Trajectory, actors: Trajectories, collision: Collision | None
) -> float:
    """PET along the road, s: least time from a vehicle's rear leaving a place of the road to the
    ego's front reaching it (Allen 1978).

    ego: trajectory of the ego.
    actors: trajectories of the other vehicles by name.
    collision: the ego's first contact, if any. After a frontal contact PET is 0.

    The places are where the ego's front bumper is at its samples. A place counts if the actor's
    rear bumper passed it earlier in the recording, and if the actor's body at that moment overlaps,
    across the road, the ego's body at its own sample. nan without such a place, as behind a vehicle
    that never moves.
    """
    if collision is not None and collision.side == "front":
        return 0.0
    pet = min((_least_wait(ego, actor) for actor in actors.values()), default=np.inf)
    return pet if np.isfinite(pet) else float("nan")


def _least_wait(ego: Trajectory, actor: Trajectory) -> float:
    """Least time from the actor's rear leaving a place to the ego's front reaching it, s; inf
    without such a place.
    """
    front = ego.x + ego.length / 2.0  # the places
    # the furthest x so far: a place is left when it is passed for the first time
    rear = np.maximum.accumulate(actor.x - actor.length / 2.0)
    # first sample of the actor whose rear is beyond each place
    after = np.searchsorted(rear, front, side="right")
    is_passed = (after > 0) & (after < len(actor))
    end = after[is_passed]
    share = (front[is_passed] - rear[end - 1]) / (rear[end] - rear[end - 1])
    # when the actor's rear leaves each place that it passes, and its y then
    leaves = actor.time[end - 1] + share * (actor.time[end] - actor.time[end - 1])
    y = actor.y[end - 1] + share * (actor.y[end] - actor.y[end - 1])
    overlaps = np.abs(y - ego.y[is_passed]) < (ego.width + actor.width) / 2.0
    waits = (ego.time[is_passed] - leaves)[overlaps]
    return float(waits[waits >= 0.0].min(initial=np.inf))


_FINER = 0.005  # s, time step between the samples in `conflict_pet`


def conflict_pet(ego: Trajectory, other: Trajectory, collision: Collision | None = None) -> float:
    """PET of conflicting paths, s: least time between the two bodies covering one place (Allen
    1978).

    ego, other: trajectories of the two vehicles.
    collision: a contact between them, if any. PET is 0 then.

    Either vehicle may come first, at any angle. nan if they passed over no common place. Bodies are
    rectangles. Each sample of the ego is compared with each sample of the other vehicle. Of the
    pairs of samples with overlapping bodies, the pair with the least time between its samples is
    searched again in steps of 0.005 s, with poses interpolated between the samples.
    """
    if collision is not None:
        return 0.0
    lag = np.abs(ego.time[:, None] - other.time[None, :])
    touching = _overlap(ego, ego.time, other, other.time)
    if not touching.any():
        return float("nan")
    # samples i of the ego and j of the other vehicle: the overlapping pair of least lag
    i, j = np.unravel_index(int(np.argmin(np.where(touching, lag, np.inf))), lag.shape)
    first, second = _around(ego.time, int(i)), _around(other.time, int(j))
    touching = _overlap(ego, first, other, second)
    return float(np.abs(first[:, None] - second[None, :])[touching].min(initial=float(lag[i, j])))


def _around(time: FloatArray, at: int) -> FloatArray:
    """Times from the sample before sample `at` to the sample after it, about `_FINER` apart."""
    begin, end = time[max(at - 1, 0)], time[min(at + 1, len(time) - 1)]
    return np.linspace(begin, end, max(round((end - begin) / _FINER), 1) + 1)


def _overlap(
    one: Trajectory, times: FloatArray, other: Trajectory, other_times: FloatArray
) -> BoolArray:
    """Whether two rectangular bodies overlap, each pose of one with each pose of the other, (n, m).

    times: of the poses of `one`, (n,), s, within its recording.
    other_times: of the poses of `other`, (m,), s, within its recording.
    """
    x, y, heading = (values[:, None] for values in _pose(one, times))
    other_x, other_y, other_heading = _pose(other, other_times)
    dx, dy, turned = other_x - x, other_y - y, other_heading - heading
    c, s = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    apart = np.full(turned.shape, -np.inf)
    # Separating axes: two rectangles overlap unless they are apart along one of their four axes. An
    # axis is along or across `own`. The bodies are apart by the distance of their centres along the
    # axis, less half of both extents along it.
    for direction, own, far in ((heading, one, other), (other_heading, other, one)):
        ahead = np.cos(direction)
        aside = np.sin(direction)
        along = np.abs(dx * ahead + dy * aside) - 0.5 * (
            own.length + far.length * c + far.width * s
        )
        across = np.abs(dy * ahead - dx * aside) - 0.5 * (
            own.width + far.length * s + far.width * c
        )
        apart = np.maximum(apart, np.maximum(along, across))
    return apart < 0.0


def _pose(trajectory: Trajectory, times: FloatArray) -> list[FloatArray]:
    """x, y and heading of a vehicle at times (n,) within its recording, (n,) each."""
    channels = trajectory.x, trajectory.y, np.unwrap(trajectory.heading)
    return [np.interp(times, trajectory.time, channel) for channel in channels]


def velocity_change(collision: Collision) -> float:
    """Delta-v of the ego, m/s: (v_other - v_ego)/2 along its heading, for equal masses without
    rebound.

    Negative if the contact slows the ego down, positive if it pushes the ego on, 0 at equal
    velocities.
    """
    heading = collision.ego_pose[2]  # a pose is x, y, heading
    ahead = (float(np.cos(heading)), float(np.sin(heading)))
    relative = np.subtract(collision.other_velocity, collision.ego_velocity)
    return float(np.dot(relative, ahead)) / 2.0


def _at(time: FloatArray, actor: Trajectory, *channels: FloatArray) -> list[FloatArray]:
    """Channels of an actor, interpolated at times (n,), (n,) each; nan outside its recording."""
    return [np.interp(time, actor.time, channel, left=np.nan, right=np.nan) for channel in channels]


def least(values: FloatArray) -> float:
    """The least of the values (n,) that are not nan; nan without one."""
    return float(np.fmin.reduce(values, initial=np.nan))


def largest(values: FloatArray) -> float:
    """The largest of the values (n,) that are not nan; nan without one."""
    return float(np.fmax.reduce(values, initial=np.nan))
