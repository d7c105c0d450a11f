"""Counting clips: requests that a limit or a check did not let through as they were."""

from __future__ import annotations

from sumo_eval.trajectory import Clip


def count_clip(clips: dict[str, Clip], what: str, time: float, requested: float, applied: float) -> None:
    """Count a clip at `time` (s) and keep its worst instance."""
    known = clips.get(what)
    if known is None:
        clips[what] = Clip(what, 1, time, float(requested), float(applied))
        return
    if abs(requested - applied) <= abs(known.requested - known.applied):
        requested, applied = known.requested, known.applied
    clips[what] = Clip(what, known.count + 1, known.first_time, float(requested), float(applied))
