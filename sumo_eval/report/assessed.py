"""The report of a run with the confidence in its scores, which is computed here and kept in
`confidence.json`.

Users: `cli/compare.py`, `cli/finish.py`, `cli/look.py`, `nightly/night.py`.
"""

from __future__ import annotations

import hashlib
from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from sumo_eval.record.fingerprint import sources
from sumo_eval.record.kept_results import KeptResults, key_of
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.report.opinion_section import OPINION
from sumo_eval.report.page import CONFIDENCE, REPORT
from sumo_eval.report.people import STUDY
from sumo_eval.results import Evaluation

if TYPE_CHECKING:
    from sumo_eval.report.verdict import Additions


def write_assessed_report(
    evaluation: Evaluation, additions: Additions | None = None, *, progress: Progress = quiet
) -> Path:
    """Write `confidence.json` and `report.html` into `evaluation.folder`; return the report's path.

    Without additions, both files stay if they are unchanged and made of the same scores, settings
    and sources: the run's cache holds a hash of both under `_key`.
    """
    path, data = evaluation.folder / REPORT, evaluation.folder / CONFIDENCE
    key = _key(evaluation) if additions is None else None  # None: written in any case
    with closing(KeptResults(evaluation.folder)) if key else nullcontext() as kept:
        if kept is None or key is None or kept.get("report", key) != _hash(path, data):
            # these imports take a second, and an unchanged page does not need them
            from sumo_eval.evaluation import zone_partitions
            from sumo_eval.report.confidence_section import write_confidence
            from sumo_eval.report.html import NO_ADDITIONS, write_report
            from sumo_eval.scoring.confidence.assessment import assess

            partitions = zone_partitions(evaluation)
            confidence = assess(evaluation, partitions, progress)
            write_confidence(confidence, evaluation.folder)
            write_report(
                evaluation, partitions, (additions or NO_ADDITIONS)._replace(confidence=confidence)
            )
            if kept is not None and key is not None:
                kept.put([("report", key, 0, _hash(path, data))])
    progress("report", 1, 1)
    return path


def _key(evaluation: Evaluation) -> bytes | None:
    """A hash of all that the page shows; None for an evaluation that was not read from a run's
    folder.
    """
    if evaluation.cases.key is None:
        return None
    studies = _hash(
        evaluation.folder / OPINION, evaluation.source / evaluation.settings.drivers.cases / STUDY
    )
    return key_of(
        "report",
        evaluation.cases.key,
        evaluation.settings,
        evaluation.manifest,
        evaluation.folder,
        studies,
        sources("report"),
    )


def _hash(*files: Path) -> bytes:
    """One hash of the bytes of files; a missing one counts as empty."""
    digest = hashlib.blake2b(digest_size=16)
    for file in files:
        digest.update(file.read_bytes() if file.is_file() else b"")
        digest.update(b"\0")
    return digest.digest()
