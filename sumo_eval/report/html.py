"""The report: one HTML file that holds everything it shows and loads nothing from outside.

Users: `report.assessed`, and `cli.compare` for a page of the comparison alone.
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, islice
from pathlib import Path
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import OUTCOMES
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.report.citation import citation
from sumo_eval.report.density import density_maps
from sumo_eval.report.gate_result import failed
from sumo_eval.report.notes import GIVEN_UP, index_notes, score_note, why_missing
from sumo_eval.report.page import REPORT, Json, packed_json, write_filled
from sumo_eval.report.page_data import embedded_cases, gathered_words, map_words, page_data
from sumo_eval.report.people import nobody_drove, nobody_recorded, people_sentence
from sumo_eval.report.score_words import (
    EXPLAIN,
    EXPLAIN_PAPER,
    FACTORS,
    GLOSSARY,
    LIKENESS_FACTORS,
    collision_words,
    reason_without,
)
from sumo_eval.report.sections import SECTIONS, change_content
from sumo_eval.report.sent_drives import sent_drives
from sumo_eval.report.verdict import Additions
from sumo_eval.report.words import (
    LOOKS,
    count,
    percent,
    reference_sentence,
    sampling_words,
)
from sumo_eval.results import Evaluation
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.scoring.findings import Findings, unevaluated
from sumo_eval.scoring.map_view import View, choose_view
from sumo_eval.scoring.preventability import verdicts
from sumo_eval.scoring.shown_cases import shown_cases
from sumo_eval.trajectory import IntArray

NO_ADDITIONS = Additions()  # a report of the evaluation alone
MOST_LISTED = 500  # rows of a table of collisions, or of cases that could not be evaluated


def write_report(
    evaluation: Evaluation,
    partitions: Mapping[str, ZonePartition],
    additions: Additions = NO_ADDITIONS,
) -> Path:
    """Write `report.html` into the evaluation's folder and return its path.

    partitions: the zones of every logical scenario of the evaluation, by its name.
    additions: content in addition to the evaluation.
    """
    context = _context(evaluation, partitions, additions)
    return write_filled(evaluation.folder / REPORT, "report.html.j2", "The report", **context)


def term(name: str, shown: str = "") -> Markup:
    """A term with its meaning as a tooltip; the glossary at the page's end has the same words."""
    return Markup('<abbr title="{}">{}</abbr>').format(GLOSSARY[name], shown or name)


def _context(
    evaluation: Evaluation, partitions: Mapping[str, ZonePartition], additions: Additions
) -> Json:
    """Values of the page's template.

    A thread reads and deflates the recorded drives meanwhile.
    """
    # scenario -> indices of the cases in the page, the same in the case table of each ADS
    in_page = shown_cases(
        evaluation, [change.case for gate in additions.gates for change in gate.worst]
    )
    embedded = embedded_cases(evaluation, in_page)
    cases_of_page = {name: [case for case, _ in rows] for name, rows in embedded.items()}
    with ThreadPoolExecutor(1) as thread:
        sent = thread.submit(sent_drives, evaluation.folder, cases_of_page)
        # `page_data` waits for the drives only when it needs them
        contents = {section.name: section.content(evaluation, additions) for section in SECTIONS}
        shared = _shared(evaluation, partitions, additions, in_page)
        data = page_data(evaluation, partitions, embedded, sent.result)
    return {
        **shared,
        # numbers of points: those with trajectories in the page, those of them with trajectories of
        # drivers too, and all
        "embedded": {
            "points": data["embedded"],
            "drivers": data["embeddedDrivers"],
            "of": sum(zone.sampled for zone in evaluation.zones),
        },
        "data": packed_json(data),
        "sections": [section for section in SECTIONS if contents[section.name] is not None],
        "content": contents,
    }


def _shared(
    evaluation: Evaluation,
    partitions: Mapping[str, ZonePartition],
    additions: Additions,
    in_page: Mapping[str, IntArray],
) -> Json:
    """Values that the sections of the page share."""
    settings, exposure_known = evaluation.settings, evaluation.exposure_known()
    without_recorded = settings.drivers.source == "synthetic" or nobody_recorded(evaluation)
    missing_tables = unevaluated(evaluation)  # of each score
    number_missing = sum(map(len, missing_tables))
    avoidable = sum(score.avoidable_collisions for score in evaluation.scores)
    failed_gates = len(failed(additions.gates))
    return {
        "case_page": "",  # links to cases stay on this page
        "name": evaluation.name,
        "evaluation": evaluation,
        "collisions": sum(score.collisions for score in evaluation.scores),
        "avoidable": avoidable,
        "departures": sum(score.departures for score in evaluation.scores),
        "term": term,
        "digits": SCORES,  # with the attribute of each score
        "glossary": GLOSSARY,
        "unit": settings.method.collision.unit,
        "groups": [
            _group(index, evaluation, partitions[zone.scenario], in_page[zone.scenario])
            for index, zone in enumerate(evaluation.zones)
        ],
        "looks": LOOKS,
        "reference_sentence": reference_sentence(settings),
        "factors": FACTORS,
        "likeness_factors": LIKENESS_FACTORS,
        "ratio": "Ug/U" if settings.method.collision.loss == "severity" else "Lg/L",
        "missing": [
            (case, why_missing(case))
            for case in islice(chain.from_iterable(missing_tables), MOST_LISTED)
        ],
        "all_missing": number_missing,
        "given_up": GIVEN_UP,
        "index_notes": index_notes(evaluation),
        "synthetic": without_recorded and not nobody_drove(evaluation),
        "exposure_known": exposure_known,
        "collision_words": collision_words(exposure_known),
        "drivers_sentence": people_sentence(evaluation),
        "settings": settings,
        # words shown on a section while it is folded
        "badges": {
            "missing": count(number_missing, "case") if number_missing else "",
            "collisions": f"{avoidable} avoidable" if avoidable else "",
            "change": f"{count(failed_gates, 'gate')} failed" if failed_gates else "",
        },
        "citation": citation(evaluation),
    }


