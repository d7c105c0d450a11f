"""Qualification of an installation, `sumo-eval qualify`: carry out checks, show their results.

Users: `extras/studies/qualify_command.py`.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from sumo_eval.errors import SumoEvalError
from sumo_eval.extras.studies.qualification.table import Answer, Check
from sumo_eval.groups import grouped
from sumo_eval.record.run_folder import versions_and_machine
from sumo_eval.report.page import Json, write_filled, write_json
from sumo_eval.text import timestamp

FORMAT_VERSION = 1
ENTRIES = "kind", "name", "source", "expected", "found", "bound", "unit", "passed", "error"
"""Keys of a check in `qualification.json`, in their order."""
PURPOSE = (
    "Shows on this machine that this installation of sumo_eval finds known answers: outcomes of "
    "drives in closed form, values of regulations, equations written a second time, and the same "
    "digits again."
)
DOMAIN = (
    "Vehicles on straight roads with lanes at up to 40 m/s: following, braking, cut-in, cut-out "
    "and lane change; the single-track vehicle model with its brakes; indexes C, D and S and the "
    "quantities behind them."
)
LIMITS = (
    "It qualifies the tool, not an ADS and not a scenario space, whose content it does not check.",
    "Vehicles are rectangles, tyres a friction limit, sensors perfect: needs beyond that are not "
    "covered.",
    "Consensus rows are those where independent readings of the regulation agree; next to the "
    "limit they do not.",
    "Curves, junctions, pedestrians and SUMO's own traffic are covered by the project's tests, not "
    "by this command.",
    "It is valid for the versions and the machine named here, and for no other.",
)


class CheckResult(NamedTuple):
    """Result of a check.

    found: the tool's answer; None: the tool failed.
    error: why the tool failed; empty: it gave an answer.
    """

    check: Check
    found: Answer | None
    error: str

    @property
    def passed(self) -> bool:
        """Whether the answer is right: words equal, numbers within the bound; nan is not."""
        expected = self.check.expected
        if isinstance(self.found, float) and isinstance(expected, float):
            return bool(abs(self.found - expected) <= self.check.bound)
        return self.found == expected

    def plain(self) -> Json:
        """The check in `qualification.json`; a number that is not finite becomes its name: JSON has
        no nan.
        """
        answer = self.found
        if isinstance(answer, float) and not math.isfinite(answer):
            answer = str(answer)
        entry = {"found": answer, "passed": self.passed, "error": self.error}
        entry |= self.check._asdict()
        return {name: entry[name] for name in ENTRIES}


def carry_out(check: Check) -> CheckResult:
    """The result of a check; a check with an error of the tool does not pass."""
    try:
        return CheckResult(check, check.find(*check.arguments), "")
    except SumoEvalError as fault:
        return CheckResult(check, None, str(fault))


class Qualification(NamedTuple):
    """Results of all checks.

    findings: one a check, in the order of the checks.
    versions: of Python and of the packages, by name.
    machine: system, processor and name of the machine.
    created: when, UTC, in ISO format.
    """

    findings: tuple[CheckResult, ...]
    versions: dict[str, str]
    machine: dict[str, str]
    created: str

    @property
    def failed(self) -> tuple[CheckResult, ...]:
        """The results that did not pass."""
        return tuple(finding for finding in self.findings if not finding.passed)

    @property
    def kinds(self) -> dict[str, list[CheckResult]]:
        """The kinds of checks in order, each with its results."""
        return grouped((finding.check.kind, finding) for finding in self.findings)

    def plain(self) -> Json:
        """The content of `qualification.json`."""
        return {
            "format_version": FORMAT_VERSION, "created": self.created, "purpose": PURPOSE,
            "domain": DOMAIN, "limits": LIMITS, "passed": not self.failed,
            "versions": self.versions, "machine": self.machine,
            "checks": [finding.plain() for finding in self.findings]
        }  # fmt: skip


def qualify(checks: Iterable[Check], watch: Callable[[str, int, int], None]) -> Qualification:
    """Carry out checks, at least one.

    watch: called before each check and at the end, with the kind, the number of checks done and
        the number of all.
    """
    listed = list(checks)
    findings = []
    for number, check in enumerate(listed):
        watch(check.kind, number, len(listed))
        findings.append(carry_out(check))
    watch(listed[-1].kind, len(listed), len(listed))
    packages = "sumo_eval", "libsumo", "numpy", "scipy", "scikit-learn", "numba"
    return Qualification(
        tuple(findings),
        created=timestamp(),
        **versions_and_machine(packages),
    )


# --- as text and as files -------------------------------------------------------------------------

_HEAD = f"     {'check':<40} {'expected':>9} {'found':>9} {'bound':>7} unit"


def shown(value: Answer | None) -> str:
    """An answer as text; a number has 5 digits, or as many as fit into 9 characters."""
    if not isinstance(value, float):
        return value or "nothing"
    texts = (f"{value:z.{digits}g}" for digits in (5, 4, 3, 2))
    return next(text for text in texts if len(text) <= 9)


def lines(qualification: Qualification) -> Iterator[str]:
    """The results for a terminal of 80 columns: a table for each kind, then why checks failed."""
    for kind, results in qualification.kinds.items():
        yield kind
        yield _HEAD
        for result in results:
            check = result.check
            bound = "" if isinstance(check.expected, str) else f"{check.bound:.2g}"
            row = f"{shown(check.expected):>9} {shown(result.found)[:9]:>9} {bound:>7} {check.unit}"
            yield f"{'ok' if result.passed else 'FAIL':<4} {check.name:<40} {row}".rstrip()
    for check, answer, error in qualification.failed:
        why = error or f"expected {shown(check.expected)}, found {shown(answer)}"
        yield f"FAIL  {check.name}: {why}"
    total = len(qualification.findings)
    verdict = "NOT qualified." if qualification.failed else "qualified on this machine."
    passed = total - len(qualification.failed)
    yield f"{passed} of {total} checks passed: this installation is {verdict}"


def write_qualification(qualification: Qualification, folder: Path) -> tuple[Path, Path]:
    """Write `qualification.html` and `qualification.json` into a folder and return their paths."""
    page, plain = folder / "qualification.html", folder / "qualification.json"
    write_filled(
        page, "qualification.html.j2", "The qualification",
        qualification=qualification, kinds=qualification.kinds, purpose=PURPOSE, domain=DOMAIN,
        limits=LIMITS, shown=shown
    )  # fmt: skip
    write_json(plain, qualification.plain(), "The qualification")
    return page, plain
