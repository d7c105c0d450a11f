"""What is made of all rows of a run costs: processor time and peak memory, by size.

python tools/run_sizes.py FOLDER CASES PART     one part (scores, intervals, confidence, tables,
JUnit, ledgers, page, evidence), after `prepare(FOLDER, CASES)`
"""

from __future__ import annotations

import json
import math
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from copy import copy
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sumo_eval.case_table import COLUMNS, CaseTable, encode_rows
from sumo_eval.cases import CaseResult
from sumo_eval.evaluation import evaluate, score, zone_partitions
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.report.confidence_section import confidence_json
from sumo_eval.report.evidence import write_evidence
from sumo_eval.report.html import write_report
from sumo_eval.report.junit import run_suites, write_junit
from sumo_eval.report.notes import index_notes
from sumo_eval.report.people import MOST_WORST, people_rows
from sumo_eval.report.score_words import explain_a, explain_h
from sumo_eval.report.sent_drives import Embedded
from sumo_eval.report.tables import cases_csv
from sumo_eval.report.terminal import closing_lines, ledger_lines, nearest_cases
from sumo_eval.results import Evaluation
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.case_terms import case_terms
from sumo_eval.scoring.confidence.assessment import assess
from sumo_eval.scoring.confidence.drivers import driver_deviations
from sumo_eval.scoring.confidence.intervals import REPLICATES, AdsCases, score_intervals
from sumo_eval.scoring.confidence.resamples import strata
from sumo_eval.scoring.driver_bands import below_drivers
from sumo_eval.scoring.findings import Findings
from sumo_eval.scoring.kept_scores import KeptChunk, KeptScoring
from sumo_eval.scoring.ledger import ledger
from sumo_eval.scoring.nearest import nearest
from sumo_eval.scoring.preventability import preventability
from sumo_eval.scoring.quantities import combine
from sumo_eval.scoring.shown_cases import shown_cases
from sumo_eval.scoring.steps import POINTS_AT_ONCE
from sumo_eval.settings import (
    AdsSettings,
    DriverSettings,
    EvaluationSettings,
    MethodSettings,
    SamplingSettings,
    ScenarioSettings,
)

FEW_REPLICATES = 20  # of 2,000: each costs as much as any other, and they are held some at a time
BOX = catalogue.load("cut_in").parameters
# the run in which made-up rows take the place of its own
SMALL_RUN = ScenarioSettings("cut_in", SamplingSettings("sobol", count=64))
MADE_UP = EvaluationSettings(
    "made up", (ScenarioSettings("cut_in"),), (AdsSettings("first", "idm"),)
)


def made_up_chunks(cases: int) -> list[KeptChunk]:
    """How so many rows of one ADS lie in a run's folder."""
    firsts = enumerate(range(0, cases, POINTS_AT_ONCE))
    return [
        KeptChunk("cut_in", "first", min(POINTS_AT_ONCE, cases - first), place)
        for place, first in firsts
    ]


def made_up_rows(folder: Path, cases: int) -> CaseTable:
    """The rows of a made-up run, none of them read yet."""
    return KeptScoring(KeptResults(folder), folder.name.encode()).table(made_up_chunks(cases))


def made_up_run(folder: Path, cases: int) -> Evaluation:
    """A run of one ADS whose rows are made up; its scores are those of two of them."""
    folder.mkdir()
    row, kept = made_up_row(), KeptResults(folder)
    for chunk in made_up_chunks(cases):
        first = chunk.place * POINTS_AT_ONCE
        some = [another(row, number) for number in range(first, first + chunk.rows)]
        parts = enumerate(encode_rows(some), chunk.place * COLUMNS)
        kept.put(("rows", folder.name.encode(), place, data) for place, data in parts)
    return of_rows_alone(folder, cases)


