"""Notes on scores as records of plain values.

`scoring/` leaves them on results, `report/notes.py` makes the sentences.

Users: `report/`, `results.py`, `scoring/`, `extras/rates/learned.py`.
"""

from typing import Literal

from sumo_eval.cases import Zone
from sumo_eval.frozen import frozen
from sumo_eval.trajectory import Alone

Bounds = tuple[float, float]
"""Lower and upper end of an interval."""


@frozen
class DrivesLeftOut:
    """Note on drives of human drivers that did not end with status `ok`: D_i leaves them out.

    left_out: number of these drives.
    drives: number of all drives of human drivers.
    statuses: (status, number) of the drives that are left out.
    """

    left_out: int
    drives: int
    statuses: tuple[tuple[str, int], ...]


@frozen
class DrivenAlone:
    """Note on drives that could not share a simulation and ran alone: (reason, number) of them."""

    reasons: tuple[tuple[Alone, int], ...]


@frozen
class DrivenInBlocks:
    """Note on a policy over arrays: last bits of its results may depend on its fixed batches.

    drives: number of its drives.
    sizes: numbers of cases that its fixed batches ("blocks") had, each size once.
    """

    drives: int
    sizes: tuple[int, ...]


@frozen
class Counted:
    """Note that counts cases, collisions or points: `number` of `of` are of the kind `what`.

    compared: cases of TraCI code that shared a simulation and were repeated alone, with equal
        results.
    actors_left: cases that lasted longer than an actor was on the road.
    actors_moved: cases in which the ADS moved an actor off its script.
    outside_support: cases in which no recorded event is like the concrete scenario.
    struck_from_behind: cases in which a vehicle that reacts ran into the ego's rear: its own fault,
        and not a collision of the ADS.
    excused: safe cases in which the ego stands behind a road user where the references drive on: T
        leaves out the rest of the route.
    cut_short: safe cases that ended as decided, before the end of their route.
    gentler_than_ideal: collisions that are less severe than the ideal vehicle's.
    references_collide: points of the safe zone at which drivers or the reference car collide.
    ideal_collides_too: collisions in the safe zone at points where the ideal vehicle collides too.
    """

    what: Literal[
        "compared",
        "actors_left",
        "actors_moved",
        "outside_support",
        "struck_from_behind",
        "excused",
        "cut_short",
        "gentler_than_ideal",
        "references_collide",
        "ideal_collides_too",
    ]
    number: int
    of: int


@frozen
class BeyondRange:
    """Note on collisions outside the range for which a severity function is known.

    severity: name of the function.
    reasons: (what lies outside, in the function's words; number of collisions).
    """

    severity: str
    reasons: tuple[tuple[str, int], ...]


@frozen
class ThinReferences:
    """Note on safe cases with too few recorded drivers.

    thin: their number.
    safe: number of all safe cases.
    left_out: number of thin cases that D leaves out; synthetic drivers fill up the rest.
    """

    thin: int
    safe: int
    left_out: int


@frozen
class PlausibleTo:
    """Note on the drivers that plausibility compares with, where `plausibility.table` requests the
    recorded ones.

    people: number of recorded drivers of the run in the scenario.
    drives: number of their drives.
    least: number of drivers that a table needs.
    instead: number of drivers of the motorway table, which replaces them as they are fewer than
        `least`; None: it does not.
    """

    scenario: str
    people: int
    drives: int
    least: int
    instead: int | None


@frozen
class CasesMissing:
    """Note on cases that could not be evaluated: (zone, number of cases in it)."""

    zones: tuple[tuple[Zone, int], ...]

    @property
    def cases(self) -> int:
        """All of them."""
        return sum(number for _, number in self.zones)


@frozen
class ReferenceMissing:
    """Note on cases whose reference could not be evaluated, for one reason.

    who: the reference: the ideal vehicle or `no_reaction`.
    reason: error message of the first of these cases; those of the rest differ only in numbers.
    cases: number of these cases.
    example: key of the first.
    """

    who: Literal["ideal", "no_reaction"]
    reason: str
    cases: int
    example: str


@frozen
class WorstAndBest:
    """Note on C, D and S with the missing cases counted as worst and as best; None: nothing is
    missing in that score.
    """

    c: Bounds | None
    d: Bounds | None
    s: Bounds


@frozen
class RequirementMissed:
    """Note on a requirement of the scenario that some cases miss.

    name, text: its name and condition, as in the scenario's file.
    cases: number of cases that miss it.
    of: number of evaluated cases.
    undecided: number of those of them in which it cannot be decided.
    example: key and moment of the first of these, in words.
    """

    name: str
    text: str
    cases: int
    of: int
    undecided: int = 0
    example: str = ""


ScoreNote = (
    DrivesLeftOut
    | DrivenAlone
    | DrivenInBlocks
    | Counted
    | BeyondRange
    | ThinReferences
    | PlausibleTo
    | CasesMissing
    | ReferenceMissing
    | WorstAndBest
    | RequirementMissed
)
"""A note on a score as numbers; `report/notes.py` makes the sentences."""
