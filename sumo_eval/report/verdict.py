"""The verdict on a run: one word for programs, one sentence for a user who reads no further."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sumo_eval.report.comparison import Comparison
from sumo_eval.report.gate_result import GateResult
from sumo_eval.report.words import count
from sumo_eval.results import Evaluation

Word = Literal["first", "same", "no_limit_failed", "worse", "incomplete"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """word: first (no base), same (equal to the bit), no_limit_failed, worse, or incomplete (cases
    have no partner).
    """

    word: Word
    sentence: str


def verdict(
    comparison: Comparison | None, gates: Sequence[GateResult], evaluation: Evaluation
) -> Verdict:
    """Limits, changes, and avoidable collisions of the newer run."""
    word, standing = _standing(comparison, gates)
    avoidable = sum(score.avoidable_collisions for score in evaluation.scores)
    hit = count(avoidable, "avoidable collision") if avoidable else "no avoidable collision"
    return Verdict(word, f"{standing}; {hit}.")


def _standing(comparison: Comparison | None, gates: Sequence[GateResult]) -> tuple[Word, str]:
    bad = [gate for gate in gates if gate.passed is False]
    if comparison is None:
        alone = "there is no earlier good run to compare with"
        return (
            "first",
            f"NOT GOOD: {count(len(bad), 'limit')} failed; {alone}" if bad else f"FIRST: {alone}",
        )

    base = Path(comparison.base_folder).name
    if bad and all(gate.quantity == "pairs" for gate in bad):
        return "incomplete", f"INCOMPLETE beside {base}: {bad[0].sentence}"
    if bad:
        failed = count(len(bad), "limit")
        return "worse", f"WORSE than {base}: {failed} failed; {_moved(comparison)}"
    if comparison.identical:
        return (
            "same",
            f"THE SAME as {base}: {count(comparison.pairs, 'case')} equal to the last bit",
        )
    return "no_limit_failed", f"NO LIMIT FAILED beside {base}: {_changes(comparison)}"


def _moved(comparison: Comparison) -> str:
    """`outcome or likeness worse in 2 cases, better in 1`."""
    return (
        f"outcome or likeness worse in {count(comparison.worse, 'case')}, better in "
        f"{comparison.better}"
    )


def _changes(comparison: Comparison) -> str:
    """`outcome or likeness worse in 2 cases, better in 1, 5 cases changed by less than the
    tolerances`, or how many are equal to the last bit.
    """
    worse, better = comparison.worse, comparison.better
    equal = sum(one.identical for one in comparison.ads)
    less, lost = (
        comparison.pairs - equal - worse - better,
        sum(one.lost for one in comparison.unpaired),
    )
    words = [_moved(comparison)] if worse or better else []
    words += [f"{count(less, 'case')} changed by less than the tolerances"] if less > 0 else []
    words = words or [f"{count(equal, 'case')} equal to the last bit"]
    return ", ".join([*words, f"{lost} of the base have no partner"] if lost else words)
