"""Notes as sentences: what a run left out, replaced or could not evaluate, and why.

Kinds of notes are defined where they are made: of D_i in `method/index_terms.py`, of scores in
`score_notes.py`. Each has its sentence here. Free to change: sentences; not keys.

Users: `nightly/rule_limits.py`, `report/explain.py`, `report/html.py`, `report/junit.py`,
`report/page_data.py`, `report/tables.py`, `report/terminal.py`.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from sumo_eval.cases import CaseResult
from sumo_eval.groups import grouped
from sumo_eval.method.index_terms import IndexNote, NoteKind
from sumo_eval.method.manoeuvres import words as manoeuvre_words
from sumo_eval.report.words import count, interval_words
from sumo_eval.results import Evaluation
from sumo_eval.score_notes import (
    BeyondRange,
    CasesMissing,
    Counted,
    DrivenAlone,
    DrivenInBlocks,
    DrivesLeftOut,
    PlausibleTo,
    ReferenceMissing,
    RequirementMissed,
    ScoreNote,
    ThinReferences,
    WorstAndBest,
)
from sumo_eval.scoring.findings import findings_of

GIVEN_UP = " (cases given up count in T, A and H)"
_STATUS = {
    "timeout": "The case exceeded its time limit.",
    "ads_error": "The controller failed.",
    "ads_timeout": "One step of the controller exceeded its time limit.",
    "sim_error": "SUMO refused or lost something.",
    "crashed": "The process that ran the case died.",
    "rejected": "The case was refused before it began.",
}
_REFERENCES = {
    "ideal": ("the ideal vehicle's drive", "Ug"),
    "no_reaction": ("the drive of `no_reaction`", "U0"),
}
"""Drive of a reference in words, and the symbol that needs it."""
_LEFT_OUT = {
    "collision": "collided",
    "off_road": "left the road",
    "timeout": "took too long",
    "ads_error": "failed",
    "ads_timeout": "took too long over one step",
    "sim_error": "were refused by SUMO",
    "crashed": "ended with their process",
    "rejected": "were refused before they began",
}
"""Outcome of drivers' drives that do not count as a reference, by status."""


def why_missing(case: CaseResult) -> str:
    """Reason why a case is missing from a mean, for missing cases only."""
    if not case.evaluated:
        return case.error or _STATUS.get(case.status, f"Its status is {case.status}.")
    for severity, whose, symbol, error in (
        (case.ideal_severity, "The ideal vehicle's case", "Ug", case.ideal_error),
        (case.no_reaction_severity, "The case of `no_reaction`", "U0", case.no_reaction_error),
    ):
        if severity is None:
            words = f"{whose} here could not be evaluated, so {symbol} is not known."
            return words + because(error)
    few = "Fewer than two human drivers could be compared with here."
    return f"There is no D_i: {index_note_words(case) or reference_note_words(case) or few}"


_INDEX_NOTES: dict[NoteKind, str] = {
    "manoeuvre_made_by": "Compared with the {count} of {of} drivers who made the same manoeuvre "
    "({done}).",
    "manoeuvre_made_by_nobody": "No driver made the ADS's manoeuvre ({done}), so its similarity "
    "is 0.",
    "centre_floor": "Deviation floor of the centre applied at {count} of {of} slices.",
    "field_floor": "Deviation floor of the field applied at {count} of {of} points.",
    "two_groups": "At {count} of {of} slices the drivers are in two groups, over half a lane "
    "apart (bimodal).",
    "driver_not_so_far": "At {count} of {of} slices some drivers had not got that far.",
    "drivers_hold_last_y": "At {count} of {of} slices fewer than two drivers had got that far; "
    "the rest hold their last y.",
    "ads_off_road": "At {count} of {of} slices the ADS's centre is off the road; the points of "
    "that side coincide with it.",
    "past_the_road": "{count} of {of} trajectories continue past the road's end and are read up "
    "to it.",
    "drivers_start_late": "{count} of {of} drivers start beyond the ADS's start and hold their "
    "first y up to there.",
    "drivers_still_driving": "{count} of {of} drivers were still driving when last seen: their "
    "length counts to the road's end.",
    "ads_still_driving": "The ADS was still driving when last seen: its length counts to the "
    "road's end, and slices end there.",
    "ads_left_the_road": "The ADS left the road: its length is what it drove.",
    "drivers_without_operation": "The drivers made no operation at all, so the ADS's operations "
    "make D zero.",
}


