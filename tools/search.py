"""Search a game that S+ rewards: `python tools/search.py [--generations 9] [--seed 1] [--known FILE]`.

A policy of ten parameters (speed, gap, braking, standing, steering aside, giving up) is optimised for S+ by scipy's
differential evolution: 30 policies a generation, each generation one evaluation at few points of three scenarios. The
best one must drive the task: T of at least 0.9, no departure, no giving up. Prints it, and exits with 1 where it does
not. FILE keeps what each policy scored, a line of JSON each; with the same seed a search goes on from it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim import Command
from sumo_eval.cosim.doors.observation import Observation

POINTS = {"front_vehicle_low_speed": 8, "front_vehicle_cut_out": 8, "cut_in": 12}
STEPS = 1_000  # of each parameter, which a policy's name tells
TASK = 0.9  # T that is driving the task


class Parameters(NamedTuple):
    """Of the policy: least and most of each."""

    pace: float  # of its first speed
    ease: float  # m/s2 at most, towards its speed
    headway: float  # s that it keeps
    braking_ttc: float  # s below which it brakes hard
    braking: float  # m/s2
    standing: float  # s after which it brakes to a stop; beyond 20 s never
    steering_ttc: float  # s below which it steers aside
    steering: float  # rad of the wheel
    giving_up: float  # s of TTC below which it raises
    smoothness: float  # share of its last acceleration that it keeps


LEAST = Parameters(0.0, 0.3, 0.3, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0)
MOST = Parameters(1.2, 4.0, 3.0, 6.0, 9.0, 30.0, 4.0, 1.0, 3.0, 0.95)
NEVER = 20.0  # s


class Policy:
    """Follows at its headway, and does what its parameters say."""

    parameters: Parameters

    def __init__(self) -> None:
        self._first: float | None = None
        self._last = 0.0

    def act(self, seen: Observation) -> Command:
        """The acceleration wanted, m/s2, and the wheel, rad."""
        p, speed, lead = self.parameters, seen.ego.speed, seen.lead
        self._first = speed if self._first is None else self._first
        closing = 0.0 if lead is None else -lead.relative_speed
        ttc = lead.gap / closing if lead is not None and closing > 0.0 else math.inf
        if ttc < p.giving_up:
            raise RuntimeError("too dangerous")

        wanted = min(max(p.pace * self._first - speed, -p.ease), p.ease)
        if lead is not None:
            wanted = min(wanted, 0.2 * (lead.gap - 2.0 - p.headway * speed) - 0.9 * closing)
        if ttc < p.braking_ttc or p.standing < min(seen.time, NEVER):
            wanted = min(wanted, -p.braking)
        self._last = p.smoothness * self._last + (1.0 - p.smoothness) * min(max(wanted, -9.0), 4.0)
        return Command(self._last, p.steering if ttc < p.steering_ttc else 0.0)


def __getattr__(name: str) -> type[Policy]:
    """The class of a policy by its `identifier`, which tells its parameters."""
    if not name.startswith("policy_"):
        raise AttributeError(name)
    shares = np.array([int(value) for value in name.split("_")[1:]]) / STEPS
    values = np.array(LEAST) + shares * (np.array(MOST) - np.array(LEAST))
    return type(name, (Policy,), {"parameters": Parameters(*values.tolist()), "__module__": __name__})


def identifier(shares: NDArray[np.float64]) -> str:
    """The name of the class of a policy. shares: where each parameter lies between its least and most, (10,)."""
    return "policy_" + "_".join(f"{round(STEPS * share)}" for share in shares)


def driven(names: list[str]) -> dict[str, Any]:
    """What each policy scores, by name. Imports here, because each policy's process reads this module."""
    from games import evaluation, table

    import sumo_eval
    from sumo_eval.settings import AdsSettings, MethodSettings, ZoneSettings

    here = Path(__file__).resolve()
    ads = [AdsSettings(name, f"{here}:{name}") for name in dict.fromkeys(names)]
    coarse = MethodSettings(zones=ZoneSettings(grid_points=1_000, restarts=0, refinements=0))
    with tempfile.TemporaryDirectory() as scratch:
        settings = replace(evaluation(POINTS, ads, drivers=3), method=coarse)
        done = sumo_eval.evaluate(settings, Path(scratch) / "run")
    return {str(name): scores for name, scores in table(done).set_index("ADS").to_dict("index").items()}


def main() -> int:
    """Search, print each generation's best and the best of all."""
    from scipy.optimize import differential_evolution

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--generations", type=int, default=9)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--known", type=Path)
    asked = parser.parse_args()
    rows: dict[str, Any] = {}
    if asked.known and asked.known.exists():
        rows = dict(json.loads(line) for line in asked.known.read_text(encoding="utf-8").splitlines())

    def losses(population: NDArray[np.float64]) -> NDArray[np.float64]:
        names = [identifier(shares) for shares in population.T]
        new = [name for name in names if name not in rows]
        if new:
            rows.update(found := driven(new))
            if asked.known:
                with asked.known.open("a", encoding="utf-8") as file:
                    file.writelines(json.dumps(item) + "\n" for item in found.items())
        best = max(rows, key=lambda name: rows[name]["S+"])
        print(len(rows), __getattr__(best).parameters, rows[best], flush=True)
        return np.array([-rows[name]["S+"] for name in names])

    search: Any = differential_evolution  # its stubs know no vectorized function
    search(
        losses, [(0.0, 1.0)] * len(LEAST), popsize=3, maxiter=asked.generations, rng=asked.seed, polish=False,
        updating="deferred", vectorized=True, tol=0.0,
    )  # fmt: skip
    best = max(rows, key=lambda name: rows[name]["S+"])
    found = rows[best]
    return 0 if found["T"] >= TASK and not found["departed"] and not found["gave up"] else 1


if __name__ == "__main__":
    sys.exit(main())
