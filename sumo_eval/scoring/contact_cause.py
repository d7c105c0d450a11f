"""Cause of a contact, by when its ADS braked and by the point of no return.

Users: `report/levers_section.py`, `report/replay.py`, `report/sent_drives.py`, `report/words.py`,
`scoring/quantities.py`.
"""

from typing import NamedTuple

from sumo_eval.record.store import Fact
from sumo_eval.trajectory import NEVER, NO_RETURN, UNKNOWN


class ContactCause(NamedTuple):
    """Fields of a case with a contact; their meanings are those of `CaseResult`."""

    contact_cause: str
    no_return_time: float | None = None
    braking_time: float | None = None


def cause_of_contact(fact: Fact) -> ContactCause:
    """Cause of a contact, by when its ADS braked and by the point of no return.

    never_braked: it did not brake.
    late: it first braked after the point of no return.
    weak: it first braked before that.
    unavoidable_by_braking: full braking from the start on does not avoid the contact.
    not_repeatable: a replay of the drive does not end in this contact, or none was made.
    """
    clip = next((clip for clip in fact.clips if clip.what == NO_RETURN), None)
    if clip is None or clip.first_time == UNKNOWN:
        return ContactCause("not_repeatable")
    last, braked = clip.first_time, clip.requested  # s; `NO_RETURN` defines both
    if last == NEVER:
        return ContactCause("unavoidable_by_braking")
    if braked == NEVER:
        return ContactCause("never_braked", last)
    return ContactCause("late" if braked > last else "weak", last, braked)
