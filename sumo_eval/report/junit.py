"""JUnit XML for continuous integration: a failure is the ADS doing badly, an error is a harness that could not tell.

Written by lxml in the shape that Jenkins, GitLab and the usual GitHub actions read.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from lxml import etree

from sumo_eval.errors import InputError
from sumo_eval.report.comparison import ChangedCase, Comparison
from sumo_eval.report.gates import GateResult
from sumo_eval.report.words import count, end_reason, number, placed, point, unevaluated
from sumo_eval.results import CaseResult, Evaluation
from sumo_eval.settings import ReportSettings

JUNIT = "junit.xml"
Verdict = Literal["passed", "failure", "error", "skipped"]


@dataclass(frozen=True, slots=True)
class Test:
    """One JUnit test. kind: the machine-readable type of a failure or an error; text: what a person reads of it."""

    name: str
    verdict: Verdict
    kind: str = ""
    message: str = ""
    text: str = ""
    seconds: float = 0.0


Suites = Mapping[tuple[str, str], Sequence[Test]]
"""Tests by (name of the suite, class name)."""


def run_suites(evaluation: Evaluation) -> Suites:
    """A suite for each ADS in each logical scenario, with a test for each case or for each cell of the space."""
    reasons = {case.case: placed(sentence, case) for case, sentence in unevaluated(evaluation)}
    report = evaluation.settings.report
    suites: dict[tuple[str, str], list[Test]] = {}
    for score in evaluation.scores:
        cases = evaluation.cases_of(score.ads, score.scenario)
        tests = [_case_test(case, reasons.get(case.case), report) for case in cases]
        if report.junit == "cell":
            tests = _by_cell(cases, tests, report.junit_cells)
        suites[f"{score.ads} in {score.scenario}", f"{score.scenario}.{score.ads}"] = tests
    return suites


def comparison_suites(comparison: Comparison | None, gates: Sequence[GateResult]) -> Suites:
    """A suite of the gates, and one for each ADS in each logical scenario with a test for each case of both runs."""
    suites: dict[tuple[str, str], list[Test]] = {
        ("gates", "gates"): [
            Test(
                f"{gate.quantity} of {gate.ads} in {gate.scenario}",
                "skipped" if gate.passed is None else "passed" if gate.passed else "failure",
                "gate",
                gate.sentence,
            )
            for gate in gates
        ]
    }
    for one in comparison.ads if comparison else ():
        changed = {one.changed.which[place]: place for place in range(len(one.changed))}
        suites[f"{one.ads} in {one.scenario} beside the base", f"change.{one.scenario}.{one.ads}"] = [
            _change_test(case, one.changed[changed[place]] if place in changed else None)
            for place, case in enumerate(one.new_cases)
        ]
    return suites


def write_junit(suites: Suites, path: Path) -> Path:
    """Write the suites to a file and return its path."""
    root = etree.Element("testsuites", name="sumo_eval")
    totals: Counter[str] = Counter()
    for (name, classname), tests in suites.items():
        found = Counter(test.verdict for test in tests)
        suite = etree.SubElement(
            root, "testsuite", name=_clean(name), tests=str(len(tests)), failures=str(found["failure"]),
            errors=str(found["error"]), skipped=str(found["skipped"]),
            time=f"{math.fsum(test.seconds for test in tests):z.3f}",
        )  # fmt: skip
        totals.update(tests=len(tests), failures=found["failure"], errors=found["error"], skipped=found["skipped"])
        for test in tests:
            item = etree.SubElement(
                suite, "testcase", name=_clean(test.name), classname=_clean(classname), time=f"{test.seconds:z.3f}"
            )
            if test.verdict != "passed":
                verdict = etree.SubElement(item, test.verdict, type=_clean(test.kind), message=_clean(test.message))
                verdict.text = _clean(test.text) or None
    for key in ("tests", "failures", "errors", "skipped"):
        root.set(key, str(totals[key]))
    try:
        etree.ElementTree(root).write(path, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    except OSError as error:
        raise InputError(f"The JUnit file {path} cannot be written: {error}.") from error
    return path


def _case_test(case: CaseResult, reason: str | None, report: ReportSettings) -> Test:
    name, seconds = f"{point(case.values)}", case.wall_time or 0.0
    if not case.evaluated:
        return Test(name, "error", case.status, _first_line(reason or case.status), reason or "", seconds)
    if case.status == "off_road":
        return Test(name, "failure", "off_road", f"{case.ads} left the road", _facts(case), seconds)
    # Where the ideal vehicle's case is not known, nobody can say that the collision was unavoidable.
    if case.collided and (report.junit_failures == "any" or not case.unavoidable):
        kind = "caused" if case.caused else "avoidable" if case.avoidable else "unavoidable"
        which = f"{kind} collision" if case.ideal_severity is not None else "collision"
        message = f"{which} of {case.ads} in the {case.zone} zone at {number(case.impact_speed, 1)} m/s"
        return Test(name, "failure", "collision", message, _facts(case), seconds)
    if case.requirements_missed:
        message = f"{case.ads} misses: {case.requirements_missed}"
        return Test(name, "failure", "requirement", message, _facts(case), seconds)
    if reason is not None:
        return Test(name, "error", "not_evaluated", _first_line(reason), reason, seconds)
    return Test(name, "passed", seconds=seconds)


def _facts(case: CaseResult) -> str:
    lines = [f"case {case.case}", f"end: {end_reason(case)}"]
    if case.collided:
        ideal, nothing = (
            "not known" if value is None else f"{number(value, 2)} m/s"
            for value in (case.ideal_severity, case.no_reaction_severity)
        )
        lines.append(
            f"U = {number(case.severity, 2)} m/s, Ug of the ideal vehicle = {ideal}, U0 of doing nothing = {nothing}, "
            f"overlap {number(case.overlap, 2)}, hit at the {case.side}"
        )
    return "\n".join(lines)


def _change_test(case: CaseResult, change: ChangedCase | None) -> Test:
    name = point(case.values)
    if change is None or not change.worse:
        return Test(name, "passed")
    by = "" if change.by is None else f" by {abs(change.by):z.3g}"
    if change.change == "not evaluated any more":
        return Test(
            name,
            "error",
            case.status,
            f"{change.change}: {_first_line(placed(case.error or case.status, case))}",
            case.case,
        )
    message = f"{change.change} than in the base{by}" if by else f"{change.change}, not so in the base"
    return Test(name, "failure", change.change.replace(" ", "_"), message, _facts(case))


def _by_cell(cases: Sequence[CaseResult], tests: Sequence[Test], cells: int) -> list[Test]:
    """One test a cell of the sampled box: a failure when a case in it failed, an error when only errors are in it."""
    names = list(dict.fromkeys(name for case in cases for name in case.values))
    low = {name: min(case.values[name] for case in cases) for name in names}
    high = {name: max(case.values[name] for case in cases) for name in names}

    def cell(case: CaseResult) -> tuple[int, ...]:
        return tuple(
            min(cells - 1, int(cells * (case.values[name] - low[name]) / ((high[name] - low[name]) or 1.0)))
            for name in names
        )

    gathered: dict[tuple[int, ...], list[Test]] = {}
    for case, test in zip(cases, tests, strict=True):
        gathered.setdefault(cell(case), []).append(test)

    def edges(name: str, place: int) -> str:
        width = (high[name] - low[name]) / cells
        return f"{name} {low[name] + place * width:g}..{low[name] + (place + 1) * width:g}"

    return [
        _together(", ".join(edges(name, place) for name, place in zip(names, place_of, strict=True)), inside)
        for place_of, inside in sorted(gathered.items())
    ]


def _together(name: str, tests: Sequence[Test]) -> Test:
    seconds = math.fsum(test.seconds for test in tests)
    for verdict, words in (("failure", "failed"), ("error", "could not be evaluated")):
        bad = [test for test in tests if test.verdict == verdict]
        if bad:
            message = f"{len(bad)} of {count(len(tests), 'case')} {words}"
            text = "\n".join(f"{test.name}: {test.message}" for test in bad)
            return Test(name, verdict, bad[0].kind, message, text, seconds)  # type: ignore[arg-type]
    return Test(name, "passed", seconds=seconds)


def _first_line(text: str) -> str:
    return text.strip().splitlines()[0] if text.strip() else ""


_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def _clean(text: str) -> str:
    """Without what XML cannot hold; a controller's error may contain anything."""
    return _FORBIDDEN.sub("\ufffd", text)


def merged(parts: Iterable[Suites]) -> Suites:
    """Several sets of suites as one."""
    return {key: tests for part in parts for key, tests in part.items()}
