"""The report: one HTML file that holds everything it shows and loads nothing from outside."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, islice
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from sumo_eval.cases import OUTCOMES, CaseTable
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.record.run_folder import FACTS
from sumo_eval.report.citation import citation
from sumo_eval.report.packing import packed_json
from sumo_eval.report.page import REPORT, template, write_page
from sumo_eval.report.page_data import View, choose_view, page_data, told_cases
from sumo_eval.report.readings import readings, setting_rows
from sumo_eval.report.sections import SECTIONS, Beside, change_content
from sumo_eval.report.sent_drives import sent_drives
from sumo_eval.report.shown_cases import Shown, density_maps, shown_cases
from sumo_eval.report.words import (
    EXPLAIN,
    EXPLAIN_PAPER,
    FACTORS,
    GLOSSARY,
    LIKENESS_FACTORS,
    LOOKS,
    collision_words,
    count,
    index_notes,
    nobody_drove,
    nobody_recorded,
    number,
    people_sentence,
    percent,
    reason_without,
    reference_sentence,
    score_note,
    severity_unit,
    why_missing,
)
from sumo_eval.results import Evaluation, ZoneResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.scoring.findings import Findings, unevaluated
from sumo_eval.scoring.preventability import preventability, reference_ads, verdicts
from sumo_eval.settings import SamplingSettings

NOTHING_BESIDE = Beside()
MOST_LISTED = 500  # rows of a table of collisions, or of cases that could not be evaluated


def write_report(
    evaluation: Evaluation, partitions: Mapping[str, ZonePartition], beside: Beside = NOTHING_BESIDE
) -> Path:
    """Write `report.html` into the evaluation's folder and return its path.

    partitions: the zones of every logical scenario of the evaluation, by its name.
    beside: what else there is to show.
    """
    path = evaluation.folder / REPORT
    page = template("report.html.j2").render(_context(evaluation, partitions, beside))
    return write_page(path, page, "The report")


def term(name: str, shown: str = "") -> Markup:
    """A term with its meaning as a tooltip; the glossary at the page's end has the same words."""
    return Markup('<abbr title="{}">{}</abbr>').format(GLOSSARY[name], shown or name)


def _context(
    evaluation: Evaluation, partitions: Mapping[str, ZonePartition], beside: Beside
) -> dict[str, Any]:
    """Values of the page's template.

    A thread reads and deflates the recorded drives meanwhile.
    """
    missing = unevaluated(evaluation)
    in_page = shown_cases(evaluation, [one.case for gate in beside.gates for one in gate.worst])
    told = told_cases(evaluation, in_page)
    cases_of_page = {name: [case for case, _ in cases] for name, cases in told.items()}
    with ThreadPoolExecutor(1) as thread:
        sent = thread.submit(sent_drives, evaluation.folder / FACTS, cases_of_page)
        found = [(section, section.content(evaluation, beside)) for section in SECTIONS]
        shared = _shared(evaluation, partitions, beside, in_page, missing)
        data = page_data(evaluation, partitions, told, sent.result)
    shown = [(section, content) for section, content in found if content is not None]
    return {
        **shared,
        "embedded": {
            "points": data["embedded"],
            "drivers": data["embeddedDrivers"],
            "of": sum(zone.sampled for zone in evaluation.zones),
        },
        "data": packed_json(data),
        "sections": [section for section, _ in shown],
        "content": {section.name: content for section, content in shown},
    }


