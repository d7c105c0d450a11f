"""JUnit XML for continuous integration, of a run, a comparison or a night.

A failure: the ADS left the road, had an avoidable collision (`report.junit_failures = "any"`: any
collision) or missed a requirement; in a comparison also a case that got worse, and a gate that does
not hold. An error: the case could not be evaluated (the ADS gave up, or the harness failed), or a
score lacks it. Written by lxml in the shape that Jenkins, GitLab and the usual GitHub actions read.

Users: `cli/compare.py`, `cli/finish.py`, `nightly/night.py`, `evaluation.py`.
"""

import math
import re
from array import array
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from shutil import copyfileobj
from tempfile import SpooledTemporaryFile
from typing import IO, Literal, NamedTuple

from lxml import etree

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.input_file import whole, writing
from sumo_eval.report.comparison_lines import worst_lines
from sumo_eval.report.gate_result import GateResult
from sumo_eval.report.notes import why_missing
from sumo_eval.report.score_words import explain_s_plus
from sumo_eval.report.tables import write_tables
from sumo_eval.report.words import count, end_reason, number, placed, severity_words
from sumo_eval.results import Evaluation
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.scoring.comparison import AdsComparison, ChangedCase, Comparison
from sumo_eval.scoring.findings import Findings, findings_of
from sumo_eval.scoring.map_view import cells_of
from sumo_eval.settings import ReportSettings
from sumo_eval.text import point_words

JUNIT = "junit.xml"
TestVerdict = Literal["passed", "failure", "error", "skipped"]


class Test(NamedTuple):
    """One JUnit test.

    kind: the machine-readable type of a failure or an error.
    text: details, for a reader.
    """

    name: str
    verdict: TestVerdict
    kind: str = ""
    message: str = ""
    text: str = ""
    seconds: float = 0.0


Suite = tuple[Iterable[Test], Mapping[str, str]]
"""Tests, and properties by name."""
Suites = Mapping[tuple[str, str], Suite]
"""Suites by (name of the suite, class name of its tests)."""
_IN_MEMORY = 1 << 18  # bytes of a suite that stay in memory; a larger suite goes to a file
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def run_suites(evaluation: Evaluation) -> Suites:
    """A suite for each ADS in each logical scenario, with a test for each case or for each cell of
    the space; its properties are the scores, and the formula of S+ with its values.
    """
    report, unit = evaluation.settings.report, evaluation.settings.method.collision.unit
    suites = {}
    for findings in findings_of(evaluation):
        score = findings.score
        tests: Iterable[Test] = map(
            partial(_case_test, report=report, unit=unit), findings.cases, findings.missing.tolist()
        )
        if report.junit == "cell":
            logical = evaluation.scenarios[score.scenario]
            tests = _by_cell(logical, findings.cases, tests, report.junit_cells)
        key = f"{score.ads} in {score.scenario}", f"{score.scenario}.{score.ads}"
        suites[key] = tests, _scores_of(findings)
    return suites


def _scores_of(findings: Findings) -> dict[str, str]:
    """Scores by letter, and the formula of S+ with its values."""
    fields = {letter: SCORES[letter][0] for letter in ("T", "A'", "H", "S+", "S")}
    scores = {letter: number(getattr(findings.score, it), 4) for letter, it in fields.items()}
    return scores | {"S+ of its parts": explain_s_plus(findings)}


def write_results(evaluation: Evaluation) -> None:
    """Write the files for other programs into the folder of a scored run: scores.json, cases.csv,
    checks.csv, junit.xml.
    """
    write_tables(evaluation)
    write_junit(run_suites(evaluation), evaluation.folder / JUNIT)


def comparison_suites(comparison: Comparison | None, gates: Sequence[GateResult]) -> Suites:
    """A suite of the gates, and one for each ADS in each logical scenario with a test for each case
    of both runs.
    """
    of_gates = [
        Test(
            f"{gate.quantity} of {gate.ads} in {gate.scenario}",
            "skipped" if gate.passed is None else "passed" if gate.passed else "failure",
            "gate",
            gate.sentence,
            "\n".join(worst_lines(gate, comparison.new_folder if comparison else None)),
        )
        for gate in gates
    ]
    changes: dict[tuple[str, str], Suite] = {
        (f"{part.ads} in {part.scenario} beside the base", f"change.{part.scenario}.{part.ads}"): (
            _change_tests(part),
            {},
        )
        for part in (comparison.ads if comparison else ())
    }
    return {("gates", "gates"): (of_gates, {})} | changes


