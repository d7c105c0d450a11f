"""The report's section on confidence: intervals, risk, further cases, and the coverage of
each space by the cases.

Users: `report/assessed.py`, `report/sections.py`.
"""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from sumo_eval.report.page import CONFIDENCE, Json, write_json
from sumo_eval.report.verdict import Additions
from sumo_eval.report.words import count, percent
from sumo_eval.results import Evaluation
from sumo_eval.scoring.confidence.assessment import Assessment, Confidence
from sumo_eval.scoring.confidence.coverage import PairCoverage, SpaceCoverage

MOST_FURTHER = 8  # further cases that the page lists; the file has all of them
CELL = 17  # px, side of a bucket in the picture


def write_confidence(confidence: Confidence, folder: Path) -> Path:
    """Write `confidence.json` into a run's folder and return its path."""
    return write_json(folder / CONFIDENCE, confidence_json(confidence), "The confidence")


def confidence_json(confidence: Confidence) -> Json:
    """All that the section shows, except its pictures, in plain values."""
    return {
        "scores": [
            _assessment_json(item, confidence.coverage[item.scenario])
            for item in confidence.assessments
        ],
        "coverage": {name: _coverage_json(item) for name, item in confidence.coverage.items()},
    }


def confidence_content(evaluation: Evaluation, additions: Additions) -> Json | None:
    """Content of templates/sections/confidence.html.j2; None where it was not assessed."""
    confidence = additions.confidence
    if confidence is None:
        return None
    return {
        "rows": confidence.assessments,
        "spaces": [
            _space(zone.scenario, confidence.coverage[zone.scenario]) for zone in evaluation.zones
        ],
        "further": [_further(item, confidence) for item in confidence.assessments],
    }


def _further(item: Assessment, confidence: Confidence) -> Json:
    """Further cases of an ADS in a scenario that would narrow S, and by how much."""
    plain: Json = {"ads": item.ads, "scenario": item.scenario}
    further = item.further
    if further is None or "s" not in item.sources or not len(further.points):
        return plain | {"points": []}
    # the parameters, in the order of the columns of `further.points`
    names = confidence.coverage[item.scenario].empty_centre
    # points, of the interval of S if only the choice of cases were uncertain
    half_width = item.sources["s"]["cases"]
    return plain | {
        "count": len(further.points),
        "before": f"{half_width:z.1f}",
        "after": f"{half_width * further.shrink:z.1f}",
        "points": [
            ", ".join(f"{name} = {value:z.4g}" for name, value in zip(names, row, strict=True))
            for row in further.points[:MOST_FURTHER].tolist()
        ],
    }


def _space(name: str, item: SpaceCoverage) -> Json:
    """Coverage of a scenario's space, in words and pictures."""
    hit, possible = item.pairs_hit
    return {
        "name": name,
        "buckets": [
            f"{parameter}: {hits} of {possible}"
            for parameter, (hits, possible) in item.buckets.items()
        ],
        "pairs": f"{hit} of {possible}" if possible else "–",  # of buckets
        "radius": f"{item.empty_radius:z.3f}",  # in the unit box
        "centre": ", ".join(
            f"{parameter} = {value:z.4g}" for parameter, value in item.empty_centre.items()
        ),
        "resolved": "no boundary"
        if item.boundary_resolved is None
        else percent(item.boundary_resolved),
        "inside": percent(item.exposure_inside),
        "pictures": [_picture(pair) for pair in item.pairs],
    }


def _picture(pair: PairCoverage) -> Json:
    """Cells of one pair's heat map, y upwards: the stronger the colour, the more cases; no colour:
    none; grey: impossible.

    `row` of a cell, in the saved table: bucket of x and of y, counted from 1; number of points.
    """
    height, width = pair.counts.shape
    most = max(float(pair.counts.max()), 1.0)
    cells = []
    for (y, x), number in np.ndenumerate(pair.counts):
        points = int(number)  # below 0: no point is possible
        shade = 0.0 if points <= 0 else 0.25 + 0.75 * points / most
        cells.append({
            "x": CELL * x,
            "y": CELL * (height - 1 - y),
            "opacity": f"{shade:z.2f}",
            "kind": "impossible" if points < 0 else "empty" if points == 0 else "hit",
            "words": "no possible point" if points < 0 else count(points, "point"),
            "row": (x + 1, y + 1, None if points < 0 else points)
        })  # fmt: skip
    return {
        "x": pair.x,
        "y": pair.y,
        "cells": cells,
        "width": CELL * width,
        "height": CELL * height,
        "cell": CELL,
    }


def _assessment_json(item: Assessment, coverage: SpaceCoverage) -> Json:
    """One ADS in one scenario: its intervals by score, `SCORE_half_width_by_source`, the fields of
    `Risk`, `further_cases`.
    """
    plain: Json = {"ads": item.ads, "scenario": item.scenario, "reason": item.reason}
    plain |= {name: asdict(interval) for name, interval in item.intervals.items()}
    plain |= {f"{name}_half_width_by_source": parts for name, parts in item.sources.items()}
    if item.risk is not None:
        plain |= asdict(item.risk)
    if item.further is not None:
        plain["further_cases"] = {
            "shrink": item.further.shrink,
            "points": [
                dict(zip(coverage.empty_centre, row, strict=True))
                for row in item.further.points.tolist()
            ],
        }
    return plain


def _coverage_json(item: SpaceCoverage) -> Json:
    """Coverage of a scenario's space, as numbers."""
    hit, possible = item.pairs_hit
    return {
        "buckets": {name: {"hit": got, "possible": of} for name, (got, of) in item.buckets.items()},
        "pairs": {"hit": hit, "possible": possible},
        "largest_empty_ball": {"radius": item.empty_radius, "centre": item.empty_centre},
        "boundary_resolved": item.boundary_resolved,
        "exposure_inside": item.exposure_inside,
    }
