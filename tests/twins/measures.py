"""The criticality measures read off the samples, one vehicle at a time."""

import math

import numpy as np

TOUCH = 1e-3
NEAR = 0.1 * np.arange(-5, 6)


@np.errstate(divide="ignore", invalid="ignore")
def plain_measures(ego, actors, collision):
    """min TTC, max ITTC, min THW, min gap, max DRAC, PET, strongest deceleration, largest jerk,
    delta-v, largest lateral jerk, speed and acceleration.
    """
    front = collision is not None and collision.side == "front"
    gap, v, pets = np.full(len(ego), np.inf), np.zeros(len(ego)), []
    for name, actor in actors.items():
        c, s = np.cos(actor.heading), abs(np.sin(actor.heading))
        x, y, speed, long, wide = (
            np.interp(ego.time, actor.time, values, np.nan, np.nan)
            for values in (
                actor.x,
                actor.y,
                actor.speed * c,
                actor.length * abs(c) + actor.width * s,
                actor.width * abs(c) + actor.length * s,
            )
        )
        struck = front and collision.other == name and ego.time >= collision.time
        ahead = (x > ego.x) & (abs(y - ego.y) <= (ego.width + wide) / 2 - TOUCH)
        room = np.maximum(x - long / 2 - ego.x - ego.length / 2, 0.0)
        its = np.where(struck & ~np.isnan(x), 0.0, np.where(ahead, room, np.inf))
        gap, v = np.minimum(its, gap), np.where(its < gap, speed, v)

        # each place that the ego's front reaches, when and where the other's rear passed it
        places, rear = ego.x + ego.length / 2, actor.x - actor.length / 2
        left, beside = (
            np.interp(places, rear, values, np.nan, np.nan) for values in (actor.time, actor.y)
        )
        met = abs(beside - ego.y) < (ego.width + actor.width) / 2
        pets += (ego.time - left)[met & (left <= ego.time)].tolist()

    seen = gap < np.inf
    gap, closing = gap[seen], np.maximum(ego.speed * np.cos(ego.heading) - v, 0.0)[seen]
    ittc = np.where(closing == 0, 0.0, np.where(gap < TOUCH, np.inf, closing / gap))
    thw = gap / (ego.speed * np.cos(ego.heading))[seen]
    apart = np.maximum(np.diff(ego.time), 0.1)  # s; a contact's sample counts as 0.1 s later
    jerks = abs(np.diff(ego.acceleration) / apart)
    aside = np.diff(ego.speed[1:] * np.diff(ego.heading) / np.diff(ego.time))
    aside = abs(aside / apart[1:])
    speeds = slopes(np.interp(np.arange(ego.time[0], ego.time[-1] + 1e-6, 0.1), ego.time, ego.y))
    most, least = (lambda values, of=of: of(values, default=math.nan) for of in (max, min))
    return (
        np.divide(1, most(ittc)), most(ittc), least(thw), least(gap), most(closing * ittc / 2),
        0.0 if front else least(pets), max(0.0, *-ego.acceleration), most(jerks),
        plain_delta_v(collision), most(aside), most(abs(speeds)), most(abs(slopes(speeds))),
    )  # fmt: skip


def slopes(values):
    """sum(t_j v_j) / sum(t_j^2) around the middle of every 11 neighbours 0.1 s apart."""
    return np.correlate(values, NEAR / (NEAR**2).sum(), "valid")


def plain_delta_v(collision):
    """Half of the other's velocity less the ego's, seen along the ego's heading."""
    if collision is None:
        return math.nan
    heading = collision.ego_pose[2]
    between = np.subtract(collision.other_velocity, collision.ego_velocity)
    return between @ (math.cos(heading), math.sin(heading)) / 2