def of_rows_alone(folder: Path, cases: int) -> Evaluation:
    """A made-up run with its rows, none of them read yet; its scores are those of two of them."""
    rows = made_up_rows(folder, cases)
    two = combine("first", "cut_in", list(rows[:2]), MethodSettings())
    return Evaluation(
        folder.name,
        folder,
        MADE_UP,
        {},
        (),
        (two,),
        made_up_rows(folder, cases),
        scenarios={"cut_in": catalogue.load("cut_in")},
    )


def prepare(folder: Path, cases: int) -> None:
    """What `part` needs: a small scored run, in which so many made-up rows can take the place of
    its own, these rows, and their score.
    """
    run = folder / "run"
    if not run.exists():
        evaluate(replace(MADE_UP, scenario=(SMALL_RUN,), drivers=DriverSettings(count=3)), run)
    method = score(run).settings.method
    made = made_up_run(folder / str(cases), cases)
    (folder / f"{cases}.score").write_bytes(
        pickle.dumps(combine("first", "cut_in", made.cases, method))
    )


def prepared(folder: Path, cases: int) -> Evaluation:
    """That run with these rows, none of them read yet."""
    run, whole = score(folder / "run"), pickle.loads((folder / f"{cases}.score").read_bytes())
    settings = replace(
        run.settings, ads=tuple(one for one in run.settings.ads if one.name == "first")
    )
    rows = made_up_rows(folder / str(cases), cases)
    return replace(run, cases=rows, scores=(whole,), ranking=None, settings=settings)


def intervals(run: Evaluation, replicates: int) -> object:
    """The intervals of made-up rows that lie on a line through the space."""
    rows = run.cases_of("first", "cut_in")
    points = np.column_stack([np.linspace(0.0, 1.0, len(rows))] * len(BOX))
    drivers = driver_deviations(rows, {}, run.settings.drivers, 1)
    everywhere, safe = np.arange(len(rows)), np.zeros(len(rows), dtype=np.bool_)
    ads_cases = AdsCases("first", case_terms(rows, run.settings.method), everywhere, safe, drivers)
    groups = strata(points, "sobol")
    return score_intervals([ads_cases], groups, 1, "cut_in", replicates=replicates)


def written_page(run: Evaluation) -> Path:
    """The page: without trajectories, of which it has at most 4.5 MB, since made-up rows have no
    drives.
    """
    nothing = Embedded(frozenset(), frozenset())
    with patch("sumo_eval.report.sent_drives.worth_embedding", lambda *_: nothing):
        return write_report(run, zone_partitions(run))


def why(run: Evaluation) -> object:
    """Why A and H are what they are, and what each collision has a part of."""
    found = Findings.of(run, run.scores[0])
    return explain_a(found), explain_h(found), found.collisions


def named(run: Evaluation) -> object:
    """A case by its name, and those nearest to the middle of the space."""
    middle = {item.name: 0.5 * (item.low + item.high) for item in BOX}
    return run.case(case_name(len(run.cases) - 1)), list(
        nearest_cases(nearest(run, middle, None, None, 3))
    )


PARTS: dict[str, Callable[[Evaluation, Path], object]] = {
    "scores": lambda run, _: combine("first", "cut_in", run.cases, run.settings.method),
    f"intervals of {FEW_REPLICATES} replicates": lambda run, _: intervals(run, FEW_REPLICATES),
    "intervals": lambda run, _: intervals(run, REPLICATES),
    "confidence": lambda run, _: confidence_json(assess(run, zone_partitions(run))),
    "cases.csv": lambda run, out: cases_csv(run, out / "cases.csv"),
    "junit.xml": lambda run, out: write_junit(run_suites(run), out / "junit.xml"),
    "ledgers": lambda run, _: (ledger_lines(run), ledger(Findings.of(run, run.scores[0]))),
    "terminal": lambda run, _: closing_lines(run),
    "shown cases": lambda run, _: shown_cases(run),
    "preventability": lambda run, _: preventability(run),
    "people": lambda run, _: (people_rows(run), below_drivers(run, MOST_WORST), index_notes(run)),
    "why": lambda run, _: why(run),
    "found cases": lambda run, _: named(run),
    "page": lambda run, _: written_page(run),
    "evidence": lambda run, out: write_evidence(run, out),
}
"""What is made of all rows of a run, by name; the folder is where files go."""


