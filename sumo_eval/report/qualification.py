"""The qualification that a run names, in words: whether the tool passed, and whether that holds for
this run.

Users: `report/evidence.py`, `report/sections.py`, `report/terminal.py`.
"""

from collections.abc import Mapping
from typing import Any

from sumo_eval.report.verdict import Additions
from sumo_eval.results import Evaluation


def differences(manifest: Mapping[str, Any]) -> list[str]:
    """Versions and properties of the machine that changed from the qualification to the run:
    `libsumo 1.27.0 instead of 1.28.0`, the value of the qualification first.

    A name that only one of both has does not count.
    """
    qualified = manifest["qualification"]
    return [
        f"{name} {qualified[group][name]} instead of {value}"
        for group in ("versions", "machine")
        for name, value in manifest[group].items()
        if qualified[group].get(name, value) != value
    ]


def holds(manifest: Mapping[str, Any]) -> bool:
    """Whether the run names a qualification that passed, with its own versions and on its own
    machine.
    """
    qualification = manifest.get("qualification")
    return qualification is not None and not qualification["failed"] and not differences(manifest)


def qualification_sentence(manifest: Mapping[str, Any]) -> str:
    """Whether this installation is qualified, and how to qualify it where it is not."""
    qualification = manifest.get("qualification")
    if qualification is None:
        return (
            "No qualification of the tool is named: `sumo-eval qualify` makes one, "
            "`qualification` of [run] names it."
        )
    checks, failed = qualification["checks"], qualification["failed"]
    text = (
        f"Qualification of {qualification['created']}: {checks - len(failed)} of {checks} known "
        "answers were found again"
    )
    if failed:
        return f"{text}, so the tool is NOT qualified: {'; '.join(failed[:5])}."
    changed = differences(manifest)
    if changed:
        return f"{text}, but not with what made this run: {'; '.join(changed)}."
    return f"{text}, with the versions and on the machine of this run."


def qualification_content(evaluation: Evaluation, _: Additions) -> Mapping[str, Any] | None:
    """Content of the report's section; None where the run names no qualification."""
    manifest = evaluation.manifest
    qualification = manifest.get("qualification")
    if qualification is None:
        return None
    rows = {"file": qualification["file"], "SHA-256": qualification["sha256"]}
    rows |= qualification["versions"] | qualification["machine"]
    return {
        "sentence": qualification_sentence(manifest),
        "holds": holds(manifest),
        "failed": qualification["failed"],
        "rows": list(rows.items()),
    }
