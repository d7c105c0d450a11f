"""One line to cite a run by: what was evaluated, with which versions, what came out, and how to see
it again.

Users: `cli/finish.py`, `report/html.py`, `report/notebook.py`.
"""

import hashlib
import json
import shlex

from sumo_eval.results import Evaluation
from sumo_eval.scoring.case_terms import COMPUTED
from sumo_eval.settings.config import suite_of

DIGITS = 6
"""Decimals of a score that the digest holds: the last bits differ from machine to machine."""


def citation(evaluation: Evaluation) -> str:
    """`Cite: suite 2026.1; sumo_eval 0.2.0, libsumo 1.28.0; seed 1; scores 3f2a91c04b7e; check:
    sumo-eval verify ...`.
    """
    suite = suite_of(evaluation.settings)
    versions = evaluation.manifest.get("versions", {})
    used = ", ".join(
        f"{name} {versions.get(name, 'not known')}" for name in ("sumo_eval", "libsumo")
    )
    what = f"suite {suite}" if suite else f"evaluation {evaluation.name}"
    command = f"sumo-eval verify {shlex.quote(str(evaluation.folder))} --share 1"
    return (
        f"Cite: {what}; {used}; seed {evaluation.settings.seed}; scores {digest(evaluation)}; "
        f"check: {command}"
    )


def digest(evaluation: Evaluation) -> str:
    """Twelve digits of a SHA-256 of every ADS's scores and counts of cases, collisions, departures
    and of giving up: equal digests mean equal results.
    """
    rows = [
        [score.ads, score.scenario, score.cases, score.collisions, score.departures, score.gave_up]
        + [
            # + 0.0 makes -0.0 positive
            None if (value := getattr(score, name)) is None else round(value, DIGITS) + 0.0
            for name in COMPUTED
        ]
        for score in sorted(evaluation.scores, key=lambda score: (score.ads, score.scenario))
    ]
    return hashlib.sha256(json.dumps(rows).encode()).hexdigest()[:12]
