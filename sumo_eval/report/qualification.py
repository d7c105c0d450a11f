"""The qualification that a run names, in words: whether the tool passed, and whether that holds for
this run.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sumo_eval.report.verdict import Beside
from sumo_eval.results import Evaluation


def differences(manifest: Mapping[str, Any]) -> list[str]:
    """In what the qualification's versions and machine are not those of the run: `libsumo 1.27.0
    instead of 1.28.0`.
    """
    found = manifest["qualification"]
    return [
        f"{name} {there[name]} instead of {value}"
        for there, here in (
            (found["versions"], manifest["versions"]),
            (found["machine"], manifest["machine"]),
        )
        for name, value in here.items()
        if name in there and there[name] != value
    ]


def holds(manifest: Mapping[str, Any]) -> bool:
    """Whether the run names a qualification that passed, with its own versions and on its own
    machine.
    """
    found = manifest.get("qualification")
    return found is not None and not found["failed"] and not differences(manifest)


def qualification_sentence(manifest: Mapping[str, Any]) -> str:
    """Whether this installation is qualified, and how to qualify it where it is not."""
    found = manifest.get("qualification")
    if found is None:
        return (
            "No qualification of the tool is named: `sumo-eval qualify` makes one, "
            "`qualification` of [run] names it."
        )
    passed = found["checks"] - len(found["failed"])
    text = (
        f"Qualification of {found['created']}: {passed} of {found['checks']} known answers were "
        "found again"
    )
    if found["failed"]:
        return f"{text}, so the tool is NOT qualified: {'; '.join(found['failed'][:5])}."
    others = differences(manifest)
    if others:
        return f"{text}, but not with what made this run: {'; '.join(others)}."
    return f"{text}, with the versions and on the machine of this run."


def qualification_content(evaluation: Evaluation, _: Beside) -> Mapping[str, Any] | None:
    """Content of the report's section; None where the run names no qualification."""
    manifest = evaluation.manifest
    found = manifest.get("qualification")
    if found is None:
        return None
    rows = {"file": found["file"], "SHA-256": found["sha256"]}
    rows |= found["versions"] | found["machine"]
    return {
        "sentence": qualification_sentence(manifest),
        "holds": holds(manifest),
        "failed": found["failed"],
        "rows": list(rows.items()),
    }
