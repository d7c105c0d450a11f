"""The report of a run with the confidence in its scores: assessed, kept as `confidence.json`, and shown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sumo_eval.evaluation import zone_partitions
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.report.confidence_section import write_confidence
from sumo_eval.report.html import NOTHING_BESIDE, write_report
from sumo_eval.report.sections import Beside
from sumo_eval.results import Evaluation
from sumo_eval.scoring.confidence.assessment import assess


def write_assessed_report(
    evaluation: Evaluation, beside: Beside = NOTHING_BESIDE, *, progress: Progress = quiet
) -> Path:
    """Write `confidence.json` and `report.html` into the evaluation's folder; the report's path."""
    partitions = zone_partitions(evaluation)
    confidence = assess(evaluation, partitions, progress)
    write_confidence(confidence, evaluation.folder)
    path = write_report(evaluation, partitions, replace(beside, confidence=confidence))
    progress("report", 1, 1)
    return path
