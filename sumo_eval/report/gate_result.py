"""Outcome of a limit, and the cases that it names. `nightly` makes them.

Users: `cli/compare.py`, `nightly/`, `report/`.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

from sumo_eval.cases import CaseResult
from sumo_eval.scoring.gate_settings import ENDS
from sumo_eval.text import point_words

MOST_NAMED = 5  # cases of a failed limit that are shown with their values
MOST_KEYS = 1_000  # cases that a failed limit names by key
LimitName = tuple[str, str, str, str]  # ADS, scenario, quantity, bound


class CaseChange(NamedTuple):
    """A case that a limit names.

    point: in words.
    before, after: in base and new run: the limit's quantity, or how the case ended; None: unknown.
    unit: of the quantity, after a space; "" without one.
    name: of the quantity, in words; "": the sentence of the limit has it.
    """

    case: str
    point: str
    before: float | str | None
    after: float | str | None
    unit: str = ""
    name: str = ""

    @classmethod
    def of(
        cls, case: CaseResult, before: float | str | None, after: float | str, unit: str = ""
    ) -> Self:
        """The change of a row of the new run."""
        return cls(case.case, point_words(case.values), before, after, unit)

    @property
    def words(self) -> str:
        """`0.92 m -> 0.32 m`, or `smallest gap ahead 0.92 m -> 0.32 m`."""
        return f"{self.name} ".lstrip() + " -> ".join(
            f"{value:z.4g}{self.unit}" if isinstance(value, float) else value or "none"
            for value in (self.before, self.after)
        )


class GateResult(NamedTuple):
    """One limit applied to one ADS, or to "every ADS", in one logical scenario, or in "all
    scenarios".

    passed: None if the limit could not be evaluated; then the sentence has the reason.
    reason: why it could not be evaluated; equal reasons share a line. "": the sentence tells it.
    blind: the quantity in words, if the cases of this ADS cannot show a change of it; else "".
    bound: of a gate file, in words; "" for the rule.
    threshold: the value of the new run at which it would fail, for drawing.
    cases: keys of the cases that a failed limit is about, at most `MOST_KEYS`.
    worst: the worst of them.
    against: name of the accepted night, if the limit failed only in comparison with it; else "".
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
    bound: str = ""

    @property
    def name(self) -> LimitName:
        """Identity of the limit across nights: several bounds may limit one quantity."""
        return self.ads, self.scenario, self.quantity, self.bound


def in_order(
    results: Sequence[GateResult], nights: Mapping[LimitName, int]
) -> tuple[GateResult, ...]:
    """Limits that failed, that passed, and that could not be evaluated.

    Within each of these groups, limits that have failed for fewer nights come first, and of these
    bad ends, the gravest first. Equal limits keep their order.

    nights: for how many nights each limit has failed, by its name; none: 0.
    """
    # the graver a bad end, the further below 0; other quantities: 0
    grave = {end: -rank for rank, end in enumerate(("severity", *reversed(ENDS)), 1)}

    def place(gate: GateResult) -> tuple[int, int, int]:
        passed = [False, True, None].index(gate.passed)
        return passed, nights.get(gate.name, 0), grave.get(gate.quantity, 0)

    return tuple(sorted(results, key=place))


def failed(results: Sequence[GateResult]) -> tuple[GateResult, ...]:
    """The limits that failed, without limits that could not be evaluated."""
    return tuple(result for result in results if result.passed is False)
