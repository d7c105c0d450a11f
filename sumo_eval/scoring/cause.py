"""The cause of a contact, from when its ADS braked and the point of no return."""

from __future__ import annotations

from typing import Any

from sumo_eval.cosim.no_return import NEVER, NO_RETURN, UNKNOWN
from sumo_eval.record.store import Fact

__all__ = ["NO_RETURN", "cause_of_contact"]


def cause_of_contact(fact: Fact) -> dict[str, Any]:
    """The fields `no_return_time` and `contact_cause` of a case with a contact.

    never_braked, late: first after the point of no return, weak: before it, unavoidable_by_braking:
    full braking from the start on does not avoid it. not_repeatable: the replay is another drive.
    """
    clip = next((clip for clip in fact.clips if clip.what == NO_RETURN), None)
    if clip is None or clip.first_time == UNKNOWN:
        return {"contact_cause": "not_repeatable"}
    last, braked = clip.first_time, clip.requested
    if last == NEVER:
        return {"contact_cause": "unavoidable_by_braking"}
    late = "late" if braked > last else "weak"
    cause = "never_braked" if braked == NEVER else late
    return {
        "no_return_time": last,
        "contact_cause": cause,
        "braking_time": None if braked == NEVER else braked,
    }
