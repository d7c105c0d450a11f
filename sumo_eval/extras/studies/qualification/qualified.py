"""All checks in their order, and what came of them on this machine."""

from __future__ import annotations

import math
import platform
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from sumo_eval.errors import SumoEvalError
from sumo_eval.extras.studies.qualification.table import Answer, Check

FORMAT_VERSION = 1
ENTRIES = ("kind", "name", "source", "expected", "found", "bound", "unit", "passed", "error")
PURPOSE = (
    "Shows on this machine that this installation of sumo_eval finds what is known: outcomes of "
    "drives in closed form, "
    "values of regulations, equations written a second time, and the same digits again."
)
DOMAIN = (
    "Vehicles on straight roads with lanes at up to 40 m/s: following, braking, cut-in, cut-out "
    "and lane change; the "
    "single-track vehicle model with its brakes; indexes C, D and S and the quantities they are "
    "made of."
)
LIMITS = (
    "It qualifies the tool, not an ADS and not a scenario space: whether a space holds what "
    "matters is not asked.",
    "Vehicles are rectangles, tyres a friction limit, sensors perfect: what needs more than that "
    "is not covered.",
    "Consensus rows are those where independent readings of the regulation agree; next to the "
    "limit they do not.",
    "Bends, junctions, people on foot and SUMO's own traffic are held by the project's tests, not "
    "by this command.",
    "It is valid for the versions and the machine named here, and for no other.",
)


@dataclass(frozen=True, slots=True)
class Finding:
    """What a check found; `error` says why it found nothing, and is empty otherwise."""

    check: Check
    found: Answer | None
    error: str

    @property
    def passed(self) -> bool:
        """Words are equal, numbers within the bound; nan does not pass."""
        expected = self.check.expected
        if isinstance(self.found, float) and isinstance(expected, float):
            return abs(self.found - expected) <= self.check.bound
        return self.found is not None and self.found == expected

    def plain(self) -> dict[str, Any]:
        """An entry of `qualification.json`; a number that is not finite is written as a word."""
        told = self.check._asdict() | {
            "found": self.found,
            "passed": self.passed,
            "error": self.error,
        }
        values = {name: told[name] for name in ENTRIES}
        endless = {
            name
            for name, value in values.items()
            if isinstance(value, float) and not math.isfinite(value)
        }
        return {name: str(value) if name in endless else value for name, value in values.items()}


def made(check: Check) -> Finding:
    """The check, carried out; a fault of the tool is a check that failed, with its sentence."""
    try:
        return Finding(check, check.find(*check.arguments), "")
    except SumoEvalError as fault:
        return Finding(check, None, str(fault))


@dataclass(frozen=True, slots=True)
class Qualification:
    """findings: in the order of the checks.
    versions, machine: what they hold for.
    created: UTC.
    """

    findings: tuple[Finding, ...]
    versions: dict[str, str]
    machine: dict[str, str]
    created: str

    @property
    def failed(self) -> tuple[Finding, ...]:
        """The findings that did not pass."""
        return tuple(finding for finding in self.findings if not finding.passed)

    def plain(self) -> dict[str, Any]:
        """The content of `qualification.json`."""
        return {
            "format_version": FORMAT_VERSION, "created": self.created, "purpose": PURPOSE,
            "domain": DOMAIN,
            "limits": list(LIMITS), "passed": not self.failed, "versions": self.versions,
            "machine": self.machine,
            "checks": [item.plain() for item in self.findings],
        }  # fmt: skip


def qualify(checks: Iterable[Check], watch: Callable[[str, int, int], None]) -> Qualification:
    """Carry out checks, at least one.

    watch: called with the kind, how many are done and of how many.
    """
    listed = list(checks)
    findings = []
    for number, check in enumerate(listed):
        watch(check.kind, number, len(listed))
        findings.append(made(check))
    watch(listed[-1].kind, len(listed), len(listed))
    packages = ("sumo_eval", "libsumo", "numpy", "scipy", "scikit-learn", "numba")
    versions = {"python": sys.version.split()[0], **{name: version(name) for name in packages}}
    machine = {
        "system": platform.platform(),
        "processor": platform.machine(),
        "node": platform.node(),
    }
    return Qualification(
        tuple(findings), versions, machine, datetime.now(UTC).isoformat(timespec="seconds")
    )