def _shared(
    evaluation: Evaluation,
    partitions: Mapping[str, ZonePartition],
    beside: Beside,
    in_page: Mapping[str, Shown],
    missing: Sequence[CaseTable],
) -> dict[str, Any]:
    """Values that the sections of the page share."""
    settings = evaluation.settings
    return {
        "case_page": "",
        "name": evaluation.name,
        "ads_count": len({score.ads for score in evaluation.scores}),
        "cases": len(evaluation.cases),
        "collisions": sum(score.collisions for score in evaluation.scores),
        "avoidable": sum(score.avoidable_collisions for score in evaluation.scores),
        "departures": sum(score.departures for score in evaluation.scores),
        "term": term,
        "digits": SCORES,
        "glossary": GLOSSARY,
        "unit": severity_unit(settings),
        "groups": [
            _group(
                index,
                zone,
                entry.sampling,
                evaluation,
                partitions[zone.scenario],
                in_page[zone.scenario],
            )
            for index, (zone, entry) in enumerate(
                zip(evaluation.zones, settings.scenario, strict=True)
            )
        ],
        "looks": LOOKS,
        "prevented": preventability(evaluation),
        "reference": reference_ads(settings),
        "reference_sentence": reference_sentence(settings),
        "factors": FACTORS,
        "likeness_factors": LIKENESS_FACTORS,
        "ratio": "Ug/U" if settings.method.collision.loss == "severity" else "Lg/L",
        "missing": [
            (case, why_missing(case)) for case in islice(chain.from_iterable(missing), MOST_LISTED)
        ],
        "all_missing": sum(map(len, missing)),
        "index_notes": index_notes(evaluation),
        "synthetic": (settings.drivers.source == "synthetic" or nobody_recorded(evaluation))
        and not nobody_drove(evaluation),
        "exposure_known": evaluation.exposure_known(),
        "collision_words": collision_words(evaluation.exposure_known()),
        "drivers_sentence": people_sentence(evaluation),
        "score_settings": settings.method.score,
        "field": settings.method.anthropomorphic.field,
        "settings": settings,
        "readings": readings(settings),
        "setting_groups": setting_rows(settings),
        "origin": _origin(evaluation),
        "citation": citation(evaluation),
        "folder": evaluation.folder,
        "badges": _badges(evaluation, beside, sum(map(len, missing))),
    }


def write_comparison(evaluation: Evaluation, beside: Beside, path: Path) -> Path:
    """Write a page of the comparison alone; its cases lead into the report of the newer run."""
    content = change_content(evaluation, beside)
    report = evaluation.folder / REPORT
    base = Path(beside.comparison.base_folder).name if beside.comparison else ""
    title = f"{base} and {evaluation.folder.name}: {evaluation.name}" if base else evaluation.name
    page = template("compare.html.j2").render(
        name=title, content={"change": content},
        case_page=_way(path, report) if report.is_file() else "",
        change_title=f"Change from {base} to {evaluation.folder.name}" if base else "",
    )  # fmt: skip
    return write_page(path, page, "The page")


def _way(page: Path, file: Path) -> str:
    """The address of a file in a page: relative, so that both can be moved together, where one disk
    holds both.
    """
    try:
        return quote(Path(os.path.relpath(file, page.parent)).as_posix())
    except ValueError:
        return file.resolve().as_uri()


def _badges(evaluation: Evaluation, beside: Beside, missing: int) -> dict[str, str]:
    """A few words on a folded section that a reader should not miss, by the section's name."""
    avoidable = sum(score.avoidable_collisions for score in evaluation.scores)
    failed = sum(gate.passed is False for gate in beside.gates)
    told = {
        "missing": count(missing, "case") if missing else "",
        "collisions": f"{avoidable} avoidable" if avoidable else "",
        "change": f"{count(failed, 'gate')} failed" if failed else "",
    }
    return {name: words for name, words in told.items() if words}


def _group(
    index: int,
    zone: ZoneResult,
    sampling: SamplingSettings,
    evaluation: Evaluation,
    zones: ZonePartition,
    shown: Shown,
) -> dict[str, Any]:
    """Everything the page says of one logical scenario."""
    logical = zones.logical
    cases = evaluation.cases_in(logical.name)
    view = choose_view(logical, cases, evaluation.settings.report.axes.get(logical.name))
    scores = [score for score in evaluation.scores if score.scenario == logical.name]
    found = {
        verdict for score in scores for verdict in np.unique(verdicts(evaluation, score)).tolist()
    }
    # Chunk by chunk: words of a million cases would be 50 MB.
    outcomes = {one for chunk in cases.chunks for one in CaseTable([chunk]).outcome.tolist()}
    behind = {item.name: item.behind for item in logical.parameters}
    return {
        "index": index,
        "name": logical.name,
        "about": logical.about,
        "exposure": logical.exposure_about,
        "probability": collision_words(evaluation.exposure_known(logical.name)),
        "mean": "exposure-weighted mean"
        if evaluation.exposure_known(logical.name)
        else "mean over the points",
        "rows": [_row(Findings.of(evaluation, score)) for score in scores],
        "zone": zone,
        "map_words": view.words,
        "looks": [verdict for verdict in LOOKS if verdict in found],
        "map_note": "" if view.projected or view.fixed else view.note,
        "constraints": [constraint.about for constraint in logical.constraints],
        "outcomes": [outcome for outcome in OUTCOMES if outcome in outcomes],
        "has_collisions": "collision" in outcomes,
        "has_index": bool(np.isfinite(cases.index).any()),
        **_left_out(logical, evaluation, shown, view),
        "share_of_space": percent(sum(zones.zone_shares)),
        "dangerous": [
            ", ".join(f"{name} = {value:g}{behind[name]}" for name, value in values.items())
            for values in zone.most_dangerous
        ],
        "parameters": [
            f"{item.name}: {item.low:g} to {item.high:g}{item.behind}, {item.about}"
            for item in logical.parameters
        ],
        "sampling": _sampling(sampling, logical),
    }