def notes_sentence(notes: Sequence[IndexNote]) -> str:
    """Sentence for all notes of one kind and manoeuvre, with the ranges of their numbers."""
    first = notes[0]
    counts, totals = _range([note.count for note in notes]), _range([note.of for note in notes])
    done = manoeuvre_words(first.manoeuvre) if first.manoeuvre else ""
    return _INDEX_NOTES[first.kind].format(count=counts, of=totals, done=done)


def index_note_words(case: CaseResult) -> str:
    """Notes on the D_i of a case; empty without any."""
    return " ".join(notes_sentence([note]) for note in case.index_note)


def reference_note_words(case: CaseResult) -> str:
    """Reason why the drivers of a case are too few, and the consequence; empty where they are
    enough.
    """
    note = case.reference_note
    if note is None:
        return ""
    ending = "left out." if note.filled is None else f"filled with {note.filled} synthetic ones."
    return (
        f"Reference too thin: {note.recorded} of at least {note.least} recorded drivers; {ending}"
    )


def exposure_note_words(case: CaseResult) -> str:
    """A note where no recorded event is like the case; else empty."""
    outside = "Outside the data's support: no recorded event is like this concrete scenario."
    return outside if case.exposure_note == "outside_support" else ""


_COUNTED = {
    "compared": "{number} of {of} cases that shared SUMO were compared alone: equal.",
    "actors_left": "In {cases} an actor reached the end of the network and left it; the case "
    "continued without it (clip `actor_left_the_network`).",
    "actors_moved": "In {cases} the ADS moved an actor off its script (clip "
    "`actor_off_its_script`): do not compare these cases with those of other ADSs.",
    "outside_support": "{number} of {of} cases lie outside the support of the recorded exposure.",
    "struck_from_behind": "In {cases} an actor that reacts ran into the ego's rear: its own fault, "
    "counted apart, no collision for C and A (`method.collision.rear_end`). Its t_i is 0: any "
    "contact ends the drive, whichever vehicle is at fault.",
    "excused": "In {number} of {of} safe cases the ego stands where the references drive on. T "
    "leaves out the rest of the route, because a road user in front excuses it.",
    "cut_short": "{number} of {of} safe cases ended as decided (`simulation.end_when_decided`). T "
    "counts the rest of their route as not driven, so T and S+ are too low; D and H come from "
    "shorter drives.",
    "gentler_than_ideal": "In {hits} the ADS hit more softly than the ideal vehicle; each has the "
    "ratio 1.",
    "references_collide": "The space is called safe at {of_points}, yet drivers or the reference "
    "car collide at {number} of them: a scripted actor does not react and may strike an ego that "
    "slows down. If another actor is struck, check `zone.obstacle` of the scenario. Synthetic "
    'drivers do not see actors that cross: such a scenario needs `people = "none"`.',
    "ideal_collides_too": "The ideal vehicle has {number} of {of_hits} in the safe zone as well: C "
    "and A count them, D and H leave them out.",
}
"""Sentence of a `Counted` note, by what it counts."""


def score_note(note: ScoreNote) -> str:
    """One note on a score as sentences."""
    match note:
        case DrivesLeftOut() | ThinReferences() | DrivenAlone() | DrivenInBlocks():
            return _drives_note(note)
        case CasesMissing() | ReferenceMissing() | WorstAndBest():
            return _missing_note(note)
        case BeyondRange(severity, reasons):
            why = "; ".join(f"{number} x {reason}" for reason, number in reasons)
            hits = sum(number for _, number in reasons)
            return f"{count(hits, 'collision')} outside the range of `{severity}`: {why}."
        case Counted(what, counted, of):
            return _COUNTED[what].format(
                number=counted, of=of, cases=count(counted, "case"),
                hits=count(counted, "collision"),
                of_points=count(of, "point"), of_hits=count(of, "collision")
            )  # fmt: skip
        case PlausibleTo(scenario, people, drives, least, instead):
            compared = (
                f"{people} recorded drivers of the run ({drives} drives)"
                if instead is None
                else f"{instead} people on a motorway: the run has {people} recorded drivers in "
                f"`{scenario}`, and a table needs {least}"
            )
            return f"Plausibility compares with {compared}."
        case RequirementMissed(name, text, cases, of, undecided, example):
            words = f"`{text}`" if name == text else f"{name} (`{text}`)"
            missed = f"{cases} of {count(of, 'case')} miss the requirement {words}."
            if not undecided:
                return missed
            return (
                f"{missed} In {undecided} of them it cannot be decided, because a value is "
                f"not a number (such as inf - inf), first in {example}."
            )


