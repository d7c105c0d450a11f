"""The criticality measures as a person would read them off the samples, one vehicle, one sample at
a time."""

import math

TOUCH = 1e-3


def plain_measures(ego, actors, collision):
    """min TTC, max ITTC, min THW, min gap, max DRAC, PET, strongest deceleration, largest jerk,
    delta-v, largest lateral speed and acceleration.
    """
    ttcs, ittcs, thws, gaps, dracs = [], [], [], [], []
    for i, t in enumerate(ego.time):
        nearest = None
        for name, actor in actors.items():
            if not actor.time[0] <= t <= actor.time[-1]:
                continue
            x, y = at(actor.time, actor.x, t), at(actor.time, actor.y, t)
            v = at(
                actor.time,
                [s * math.cos(h) for s, h in zip(actor.speed, actor.heading, strict=True)],
                t,
            )
            long, wide = (
                at(
                    actor.time,
                    [abs(a * math.cos(h)) + abs(b * math.sin(h)) for h in actor.heading],
                    t,
                )
                for a, b in ((actor.length, actor.width), (actor.width, actor.length))
            )
            struck = collision is not None and collision.other == name and collision.side == "front"
            if struck and t >= collision.time:
                gap = 0.0
            elif x > ego.x[i] and abs(y - ego.y[i]) <= (ego.width + wide) / 2 - TOUCH:
                gap = max(0.0, (x - long / 2) - (ego.x[i] + ego.length / 2))
            else:
                continue
            if nearest is None or gap < nearest[0]:
                nearest = gap, v
        if nearest is None:
            continue
        gap, v = nearest
        own = ego.speed[i] * math.cos(ego.heading[i])
        gaps.append(gap)
        thws.append(gap / own if own > 0 else math.inf)
        closing = max(own - v, 0.0)
        ittc = 0.0 if closing == 0 else math.inf if gap < TOUCH else closing / gap
        ittcs.append(ittc)
        ttcs.append(1 / ittc if ittc else math.inf)
        dracs.append(closing * ittc / 2)  # closing^2 / (2 gap)
    deceleration = max(0.0, *(-a for a in ego.acceleration))
    jerks = [
        abs(ego.acceleration[i + 1] - ego.acceleration[i]) / (ego.time[i + 1] - ego.time[i])
        for i in range(len(ego.time) - 1)
    ]
    return (
        min(ttcs, default=math.nan), max(ittcs, default=math.nan), min(thws, default=math.nan),
        min(gaps, default=math.nan), max(dracs, default=math.nan),
        plain_pet(ego, actors, collision),
        deceleration, max(jerks, default=math.nan), plain_delta_v(collision), *plain_lateral(ego),
    )  # fmt: skip


def plain_lateral(ego):
    """Largest lateral speed and acceleration: slopes of lines through 11 samples, and of lines
    through such slopes."""
    number = int((ego.time[-1] - ego.time[0]) / 0.1 + 1e-6) + 1
    times = [min(ego.time[0] + 0.1 * k, ego.time[-1]) for k in range(number)]
    speeds = slopes([at(ego.time, ego.y, t) for t in times])
    return tuple(
        max((abs(v) for v in values), default=math.nan) for values in (speeds, slopes(speeds))
    )


def slopes(values):
    """sum(t_j v_j) / sum(t_j^2) around the middle of every 11 neighbours 0.1 s apart."""
    return [
        sum(0.1 * j * values[i + j] for j in range(-5, 6))
        / sum((0.1 * j) ** 2 for j in range(-5, 6))
        for i in range(5, len(values) - 5)
    ]


def plain_pet(ego, actors, collision):
    """Walk each place that the ego's front reaches back to the moment when another's rear passed
    it."""
    if collision is not None and collision.side == "front":
        return 0.0
    times = []
    for i, t in enumerate(ego.time):
        place = ego.x[i] + ego.length / 2
        for actor in actors.values():
            rear = [x - actor.length / 2 for x in actor.x]
            for k in range(1, len(rear)):
                if rear[k - 1] <= place < rear[k]:
                    share = (place - rear[k - 1]) / (rear[k] - rear[k - 1])
                    left_at = actor.time[k - 1] + share * (actor.time[k] - actor.time[k - 1])
                    y = actor.y[k - 1] + share * (actor.y[k] - actor.y[k - 1])
                    if left_at <= t and abs(y - ego.y[i]) < (ego.width + actor.width) / 2:
                        times.append(t - left_at)
                    break
    return min(times, default=math.nan)


def plain_delta_v(collision):
    """Half of the other's velocity less the ego's, seen along the ego's heading."""
    if collision is None:
        return math.nan
    heading = collision.ego_pose[2]
    along = [
        v[0] * math.cos(heading) + v[1] * math.sin(heading)
        for v in (collision.other_velocity, collision.ego_velocity)
    ]
    return (along[0] - along[1]) / 2


def at(times, values, t):
    """The value at time t, linear between samples."""
    for k in range(len(times)):
        if times[k] == t:
            return values[k]
        if times[k] > t:
            share = (t - times[k - 1]) / (times[k] - times[k - 1])
            return values[k - 1] + share * (values[k] - values[k - 1])
    raise ValueError(t)
