"""A check: a known answer, how it is found on this machine, and how far both may be apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from sumo_eval.errors import SumoEvalError

Answer = float | str


@dataclass(frozen=True, slots=True)
class Check:
    """kind: the group it belongs to. name: at most 40 characters. source: of the expected answer. find: finds it
    through the tool. bound: largest difference of numbers that passes, in `unit`; words must be equal.
    """

    kind: str
    name: str
    source: str
    expected: Answer
    find: Callable[[], Answer]
    bound: float = 0.0
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    """What a check found; `error` says why it found nothing, and is empty otherwise."""

    kind: str
    name: str
    source: str
    expected: Answer
    found: Answer | None
    bound: float
    unit: str
    passed: bool
    error: str


def made(check: Check) -> Finding:
    """The check, carried out; a fault of the tool is a check that failed, with its sentence."""
    found: Answer | None
    try:
        found, error = check.find(), ""
    except SumoEvalError as fault:
        found, error = None, str(fault)
    if isinstance(found, float) and isinstance(check.expected, float):
        passed = abs(found - check.expected) <= check.bound  # nan does not pass
    else:
        passed = found is not None and found == check.expected
    return Finding(check.kind, check.name, check.source, check.expected, found, check.bound, check.unit, passed, error)