def _change_tests(part: AdsComparison) -> Iterator[Test]:
    """A test for each pair of cases, in the order of the new run."""
    changed = part.changed
    # index of a pair of cases -> index of its change in `changed`
    rows = {pair: row for row, pair in enumerate(changed.which.tolist())}
    for pair, case in enumerate(changed.paired.new):
        change = changed[rows[pair]] if pair in rows else None
        yield _change_test(case, change, part.units[1])  # unit of U in the new run


def write_junit(suites: Suites, path: Path) -> Path:
    """Write the suites to a file and return its path.

    Tests are written as they are made. In the file their number stands before them, so each suite
    first goes to a temporary file: counting them first would mean to make them twice.
    """
    with (
        writing(f"The JUnit file {path}", path.parent),
        ExitStack() as bodies,
        whole(path) as half,
        half.open("wb") as out,
    ):
        written = {
            key: _written(tests, key[1], bodies.enter_context(SpooledTemporaryFile(_IN_MEMORY)))
            for key, (tests, _) in suites.items()
        }
        totals = sum((counts for _, counts, _ in written.values()), Counter[str]())
        with etree.xmlfile(out, encoding="UTF-8") as file:
            file.write_declaration()
            with file.element("testsuites", name="sumo_eval", **_counted(totals)):
                for key, (body, counts, seconds) in written.items():
                    attributes = {"name": _clean(key[0])} | _counted(counts)
                    file.write("\n  ")
                    with file.element("testsuite", **attributes, time=f"{seconds:z.3f}"):
                        if properties := suites[key][1]:
                            file.write("\n    ", _properties(properties))
                        file.flush()
                        # the finished tests go past lxml, after all that it has written
                        body.seek(0)
                        copyfileobj(body, out)
                        file.write("\n  ")
                file.write("\n")
        out.write(b"\n")
    return path


def _counted(counts: Counter[str]) -> dict[str, str]:
    """Numbers of tests as JUnit's attributes."""
    names = {"tests": "tests", "failures": "failure", "errors": "error", "skipped": "skipped"}
    return {name: str(counts[verdict]) for name, verdict in names.items()}


def _written(
    tests: Iterable[Test], classname: str, body: IO[bytes]
) -> tuple[IO[bytes], Counter[str], float]:
    """`body` with a suite's tests, their number by verdict, and the sum of their times, s."""
    counts = Counter[str]()
    seconds = array("d")
    for test in tests:
        counts.update(("tests", test.verdict))  # "tests" counts all of them
        seconds.append(test.seconds)
        element = etree.tostring(_element(test, classname), encoding="UTF-8", xml_declaration=False)
        body.write(b"\n    " + element)
    return body, counts, math.fsum(seconds)


def _properties(values: Mapping[str, str]) -> etree._Element:
    listed = etree.Element("properties")
    for name, value in values.items():
        etree.SubElement(listed, "property", name=_clean(name), value=_clean(value))
    etree.indent(listed, level=2)
    return listed


def _element(test: Test, classname: str) -> etree._Element:
    item = etree.Element(
        "testcase", name=_clean(test.name), classname=_clean(classname), time=f"{test.seconds:z.3f}"
    )
    if test.verdict != "passed":
        verdict = etree.SubElement(
            item, test.verdict, type=_clean(test.kind), message=_clean(test.message)
        )
        verdict.text = _clean(test.text) or None
        etree.indent(item, level=2)
    return item


def _case_test(case: CaseResult, missing: bool, report: ReportSettings, unit: str) -> Test:
    """The test of a case of one run.

    missing: whether a score lacks the case.
    unit: of U.
    """
    reason = placed(why_missing(case), case) if missing else ""
    result = partial(Test, point_words(case.values), seconds=case.wall_time or 0.0)
    if not case.evaluated:  # then a score lacks it, so `reason` is not empty
        text = "\n".join([reason, *_task_and_harm(case, unit)])
        return result("error", case.status, _first_line(reason), text)
    # off_road: the centre left the road, which ends a drive; departed: a corner did
    if case.status == "off_road" or case.departed:
        return result("failure", "off_road", f"{case.ads} left the road", _facts(case, unit))
    # `unavoidable` is false where the ideal vehicle has no outcome: then a collision is a failure
    if case.collided and (report.junit_failures == "any" or not case.unavoidable):
        which = "collision" if case.kind == "not known" else f"{case.kind} collision"
        speed = number(case.impact_speed, 1)
        message = f"{which} of {case.ads} in the {case.zone} zone at {speed} m/s"
        return result("failure", "collision", message, _facts(case, unit))
    if case.requirements_missed:
        message = f"{case.ads} misses: {case.requirements_missed}"
        return result("failure", "requirement", message, _facts(case, unit))
    if reason:  # it was evaluated, but has no value in a score, e.g. no D_i for want of drivers
        return result("error", "not_evaluated", _first_line(reason), reason)
    return result("passed")


