"""Drive ADSs of known order and count how often each score puts the worse one first: `python
tools/ladder.py [FOLDER]`.

The ladder is a family of plain policies that differ in one thing at a time: how long they take to
react, how hard they brake, how far they see, how unsteady their foot is, how fast they drive. They
drive about 97 points of `front_vehicle_cut_out`, `cut_in` and `front_vehicle_braking` in one
evaluation. Of two rungs, one is *better* in a scenario if its severity U is not higher in any case
and lower in one. A score orders such a pair (the better one has more), ties it, or has it wrong.
Prints the table of docs/trust.md. FOLDER: where the run shall stand; default: a temporary one.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

import sumo_eval
from sumo_eval.cosim.doors.observation import Observation
from sumo_eval.results import Evaluation
from sumo_eval.settings import (
    AdsSettings,
    EvaluationSettings,
    RunSettings,
    SamplingSettings,
    ScenarioSettings,
)

NOTICED_TTC = 6.0  # s, from which on a vehicle that comes nearer is a danger
WOBBLE_PERIOD = 4.0  # s
EASED = 2.0  # m/s2 at most, to its pace
EQUAL = 1e-9  # m/s of U, and of every score
SCORES = {"C": "c", "S": "s", "A": "avoided_share", "A'": "avoidance_grade", "S+": "s_plus"}


class Rung(NamedTuple):
    """reaction: s.
    braking: m/s2.
    sight: m.
    wobble: amplitude of an unsteady foot, m/s2.
    pace: of its first speed.
    """

    reaction: float
    braking: float
    sight: float
    wobble: float
    pace: float = 1.0

    @property
    def name(self) -> str:
        """The ADS's name in the tables."""
        return (
            "reaction {:g} s, braking {:g} m/s2, sight {:g} m, wobble {:g} m/s2, pace {:g}".format(
                *self
            )
        )

    @property
    def identifier(self) -> str:
        """The name of its class in this module."""
        return "rung_" + "_".join(f"{round(10 * value)}" for value in self)


RUNGS = (
    *(Rung(t, b, s, 0.0) for t in (0.2, 0.6, 1.2, 2.0) for b in (4.0, 8.0) for s in (25.0, 80.0)),
    *(Rung(0.6, 8.0, sight, 0.0) for sight in (35.0, 50.0)),
    *(Rung(0.6, 8.0, 80.0, wobble) for wobble in (0.5, 1.0, 2.0, 4.0)),
    *(Rung(reaction, 8.0, 80.0, 0.0) for reaction in (0.4, 0.9, 1.6)),
    Rung(0.6, 6.0, 80.0, 0.0),
    *(Rung(0.6, 8.0, 80.0, 0.0, pace) for pace in (0.9, 0.8, 0.7, 0.6)),
)


class Driver:
    """Keeps its speed; brakes for who comes nearer, from `reaction` s after it saw that, until he
    no longer does.
    """

    rung: Rung

    def __init__(self) -> None:
        self._noticed = math.inf
        self._first: float | None = None

    def act(self, seen: Observation) -> float:
        """The acceleration wanted, m/s2."""
        rung, lead, speed = self.rung, seen.lead, float(seen.ego.speed)
        self._first = speed if self._first is None else self._first
        comes_nearer = lead is not None and lead.gap < rung.sight and lead.relative_speed < 0.0
        if lead is not None and comes_nearer and lead.gap < -NOTICED_TTC * lead.relative_speed:
            self._noticed = min(self._noticed, seen.time)
        if comes_nearer and seen.time >= self._noticed + rung.reaction:
            return -rung.braking
        if rung.pace < 1.0:
            return max(min(rung.pace * self._first - speed, 0.0), -EASED)
        return rung.wobble * math.cos(math.tau * seen.time / WOBBLE_PERIOD)


for _rung in RUNGS:
    globals()[_rung.identifier] = type(
        _rung.identifier, (Driver,), {"rung": _rung, "__module__": __name__}
    )


SPACES = (
    ScenarioSettings("front_vehicle_cut_out", SamplingSettings(method="sobol", count=48)),
    ScenarioSettings("cut_in", SamplingSettings(method="sobol", count=53)),
    ScenarioSettings("front_vehicle_braking", SamplingSettings(method="sobol", count=28)),
)


def climb(rungs: Sequence[Rung], scenarios: Sequence[ScenarioSettings], folder: Path) -> Evaluation:
    """The evaluation of rungs of the ladder.

    folder: of the run; must not exist.
    """
    here = Path(__file__).resolve()
    settings = EvaluationSettings(
        name="ladder",
        scenario=tuple(scenarios),
        ads=tuple(AdsSettings(rung.name, f"{here}:{rung.identifier}") for rung in rungs),
        run=RunSettings(workers=2),
    )
    return sumo_eval.evaluate(settings, folder)


class Pair(NamedTuple):
    """Two ADSs in a scenario, and how each score orders them: 1 right, 0 tied, -1 wrong; None: it
    has no number.
    """

    scenario: str
    better: str
    worse: str
    orders: dict[str, int | None]


def ordered_pairs(evaluation: Evaluation) -> list[Pair]:
    """Every pair of which one ADS is no worse in any case of a scenario, and better in one."""
    severities: dict[tuple[str, str], dict[tuple[float, ...], float]] = {}
    for case in evaluation.cases:
        assert case.evaluated, (case.ads, case.case, case.error)
        severities.setdefault((case.scenario, case.ads), {})[tuple(case.values.values())] = (
            case.severity or 0.0
        )
    found = []
    for (scenario, one), (place, other) in permutations(severities, 2):
        if scenario != place:
            continue
        mine, theirs = severities[scenario, one], severities[scenario, other]
        assert mine.keys() == theirs.keys()
        gains = [theirs[case] - mine[case] for case in mine]
        if min(gains) >= -EQUAL and max(gains) > EQUAL:
            scores = [_scores(evaluation.score(ads, scenario)) for ads in (one, other)]
            orders = {name: _order(scores[0][name], scores[1][name]) for name in SCORES}
            found.append(Pair(scenario, one, other, orders))
    return found


def _scores(score: Any) -> dict[str, float | None]:
    return {name: getattr(score, attribute, None) for name, attribute in SCORES.items()}


def _order(better: float | None, worse: float | None) -> int | None:
    if better is None or worse is None:
        return None
    return (better > worse + EQUAL) - (better < worse - EQUAL)


def table(pairs: Sequence[Pair]) -> pd.DataFrame:
    """One row for each score, in each scenario and in all of them: pairs, ordered, tied, wrong."""
    rows = []
    for scenario in (*dict.fromkeys(pair.scenario for pair in pairs), "all"):
        mine = [pair.orders for pair in pairs if scenario in (pair.scenario, "all")]
        for name in SCORES:
            found = [order[name] for order in mine]
            rows.append(
                (scenario, name, len(found), *(found.count(kind) for kind in (1, 0, -1, None)))
            )
    return pd.DataFrame(
        rows, columns=["scenario", "score", "pairs", "ordered", "tied", "wrong", "without a score"]
    )


def main() -> None:
    """Climb the whole ladder, print the table."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch) / "run"
        evaluation = climb(RUNGS, SPACES, folder)
        print(f"{len(RUNGS)} ADSs, {len(evaluation.cases) // len(RUNGS)} points")
        print(table(ordered_pairs(evaluation)).to_string(index=False))
        if evaluation.ranking is not None:
            pairs = evaluation.ranking.pairs
            print(
                f"{sum(pair.told_apart for pair in pairs)} of {len(pairs)} pairs told apart over "
                "all scenarios"
            )


if __name__ == "__main__":
    main()
