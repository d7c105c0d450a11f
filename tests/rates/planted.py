"""Traffic with planted cut-ins, as SUMO floating car data: known ranges, a known correlation, a
known rate."""

import numpy as np
import pandas as pd
from scipy.special import ndtr

from sumo_eval.drivers.recorded.recordings import canonical
from sumo_eval.scenario.concrete import smooth_step

RANGES = {
    "ego_speed": (28.0, 36.0),
    "closing_speed": (-2.0, 2.0),
    "gap": (40.0, 70.0),
    "duration": (4.0, 7.0),
    "acceleration": (-0.3, 0.3),
}
TOGETHER = ("closing_speed", "gap")
NORMAL_CORRELATION = 0.6
RANK_CORRELATION = 6.0 / np.pi * np.arcsin(NORMAL_CORRELATION / 2.0)  # of a Gaussian copula
# s: when the other begins to move, how long and how far apart scenes are
BEGIN, LASTS, APART = 8.0, 24.0, 60.0
LENGTH = 5.0  # m, SUMO's car


def shares_of(count, stream):
    """Where in its range each parameter of an event is, (count, k): even, and two of them
    together."""
    shares = stream.uniform(size=(count, len(RANGES)))
    first, second = stream.standard_normal((count, 2)).T
    second = NORMAL_CORRELATION * first + np.sqrt(1.0 - NORMAL_CORRELATION**2) * second
    shares[:, [list(RANGES).index(name) for name in TOGETHER]] = ndtr([first, second]).T
    return shares


def planted(path, scenes, events_expected, seed):
    """Write `scenes` scenes of two vehicles each, in some of which the other cuts in.

    Return the true rate, 1/km, and how many there are.

    The number of events is a Poisson draw; every scene is as long, with or without an event.
    """
    stream = np.random.default_rng(seed)
    events = int(stream.poisson(events_expected))
    assert events <= scenes
    time = np.round(np.arange(0.0, LASTS, 0.1), 1)
    parts, kilometres = [_alone(scenes * APART)], 2.2
    for scene in range(scenes):
        (shares,) = shares_of(1, stream)
        value = {
            name: low + share * (high - low)
            for (name, (low, high)), share in zip(RANGES.items(), shares, strict=True)
        }
        since = time - BEGIN
        moving = np.clip(since, 0.0, value["duration"])
        after = np.maximum(since - value["duration"], 0.0)
        speed = value["ego_speed"] - value["closing_speed"]
        rate = value["acceleration"]
        # rear bumper
        x = value["gap"] + speed * since + 0.5 * rate * moving**2 + rate * value["duration"] * after
        y = 3.5 * (1.0 - (smooth_step(since / value["duration"]) if scene < events else 0.0 * time))
        # of the ego when the other begins to move: lanes are read off the traffic
        place = stream.uniform(300.0, 900.0)
        ego = value["ego_speed"] * since + place
        kilometres += (float(np.ptp(ego)) + float(np.ptp(x))) / 1000.0
        for name, front, aside, v in (
            ("ego", ego, 0.0 * time, np.full(len(time), value["ego_speed"])),
            ("other", x + place + LENGTH, y, speed + rate * moving),
        ):
            parts.append(_fcd(time + scene * APART, f"{name}{scene}", front, aside, v))
    pd.concat(parts).sort_values("timestep_time", kind="stable").to_csv(path, sep=";", index=False)
    return events_expected / kilometres, events


def _alone(begin):
    """A vehicle that keeps its lane along the whole road, 2.2 km: roads are straightened along the
    longest track."""
    time = np.round(begin + np.arange(0.0, 55.05, 0.1), 1)
    return _fcd(time, "alone", 40.0 * (time - begin), 0.0 * time, 40.0 + 0.0 * time)


def _fcd(time, vehicle, x, y, speed):
    """Rows of a vehicle as SUMO writes them."""
    return pd.DataFrame(
        {
            "timestep_time": np.round(time, 1),
            "vehicle_id": vehicle,
            "vehicle_x": x.round(4),
            "vehicle_y": y.round(4),
            "vehicle_angle": 90.0,
            "vehicle_speed": speed.round(4),
            "vehicle_posLat": (y - 3.5 * np.round(y / 3.5)).round(4),
        }
    )


def recordings_of(time, tracks, lane_width, begin=0.0):
    """Cars on straight lanes of one recording, `r`, that begins at `begin`;

    tracks: x and y of each, (n,) m.
    """
    rows = [
        pd.DataFrame({"recording": "r", "vehicle": name, "t": time + begin, "x": x, "y": y,
            "length": 4.4, "width": 1.8,
                      "class": "car", "speed": np.gradient(x, time), "heading": 0.0,
                      "lane": np.round(y / lane_width)})
        for name, (x, y) in tracks.items()
    ]  # fmt: skip
    return canonical(pd.concat(rows, ignore_index=True))