def _facts(case: CaseResult, unit: str) -> str:
    lines = [f"case {case.case}", f"end: {end_reason(case)}"]
    if case.collided:
        severities = case.severity, case.ideal_severity, case.no_reaction_severity
        hit, ideal, nothing = (severity_words(value, unit, 2) for value in severities)
        lines.append(
            f"U = {hit}, Ug of the ideal vehicle = {ideal}, U0 of doing nothing = {nothing}, "
            f"overlap {number(case.overlap, 2)}, hit at the {case.side}"
        )
    return "\n".join([*lines, *_task_and_harm(case, unit)])


def _task_and_harm(case: CaseResult, unit: str) -> Iterator[str]:
    """Lines on the case's parts in T, A' and H: departure, giving up, t and h, if it has them."""
    if case.departed:
        harm = severity_words(case.departure_severity, unit, 2)
        yield (
            f"left the road at {number(case.departure_time, 1)} s, "
            f"{number(case.departure_speed, 1)} m/s: U = {harm}"
        )
    if case.gave_up:
        harm = severity_words(case.no_reaction_severity, unit, 2)
        yield f"giving up counts as doing nothing: U = {harm}"
    parts = ("t of T", case.task_share), ("h of H", case.human_likeness)
    known = [f"{name} = {number(value, 3)}" for name, value in parts if value is not None]
    if known:
        yield ", ".join(known)


def _change_test(case: CaseResult, change: ChangedCase | None, unit: str) -> Test:
    """The test of a case of the new run.

    change: from the base; None: there is none.
    """
    result = partial(Test, point_words(case.values))
    if not case.evaluated:
        newly = change is not None and change.change == "not evaluated any more"
        words = "not evaluated any more" if newly else "not evaluated, as in the base"
        reason = _first_line(placed(case.error or case.status, case))
        return result("error", case.status, f"{words}: {reason}", case.case)
    if change is None or not change.worse:
        return result("passed")
    kind = change.change
    message = f"{kind}, not so in the base"
    if change.by is not None:
        message = f"{kind} than in the base by {abs(change.by):z.3g}"
    return result("failure", kind.replace(" ", "_"), message, _facts(case, unit))


def _by_cell(
    logical: LogicalScenario, cases: CaseTable, tests: Iterable[Test], cells: int
) -> Iterator[Test]:
    """One test for each cell of the space that holds cases.

    tests: those of the cases.
    cells: number of cells along each parameter.

    It is a failure if any of its cases is a failure, else an error if any is an error.
    """
    names = logical.names
    # (cases, parameters), and (edges, parameters)
    cell_of_case, edges_of = cells_of(logical, cases.parameters(names), cells)
    # tests that passed are not kept, only their times: there may be a million
    seconds: defaultdict[tuple[int, ...], array[float]] = defaultdict(lambda: array("d"))
    bad: defaultdict[tuple[int, ...], list[Test]] = defaultdict(list)
    for cell, test in zip(map(tuple, cell_of_case.tolist()), tests, strict=True):
        seconds[cell].append(test.seconds)
        if test.verdict in ("failure", "error"):
            bad[cell].append(test)

    for cell in sorted(seconds):
        edges = ", ".join(
            f"{name} {edge[index]:g}..{edge[index + 1]:g}"
            for name, edge, index in zip(names, edges_of.T, cell, strict=True)
        )
        yield _cell_test(edges, seconds[cell], bad[cell])


def _cell_test(name: str, seconds: Sequence[float], bad: Sequence[Test]) -> Test:
    """The test of a cell.

    seconds: times of all its tests.
    bad: those that are a failure or an error.
    """
    result = partial(Test, name, seconds=math.fsum(seconds))
    failures = [test for test in bad if test.verdict == "failure"]
    reported = failures or bad
    if not reported:
        return result("passed")
    words = "failed" if failures else "could not be evaluated"
    message = f"{len(reported)} of {count(len(seconds), 'case')} {words}"
    text = "\n".join(f"{test.name}: {test.message}" for test in reported)
    return result(reported[0].verdict, reported[0].kind, message, text)


def _first_line(text: str) -> str:
    return next(iter(text.strip().splitlines()), "")


def _clean(text: str) -> str:
    """Replace characters that XML cannot hold; a controller's error may contain any."""
    return _FORBIDDEN.sub("\ufffd", text)