def _drives_note(note: DrivesLeftOut | ThinReferences | DrivenAlone | DrivenInBlocks) -> str:
    """Note on drives that a reference leaves out or lacks, or how drives shared simulations."""
    match note:
        case DrivesLeftOut(left_out, drives, statuses):
            how = ", ".join(f"{n} {_LEFT_OUT.get(status, status)}" for status, n in statuses)
            return f"The reference leaves out {left_out} of the drivers' {drives} drives: {how}."
        case ThinReferences(thin, safe, left_out):
            return (
                f"Reference too thin in {thin} of {safe} safe cases: {thin - left_out} filled with "
                f"synthetic drivers, {left_out} left out of D."
            )
        case DrivenAlone(alone):
            why = " ".join(f"{number} x: {reason}" for reason, number in alone)
            drives = sum(times for _, times in alone)
            return (
                f"{count(drives, 'drive')} could not share one simulation with others and ran "
                f"alone, which changes results of policies over arrays only. {why}"
            )
        case DrivenInBlocks(drives, sizes):
            return (
                "Its policy over arrays received cases in fixed batches of "
                f"{' and '.join(map(str, sizes))} ({count(drives, 'drive')}). The last bits of its "
                "answers may depend on the batch."
            )


def _missing_note(note: CasesMissing | ReferenceMissing | WorstAndBest) -> str:
    """Note on cases or references that could not be evaluated, or on their possible effect."""
    match note:
        case CasesMissing(zones):
            places = " and ".join(f"{number} in the {zone} zone" for zone, number in zones)
            return (
                f"{count(note.cases, 'case')} could not be evaluated ({places}); the scores are "
                f"means over the rest{GIVEN_UP}."
            )
        case ReferenceMissing(who, reason, cases, example):
            drive, symbol = _REFERENCES[who]
            return (
                f"In {count(cases, 'case')}, e.g. {example}, {drive} could not be evaluated, so "
                f"{symbol} is not known.{because(reason)}"
            )
        case WorstAndBest(c, d, s):
            scores = ("C", c, 3), ("D", d, 3), ("S", s, 1)
            parts = [f"{name} within {interval_words(it, n)}" for name, it, n in scores if it]
            return f"With the missing cases counted as worst and as best: {', '.join(parts)}."


class GatheredNote(NamedTuple):
    """A note that D_i left in several cases of one ADS and scenario; numbers that differ stand as a
    range.
    """

    ads: str
    scenario: str
    cases: int
    text: str


def index_notes(evaluation: Evaluation) -> list[GatheredNote]:
    """The notes on D_i, gathered by kind and manoeuvre, the most frequent first."""
    gathered = []
    for findings in findings_of(evaluation):
        # each different note -> number of cases
        often = Counter(note for notes in findings.cases.index_note for note in notes)
        # the same notes by kind and manoeuvre
        alike = grouped(((note.kind, note.manoeuvre), note) for note in often)
        cases = {key: sum(often[note] for note in notes) for key, notes in alike.items()}
        gathered += [
            GatheredNote(
                findings.score.ads, findings.score.scenario, cases[key], notes_sentence(alike[key])
            )
            for key in sorted(alike, key=lambda key: (-cases[key], key))
        ]
    return gathered


def _range(numbers: Sequence[int]) -> str:
    """`3`, or `3 to 5`."""
    low, high = min(numbers), max(numbers)
    return f"{low}" if low == high else f"{low} to {high}"


def because(error: str) -> str:
    """The recorded error of a reference's drive, as a sentence that follows what it explains."""
    return f" Recorded of it: {_STATUS.get(error, error)}" if error else ""
