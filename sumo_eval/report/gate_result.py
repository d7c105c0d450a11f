"""Outcome of a limit, and the cases that it names. `nightly` makes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sumo_eval.cases import CaseResult
from sumo_eval.text import point_words

MOST_NAMED = 5  # cases of a failed limit that are shown with their values
MOST_KEYS = 1_000  # cases that a failed limit names by key


@dataclass(frozen=True, slots=True)
class CaseChange:
    """A case that a limit names.

    point: in words.
    before, after: the limit's quantity, or how the case ended.
    """

    case: str
    point: str
    before: float | str | None
    after: float | str | None

    @classmethod
    def of(cls, case: CaseResult, before: float | str | None, after: float | str) -> CaseChange:
        """The change of a row of the new run."""
        return cls(case.case, point_words(case.values), before, after)

    @property
    def words(self) -> str:
        """`0.92 -> 0.32`."""
        return " -> ".join(
            "none" if value is None else value if isinstance(value, str) else f"{value:z.4g}"
            for value in (self.before, self.after)
        )


@dataclass(frozen=True, slots=True)
class GateResult:
    """One limit applied to one ADS, or to "every ADS", in one logical scenario, or in "all
    scenarios".

    passed: None if the limit could not be evaluated; then the sentence has the reason.
    reason: why it could not be evaluated: limits with equal reasons share a line; "": the sentence.
    blind: the quantity in words, if the cases of this ADS cannot show a change of it; else "".
    threshold: the value of the new run at which it would fail, for drawing.
    cases: keys of the cases that a failed limit is about, at most `MOST_KEYS`.
    worst: the worst of them.
    against: name of the accepted night, if the limit failed only beside that one; else "".
    own: whether it bounds a value of the new run alone, so that no base changes it.
    """

    quantity: str
    ads: str
    scenario: str
    passed: bool | None
    sentence: str
    value: float | None = None
    threshold: float | None = None
    cases: tuple[str, ...] = ()
    worst: tuple[CaseChange, ...] = ()
    against: str = ""
    own: bool = False
    reason: str = ""
    blind: str = ""

    @property
    def name(self) -> tuple[str, str, str]:
        """Identity of the limit across nights: ADS, scenario, quantity."""
        return self.ads, self.scenario, self.quantity


def failed(results: Sequence[GateResult]) -> tuple[GateResult, ...]:
    """The limits that failed; those that could not be evaluated are not among them."""
    return tuple(result for result in results if result.passed is False)
