"""Cause of a contact: when the ADS braked, compared with the point of no return, the last time at
which full braking would have avoided the contact.

Users: `report/levers_section.py`, `report/replay.py`, `report/sent_drives.py`, `report/words.py`,
`scoring/quantities.py`. Fixed: the causes, which are values in cases.csv.
"""

from typing import NamedTuple

from sumo_eval.record.case_rows import Fact
from sumo_eval.trajectory import NEVER, NO_RETURN, UNKNOWN


class ContactCause(NamedTuple):
    """Fields of a case with a contact; their meanings are those of `CaseResult`."""

    contact_cause: str
    no_return_time: float | None = None
    braking_time: float | None = None


def cause_of_contact(fact: Fact) -> ContactCause:
    """Cause of a contact.

    never_braked: the ADS did not brake.
    late: the ADS first braked after the point of no return.
    weak: the ADS first braked before the point of no return.
    unavoidable_by_braking: full braking from the start on does not avoid the contact.
    not_repeatable: a replay of the drive does not end in this contact, or there was no replay.
    """
    clip = next((clip for clip in fact.clips if clip.what == NO_RETURN), None)
    if clip is None or clip.first_time == UNKNOWN:
        return ContactCause("not_repeatable")
    # this clip's fields: point of no return, s, and time of the first braking, s (`NO_RETURN`)
    no_return, braking = clip.first_time, clip.requested
    if no_return == NEVER:
        return ContactCause("unavoidable_by_braking")
    if braking == NEVER:
        return ContactCause("never_braked", no_return)
    return ContactCause("late" if braking > no_return else "weak", no_return, braking)