def _left_out(
    logical: LogicalScenario, evaluation: Evaluation, shown: Shown, view: View
) -> dict[str, Any]:
    """Words and drawings for a scenario of which the page does not hold all cases."""
    if shown.places is None:
        return {"left_out": 0, "densities": []}
    everybody = [one.ads for one in evaluation.scores if one.scenario == logical.name]
    there = sum(shown.number(evaluation.cases_of(ads, logical.name)) for ads in everybody)
    densities = [] if view.y is None else [
        (ads,
            density_maps(logical, evaluation.cases_of(ads, logical.name), view.x,
                view.y)) for ads in everybody
    ]  # fmt: skip
    find = " ".join(f"{item.name}={(item.low + item.high) / 2.0:g}" for item in logical.parameters)
    return {"find": find, "left_out": shown.of - there, "there": there, "densities": densities}


def _sampling(sampling: SamplingSettings, logical: LogicalScenario) -> str:
    """How the points were chosen, in words; the rules are those of
    `sumo_eval.scenario.sampling.samples.sample`.
    """
    behind = {item.name: item.behind for item in logical.parameters}
    given = sampling.levels is not None or bool(sampling.steps)
    method = sampling.method or ("grid" if given else logical.default_sample)
    if method in {item.name for item in logical.samples}:
        return f"{method}, {next(item.about for item in logical.samples if item.name == method)}"
    if sampling.count is not None:
        return f"{method}, {sampling.count} points asked for"
    if sampling.file is not None:
        return f"{method}, {sampling.file}"
    if isinstance(sampling.levels, int):
        how = f"{sampling.levels} points on each axis"
    else:
        parts = [f"{name}: {levels} points" for name, levels in (sampling.levels or {}).items()]
        parts += [
            f"{name}: steps of {step:g}{behind.get(name, '')}"
            for name, step in (sampling.steps or {}).items()
        ]
        how = ", ".join(
            [*parts, "the space's own steps" if not parts else "elsewhere the space's own steps"]
        )
    return f"{method}, {how}"


def _row(found: Findings) -> dict[str, Any]:
    """One ADS in one logical scenario, in the words and digits of the page."""
    score, cases = found.score, found.cases
    likened, indexed = found.likened, found.indexed
    means, likeness = found.factor_means, found.likeness_means
    hits, losses = found.collisions, found.share_lost
    return {
        "notes": [score_note(note) for note in score.notes],
        "score": score,
        "no_d": reason_without("D", score),
        "no_h": reason_without("H", score),
        "a_width": f"{min(score.a_points, 100.0):z.2f}",
        "h_width": f"{min(score.h_points, 100.0 - min(score.a_points, 100.0)):z.2f}",
        "explained": [explain(found) for explain in EXPLAIN],
        "explained_paper": [explain(found) for explain in EXPLAIN_PAPER],
        "factor_means": [number(means.get(name), 3) for name in FACTORS],
        "likeness_means": [number(likeness.get(name), 3) for name in LIKENESS_FACTORS],
        "likened": int(np.count_nonzero(likened)),
        "likened_hits": int(np.count_nonzero(likened & cases.incident)),
        "has_index": bool(indexed.any()),
        "indexed": int(np.count_nonzero(indexed)),
        "collisions": [
            (cases[place], float(avoided), float(lost), float(losses[place]))
            for place, avoided, lost in zip(
                hits.places[:MOST_LISTED], hits.avoided, hits.lost, strict=False
            )
        ],
        "more_collisions": max(len(hits.places) - MOST_LISTED, 0),
    }


def _origin(evaluation: Evaluation) -> list[tuple[str, str]]:
    """Where the numbers come from: versions, machine, time, seed."""
    manifest = evaluation.manifest
    rows = [("seed", str(evaluation.settings.seed))]
    rows += [
        (label, str(manifest[key]))
        for label, key in (
            ("recorded", "created"),
            ("format version", "format_version"),
            ("paths start in", "source_folder"),
        )
        if key in manifest
    ]
    rows += [(name, str(value)) for name, value in manifest.get("versions", {}).items()]
    rows += [(name, str(value)) for name, value in manifest.get("machine", {}).items()]
    return rows
