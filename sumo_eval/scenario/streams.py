"""Streams of traffic: where their vehicles start and how fast they want to drive, drawn once from a declared seed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sumo_eval.errors import must_be

MOST = 200  # vehicles of one stream


class Spread(NamedTuple):
    """How vehicles differ. speed: m/s, spacing: share of the mean, both to either side, evenly."""

    speed: float
    spacing: float
    seed: int


def drawn(name: str, spread: Spread, length: float, numbers: Mapping[str, float]) -> list[tuple[float, float]]:
    """Vehicles from the foremost back: place of the centre ahead of the ego's, m, and speed, m/s.

    length: m, of each. numbers: `begin`, `end`, `density`, `speed`, `min_gap`. The draws depend on the seed and on the
    vehicle's number alone, so that a point of the space changes nothing but what its parameters say.
    Raises InputError for a stream that is denser than its lane holds, or longer than anybody needs.
    """
    owner = f"stream `{name}`"
    begin, end, mean = numbers["begin"], numbers["end"], 1000.0 / numbers["density"]
    if not begin < end:
        raise must_be("`begin`", owner, f"below `end` ({end:g} m)", begin)
    least = mean * (1.0 - spread.spacing)
    if least < length + numbers["min_gap"]:
        most = 1000.0 * (1.0 - spread.spacing) / (length + numbers["min_gap"])
        raise must_be("`density`", owner, f"at most {most:g} a km, which the lane holds", numbers["density"])
    if (end - begin) / least > MOST:
        raise must_be("The vehicles", owner, f"at most {MOST}", f"up to {(end - begin) / least:.0f}")
    if spread.speed >= numbers["speed"]:
        raise must_be("`speed_spread`", owner, f"below `speed` ({numbers['speed']:g} m/s)", spread.speed)
    draws = np.random.Generator(np.random.PCG64(spread.seed)).uniform(-1.0, 1.0, (2, MOST + 1))
    found: list[tuple[float, float]] = []
    place = end
    for slow, close in draws.T.tolist():
        if place < begin:
            break
        found.append((place, numbers["speed"] + spread.speed * slow))
        place -= mean * (1.0 + spread.spacing * close)
    return found