def write_comparison(evaluation: Evaluation, additions: Additions, path: Path) -> Path:
    """Write a page of the comparison alone; its cases link to the report of the new run."""
    folder = evaluation.folder
    title = evaluation.name
    change_title = ""
    if additions.comparison:
        base = additions.comparison.base_folder.name
        title = f"{base} and {folder.name}: {evaluation.name}"
        change_title = f"Change from {base} to {folder.name}"
    report = folder / REPORT
    link = ""
    if report.is_file():
        try:  # a relative link holds if both pages are moved together
            link = quote(Path(os.path.relpath(report, path.parent)).as_posix())
        except ValueError:  # no relative path between two disks
            link = report.resolve().as_uri()
    return write_filled(
        path, "compare.html.j2", "The page",
        name=title, content={"change": change_content(evaluation, additions)}, case_page=link,
        change_title=change_title,
    )  # fmt: skip


def _group(index: int, evaluation: Evaluation, zones: ZonePartition, shown: IntArray) -> Json:
    """Everything the page says of one logical scenario.

    index: of the scenario in the evaluation.
    shown: indices of the cases in the page among those of each ADS.
    """
    logical = zones.logical
    cases = evaluation.cases_in(logical.name)
    view = choose_view(logical, cases, evaluation.settings.report.axes.get(logical.name))
    scores = evaluation.scores_in(logical.name)
    # the verdicts that occur, e.g. `preventable`
    occurring = {
        str(verdict) for score in scores for verdict in np.unique(verdicts(evaluation, score))
    }
    # Chunk by chunk: words of a million cases would be 50 MB.
    outcomes = {
        outcome for chunk in cases.chunks for outcome in CaseTable([chunk]).outcome.tolist()
    }
    exposure_known = evaluation.exposure_known(logical.name)
    return {
        "index": index,
        "name": logical.name,
        "logical": logical,
        "probability": collision_words(exposure_known),
        "mean": "exposure-weighted mean" if exposure_known else "mean over the points",
        "rows": [_row(Findings.of(evaluation, score)) for score in scores],
        "zone": evaluation.zones[index],
        "map_words": map_words(view),
        "looks": [verdict for verdict in LOOKS if verdict in occurring],
        "map_note": gathered_words(view),
        "outcomes": [outcome for outcome in OUTCOMES if outcome in outcomes],
        "has_index": np.isfinite(cases.index).any(),
        **_left_out(logical, evaluation, shown, view),
        "share_of_space": percent(sum(zones.zone_shares)),
        "dangerous": [
            ", ".join(
                f"{item.name} = {values[item.name]:g}{item.unit_suffix}"
                for item in logical.parameters
            )
            for values in zones.most_dangerous
        ],
        "sampling": sampling_words(evaluation.settings.scenario[index].sampling, logical),
    }


def _left_out(
    logical: LogicalScenario, evaluation: Evaluation, shown: IntArray, view: View
) -> Json:
    """Words and drawings for a scenario of which the page does not hold all cases."""
    tables = {
        score.ads: evaluation.cases_behind(score) for score in evaluation.scores_in(logical.name)
    }
    # `shown` is the same for all ADSs: an index may be beyond the cases of one of them
    in_page = sum(np.count_nonzero(shown < len(cases)) for cases in tables.values())
    left_out = sum(map(len, tables.values())) - in_page
    if not left_out:
        return {"left_out": 0}
    return {
        # arguments of an example of `sumo-eval find`: the middle of the space
        "find": " ".join(
            f"{item.name}={(item.low + item.high) / 2.0:g}" for item in logical.parameters
        ),
        "left_out": left_out,
        "in_page": in_page,
        "densities": [
            (ads, density_maps(logical, cases, view.x, view.y))
            for ads, cases in tables.items()
            if view.y is not None
        ],
    }


def _row(findings: Findings) -> Json:
    """One ADS in one logical scenario, in the words and digits of the page."""
    score, cases, likened = findings.score, findings.cases, findings.likened
    hits = findings.collisions  # rows of its collisions
    # of each case: Ug/U or Lg/L, and what it takes from C and from A
    columns = findings.terms.ratio, findings.lost_of_c, findings.share_lost
    # width of the part of A in a bar of 100 %; that of H, `h_width`, gets no more than the rest
    a_width = min(score.a_points, 100.0)
    means, likeness = findings.factor_means, findings.likeness_means
    return {
        "notes": [score_note(note) for note in score.notes],
        "score": score,
        "no_d": reason_without("D", score),
        "no_h": reason_without("H", score),
        "a_width": f"{a_width:z.2f}",
        "h_width": f"{min(score.h_points, 100.0 - a_width):z.2f}",
        "explained": [explain(findings) for explain in EXPLAIN],
        "explained_paper": [explain(findings) for explain in EXPLAIN_PAPER],
        "factor_means": [means.get(name) for name in FACTORS],
        "likeness_means": [likeness.get(name) for name in LIKENESS_FACTORS],
        "likened": np.count_nonzero(likened),
        "likened_hits": np.count_nonzero(likened & cases.incident),
        "indexed": np.count_nonzero(findings.indexed),
        "collisions": [
            (cases[row], *(float(column[row]) for column in columns)) for row in hits[:MOST_LISTED]
        ],
        "more_collisions": max(len(hits) - MOST_LISTED, 0),
    }
