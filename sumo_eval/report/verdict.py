"""The verdict on a run: one word for programs, one sentence for a user who reads no further.

Users: `cli/compare.py`, `nightly/night.py`, `report/`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

from sumo_eval.report.gate_result import GateResult, LimitName, failed
from sumo_eval.report.words import count
from sumo_eval.results import Evaluation
from sumo_eval.scoring.comparison import Comparison

if TYPE_CHECKING:
    # they load scipy, which a look at a report does not need
    from sumo_eval.scoring.confidence.assessment import Confidence
    from sumo_eval.whatif.search import CaseLevers

Word = Literal["first", "same", "no_limit_failed", "worse", "incomplete"]


class Verdict(NamedTuple):
    """Verdict on a run.

    word: first (no base), same (equal to the bit), no_limit_failed, worse, or incomplete (cases
    have no partner).
    """

    word: Word
    sentence: str


class Additions(NamedTuple):
    """Content of a report in addition to the evaluation. A section without its part is left out.

    comparison, gates: the change since an earlier run.
    since: name of a failed limit (`GateResult.name`) -> when it began to fail, in words.
    notes: whole sentences on the run.
    confidence: how far the scores can be trusted.
    levers: of the worst case, what avoids its contact.
    """

    comparison: Comparison | None = None
    gates: tuple[GateResult, ...] = ()
    since: Mapping[LimitName, str] = {}
    notes: tuple[str, ...] = ()
    confidence: Confidence | None = None
    levers: CaseLevers | None = None


def verdict(
    comparison: Comparison | None, gates: Sequence[GateResult], evaluation: Evaluation
) -> Verdict:
    """Verdict on the newer run: limits, changes, avoidable collisions, cases not evaluated."""
    word, standing = _standing(comparison, gates)
    avoidable = sum(score.avoidable_collisions for score in evaluation.scores)
    ending = count(avoidable, "avoidable collision") if avoidable else "no avoidable collision"
    if missing := evaluation.not_evaluated:
        ending += f", {count(missing, 'case')} not evaluated"
    return Verdict(word, f"{standing}; {ending}.")


def _standing(comparison: Comparison | None, gates: Sequence[GateResult]) -> tuple[Word, str]:
    failures = failed(gates)
    limits = f"{count(len(failures), 'limit')} failed"
    if comparison is None:
        no_base = "there is no earlier good run to compare with"
        return "first", f"NOT GOOD: {limits}; {no_base}" if failures else f"FIRST: {no_base}"

    base = comparison.base_folder.name
    # Where every limit failed only in comparison with the accepted night, of which there is one,
    # the sentence names that night instead of the base.
    against = {gate.against for gate in failures}
    than = f"the accepted {against.pop()}" if failures and "" not in against else base
    if failures and all(gate.quantity == "pairs" for gate in failures):
        return "incomplete", f"INCOMPLETE beside {than}: {failures[0].sentence}"
    worse, better, pairs = comparison.worse, comparison.better, comparison.pairs
    moved = f"outcome or likeness worse in {count(worse, 'case')}, better in {better}"
    if failures:
        # limits on values of the new run alone do not say that it became worse
        how = "NOT GOOD beside" if all(gate.own for gate in failures) else "WORSE than"
        moved = moved if than == base else f"beside {base} {moved}"
        return "worse", f"{how} {than}: {limits}; {moved}"
    equal = "equal to the last bit"
    if comparison.identical:
        return "same", f"THE SAME as {base}: {count(pairs, 'case')} {equal}"
    alike = sum(part.identical for part in comparison.ads)
    hardly = pairs - alike - worse - better  # cases changed by less than the tolerances
    words = [moved] if worse or better else []
    if hardly > 0:
        less = "changed by less than the tolerances of outcome and likeness"
        words.append(f"{count(hardly, 'case')} {less}")
    words = words or [f"{count(alike, 'case')} {equal}"]
    if lost := sum(group.lost for group in comparison.unpaired):
        words.append(f"{lost} of the base have no partner")
    return "no_limit_failed", f"NO LIMIT FAILED beside {base}: {', '.join(words)}"
