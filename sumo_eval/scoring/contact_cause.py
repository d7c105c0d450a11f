"""Cause of a contact: when its ADS braked, beside the point of no return."""

from __future__ import annotations

from typing import NamedTuple

from sumo_eval.record.store import Fact
from sumo_eval.trajectory import NEVER, NO_RETURN, UNKNOWN


class ContactCause(NamedTuple):
    """Fields of a case with a contact; their meanings are those of `CaseResult`."""

    contact_cause: str
    no_return_time: float | None = None
    braking_time: float | None = None


def cause_of_contact(fact: Fact) -> ContactCause:
    """Cause of a contact, from when its ADS braked and the point of no return.

    never_braked, late: first after the point of no return, weak: before it, unavoidable_by_braking:
    full braking from the start on does not avoid it. not_repeatable: the replay is another drive.
    """
    clip = next((clip for clip in fact.clips if clip.what == NO_RETURN), None)
    if clip is None or clip.first_time == UNKNOWN:
        return ContactCause("not_repeatable")
    last, braked = clip.first_time, clip.requested
    if last == NEVER:
        return ContactCause("unavoidable_by_braking")
    if braked == NEVER:
        return ContactCause("never_braked", last)
    return ContactCause("late" if braked > last else "weak", last, braked)