def part(folder: Path, cases: int, name: str) -> None:
    """Do one of PARTS with rows that `prepare` made, and say what it took, as JSON: seconds of
    processor time, the most MB that this process held, and what it held before it read a row.

    Linear algebra has one thread, as in every command: the time that a second one waits would
    count, and from some 10,000 cases on there is one.
    """
    run = prepared(folder, cases)
    before, began = held("VmHWM"), time.process_time()
    with tempfile.TemporaryDirectory() as out, threadpool_limits(1):
        PARTS[name](run, Path(out))
    print(
        json.dumps(
            {"seconds": time.process_time() - began, "most": held("VmHWM"), "before": before}
        )
    )


def held(what: str) -> float:
    """MB that this process holds (VmRSS), or held at most (VmHWM).

    `getrusage` counts what its parent held too.
    """
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{what}:")) / 1024.0


def measured(folder: Path, cases: int, name: str) -> dict[str, float]:
    """What `part` says, in a process of its own."""
    words = [sys.executable, __file__, str(folder), str(cases), name]
    found: dict[str, float] = json.loads(
        subprocess.run(words, check=True, capture_output=True, text=True).stdout
    )
    return found


def made_up_row() -> CaseResult:
    """A safe case without a contact."""
    given: dict[str, Any] = {item.name: None for item in fields(CaseResult)}
    return CaseResult(
        **given | {
            "case": "cut_in-0000-first", "scenario": "cut_in", "ads": "first",
            "values": {"gap": 0.0, "ego_speed": 30.0}, "wall_time": 0.01, "zone": "safe",
            "exposure": 1.0,
            "status": "ok", "end_reason": "time_limit",
            "simulated_time": 6.0, "collided": False, "ideal_severity": 0.0,
            "no_reaction_severity": 0.0, "weight": 1.0,
            "beats_ideal": False, "index_note": (), "clips": "", "bimodal": False, "manoeuvre": "",
            "exposure_note": "",
            "error_place": "", "struck_from_behind": False,
        }
    )  # fmt: skip


def somewhere(number: int) -> dict[str, float]:
    """A point of the cut-in's box that no other number has, as a lattice spreads them."""
    shares = (
        number * step % 1.0
        for step in (0.8566748838545029, 0.7338918566271260, 0.6287067210378086, 0.5385972572236101)
    )
    return {
        item.name: item.low + share * (item.high - item.low)
        for item, share in zip(BOX, shares, strict=True)
    }


def case_name(number: int) -> str:
    """The key of a case at a point: beyond 10,000 points keys do not ascend with them."""
    return f"cut_in-{number:04d}-first"


def another(row: CaseResult, number: int) -> CaseResult:
    """Another case, by its number. Every third has no D_i."""
    likeness, hit = 0.5 + 0.4 * math.sin(number), number % 7 == 0
    # `replace` would look at each of the other fields, which is most of what a million rows cost
    own = copy(row)
    values: dict[str, Any] = {
        "case": case_name(number), "values": somewhere(number),
        "zone": "hazardous" if number % 3 == 0 else "safe", "collided": hit,
        "status": "collision" if hit else "ok",
        "severity": 5.0 + math.cos(number) if hit else None,
        "no_reaction_severity": 12.0 if number % 3 == 0 else 0.0,
        "weight": 1.0 + 0.5 * math.cos(number),
        "index": None if hit or number % 3 == 1 else likeness,
        "human_likeness": None if hit or number % 3 == 1 else likeness,
    }  # fmt: skip
    for name, value in values.items():
        object.__setattr__(own, name, value)
    return own


if __name__ == "__main__":
    _, where, count, what = sys.argv
    part(Path(where), int(count), what)
