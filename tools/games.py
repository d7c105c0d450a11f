"""Drive the games that no score may reward: `python tools/games.py [FOLDER]`.

Seven games and the shipped ADSs drive 77 points of three scenarios. Prints T, A, A', H and S+, each
the mean over the scenarios, and the incidents.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean

import pandas as pd

import sumo_eval
from sumo_eval.ads.car_following import IdmParameters, idm_acceleration
from sumo_eval.cosim import Command
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.cosim.doors.observation import Observation
from sumo_eval.results import Evaluation
from sumo_eval.settings import (
    AdsSettings,
    DriverSettings,
    EvaluationSettings,
    RunSettings,
    SamplingSettings,
    ScenarioSettings,
)

DANGER = 2.5  # s of TTC below which some games give up
COLUMNS = {
    "T": "task_share",
    "A": "avoided_share",
    "A'": "avoidance_grade",
    "H": "human_likeness",
    "S+": "s_plus",
}


def time_to_collision(seen: Observation) -> float:
    """TTC to the vehicle ahead, s; inf where the ego does not close."""
    lead = seen.lead
    return (
        float("inf")
        if lead is None or lead.relative_speed >= 0.0
        else lead.gap / -lead.relative_speed
    )


class BrakesToAStop:
    """Brakes with 8 m/s2 whatever happens."""

    def act(self, seen: Observation) -> float:
        """The acceleration wanted, m/s2."""
        return -8.0


class StopsGently:
    """Brakes with 3 m/s2 whatever happens."""

    def act(self, seen: Observation) -> float:
        """The acceleration wanted, m/s2."""
        return -3.0


class LeavesTheRoad:
    """Steers to the right and off the road at once."""

    def act(self, seen: Observation) -> Command:
        """Its speed, and the wheel a quarter turned."""
        return Command(0.0, -1.5)


class Crawls:
    """Slows down gently to 60 % of its first speed and keeps it."""

    def __init__(self) -> None:
        self._wanted: float | None = None

    def act(self, seen: Observation) -> float:
        """The acceleration wanted, m/s2."""
        if self._wanted is None:
            self._wanted = 0.6 * seen.ego.speed
        return float(min(max(self._wanted - seen.ego.speed, -2.0), 2.0))


class Creeps:
    """Brakes with 3 m/s2 down to 2 m/s and keeps that."""

    def act(self, seen: Observation) -> float:
        """The acceleration wanted, m/s2."""
        return float(min(max(2.0 - seen.ego.speed, -3.0), 3.0))


class Follows:
    """Follows by the IDM, at its first speed on a free road."""

    def __init__(self) -> None:
        self._wanted: float | None = None

    def act(self, seen: Observation) -> float:
        """The acceleration wanted, m/s2."""
        speed, lead = seen.ego.speed, seen.lead
        self._wanted = speed if self._wanted is None else self._wanted
        gap, lead_speed = (float("inf"), speed) if lead is None else (lead.gap, lead.speed)
        return idm_acceleration(speed, self._wanted, gap, lead_speed, IdmParameters())


class RaisesInDanger(Follows):
    """Follows, and raises an exception at a TTC below 2.5 s."""

    def act(self, seen: Observation) -> float:
        """The acceleration wanted, m/s2."""
        if time_to_collision(seen) < DANGER:
            raise RuntimeError("too dangerous")
        return super().act(seen)


class EndsInDanger(Follows):
    """Follows, and ends its process at a TTC below 2.5 s."""

    def act(self, seen: Observation) -> float:
        """The acceleration wanted, m/s2."""
        if time_to_collision(seen) < DANGER:
            os._exit(1)
        return super().act(seen)


GAMES = (BrakesToAStop, StopsGently, LeavesTheRoad, Crawls, Creeps, RaisesInDanger, EndsInDanger)
POINTS = {"front_vehicle_low_speed": 32, "front_vehicle_cut_out": 32, "cut_in": 42}
"""Sobol points in each scenario, of which 77 meet its constraints."""


def evaluation(
    points: Mapping[str, int], ads: Sequence[AdsSettings], drivers: int = 10, workers: int = 2
) -> EvaluationSettings:
    """Some ADSs at Sobol points of some scenarios, of which some do not meet the constraints."""
    return EvaluationSettings(
        name="games",
        scenario=tuple(
            ScenarioSettings(name, SamplingSettings("sobol", count=count))
            for name, count in points.items()
        ),
        ads=tuple(ads),
        drivers=DriverSettings(count=drivers),
        run=RunSettings(workers=workers),
    )


def entries() -> list[AdsSettings]:
    """The games, and the ADSs that ship."""
    here = Path(__file__).resolve()
    games = [AdsSettings(game.__name__, f"{here}:{game.__name__}") for game in GAMES]
    return games + [AdsSettings(name, name) for name in SHIPPED]


def table(done: Evaluation) -> pd.DataFrame:
    """The mean of each score over the scenarios, a row for each ADS, in the order of S+."""
    rows = []
    for ads in done.settings.ads:
        own = [score for score in done.scores if score.ads == ads.name]
        values = [[getattr(score, name) for score in own] for name in COLUMNS.values()]
        means = [
            fmean(known) if (known := [one for one in value if one is not None]) else None
            for value in values
        ]
        incidents = [
            sum(getattr(score, name) for score in own)
            for name in ("avoidable_collisions", "departures", "gave_up")
        ]
        rows.append((ads.name, *means, *incidents))
    columns = ["ADS", *COLUMNS, "avoidable", "departed", "gave up"]
    return pd.DataFrame(rows, columns=columns).sort_values("S+", ascending=False)


def main() -> None:
    """Drive all, into the folder that the first argument names, and print the table."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch) / "run"
        done = sumo_eval.evaluate(evaluation(POINTS, entries()), folder)
        print(f"{len(done.cases) // len(done.settings.ads)} points")
        print(table(done).to_string(index=False, float_format="%.3f"))


if __name__ == "__main__":
    main()
