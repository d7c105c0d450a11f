"""The result of one case: fields that are recorded or computed once, and properties that follow.

`scoring/` makes records, `report/` and `nightly/` read them; `case_table.py` holds many of them as
a table.

Users: `case_table.py`, `nightly/`, `record/`, `report/`, `results.py`, `score_notes.py`,
`scoring/`, `whatif/`, `extras/`.
"""

# annotations stay texts, which `case_table.py` and `record/exchange.py` read
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from sumo_eval.frozen import frozen
from sumo_eval.method.index_terms import IndexNote
from sumo_eval.settings.locators import load_object
from sumo_eval.trajectory import FloatArray

Zone = Literal["safe", "hazardous"]
Measure = float | None
"""A number; None: it does not apply, or could not be evaluated."""

EVALUATED = "ok", "collision", "off_road"
"""Statuses of cases that were evaluated, i.e. whose outcome counts in all scores."""
OUTCOMES = "no contact", "collision", "off road", "not evaluated"
"""Outcomes of a case, in the order in which the report shows them."""
GAVE_UP = "ads_error", "ads_timeout", "timeout", "crashed", "rejected"
"""Statuses of cases that failed because of their ADS: it "gave up".

These cases were not evaluated, but count in T, A, A', H and S+. The status `sim_error` is in
neither list: it is a fault of the simulation and counts nowhere.
"""


@frozen
class ThinReference:
    """Note on a case with fewer recorded drivers than the evaluation requires.

    recorded: number of recorded drivers.
    least: number that is required.
    filled: number of synthetic drivers that were added; None: the case is left out of D instead.
    """

    recorded: int
    least: int
    filled: int | None


def _rule(compute: Callable[[Any], Any]) -> Any:
    """Make a property of a method that computes an outcome from fields of a record or table.

    For a record its value is plain (bool, float or str), for a table an array (n,).
    """

    def value(cases: Any) -> Any:
        values = compute(cases)
        return np.asarray(values).item() if isinstance(cases, CaseResult) else values

    return property(value, doc=compute.__doc__)


def floats(values: Any) -> FloatArray:
    """A field of a record, a column, or a list (n,) as floats with nan for None."""
    return np.asarray(values, np.float64)


def _among(status: Any, statuses: Sequence[str]) -> Any:
    """Whether the status of a record, or each of a column, is one of `statuses`."""
    return np.isin(status, statuses) if isinstance(status, np.ndarray) else status in statuses


class CaseProperties:
    """Properties of one case (`CaseResult`) and of all rows of a `CaseTable`.

    "It" is the case.
    """

    __slots__ = ()

    @_rule
    def safe(self: Any) -> Any:
        """Whether it lies in the safe zone."""
        return self.zone == "safe"

    @_rule
    def evaluated(self: Any) -> Any:
        """Whether it was evaluated: its status is in `EVALUATED`."""
        return _among(self.status, EVALUATED)

    @_rule
    def gave_up(self: Any) -> Any:
        """Whether its ADS gave up: its status is in `GAVE_UP`."""
        return _among(self.status, GAVE_UP)

    @_rule
    def counted(self: Any) -> Any:
        """Whether it counts in T, A, H and S+."""
        return self.evaluated | self.gave_up

    @_rule
    def missing(self: Any) -> Any:
        """Whether a mean lacks it: it was not evaluated, or its Ug or U0 is not known."""
        # a sum is nan where one of its terms is
        references = floats(self.ideal_severity) + floats(self.no_reaction_severity)
        return np.logical_not(self.evaluated) | np.isnan(references)

    @_rule
    def off_road(self: Any) -> Any:
        """Whether its drive ended because the ego's centre left the road."""
        return self.status == "off_road"

    @_rule
    def departed(self: Any) -> Any:
        """Whether a corner of the ego was more than `road_margin` off the road at some time."""
        return np.isfinite(floats(self.departure_time))

    @_rule
    def incident(self: Any) -> Any:
        """Whether it has an incident: a collision, a departure, or its ADS gave up."""
        return self.collided | self.departed | self.gave_up

    @_rule
    def incident_severity(self: Any) -> Any:
        """U of its worst incident, 0 without an incident; U of giving up is U0.

        nan: it does not count (`counted`), or the ADS gave up and U0 is not known.
        """
        collision = np.where(self.collided, floats(self.severity), 0.0)
        departure = np.nan_to_num(floats(self.departure_severity))
        worst = np.fmax(collision, departure)  # fmax: a nan gives way to a number
        given_up = np.maximum(worst, floats(self.no_reaction_severity))  # maximum: nan stays nan
        worst = np.where(self.gave_up, given_up, worst)
        return np.where(self.counted, worst, np.nan)

    @_rule
    def avoidable(self: Any) -> Any:
        """Whether it is a collision that the ideal vehicle avoids in the same concrete scenario."""
        return self.collided & (self.ideal_severity == 0.0)

    @_rule
    def unavoidable(self: Any) -> Any:
        """Whether it is a collision, and the ideal vehicle collides too."""
        return self.collided & (floats(self.ideal_severity) > 0.0)

    @_rule
    def caused(self: Any) -> Any:
        """Whether it is a collision that the ideal vehicle avoids, and `no_reaction` too."""
        return self.avoidable & (self.no_reaction_severity == 0.0)

    @_rule
    def outcome(self: Any) -> Any:
        """The first of `collision`, `not evaluated` and `off road` that applies, else
        `no contact`.
        """
        flags = [self.collided, np.logical_not(self.evaluated), self.departed | self.off_road]
        return np.select(flags, ("collision", "not evaluated", "off road"), OUTCOMES[0])

    @_rule
    def kind(self: Any) -> Any:
        """The first of `caused`, `avoidable` and `unavoidable` that applies to a collision, else
        `not known`: the ideal vehicle's drive could not be evaluated.
        """
        kinds = "caused", "avoidable", "unavoidable"
        return np.select([getattr(self, name) for name in kinds], kinds, "not known")

    @_rule
    def voids_index(self: Any) -> Any:
        """Whether it is a collision because of which its ADS has no D in the scenario.

        That is one in the safe zone, except where the ideal vehicle is known to collide too.
        """
        return self.safe & self.collided & np.logical_not(self.unavoidable)

    @_rule
    def counts_for_index(self: Any) -> Any:
        """Whether its D_i, if it has one, counts in D: in the safe zone, and no contact."""
        return self.safe & np.logical_not(self.collided | self.struck_from_behind)


@frozen
class CaseResult(CaseProperties):
    """Result of one case: one ADS at one point. None: does not apply, or could not be evaluated.

    Identity
    case: its key, `scenario-point-ads`.
    values: the point, by name of parameter.
    exposure: p_i, how often the point occurs.

    End of the drive
    status: one of `EVALUATED` or `GAVE_UP`, or `sim_error`.
    end_reason, error: see `Recording`.
    error_place: file, line and function of the user's code that raised `error`.
    clips: what was limited and how often, `name x3; ...`.
    batched: "batched" if the ADS asks SUMO and shared a simulation with other cases, "compared" if
        the case alone gave the same, else "".
    requirements_missed: names of the requirements that do not hold; "": all hold; None: the
        scenario has none, or the case was not evaluated.

    wall_time, simulated_time: s.
    latency_mean, latency_max, latency_median, latency_p99: of a step of the ADS, s.
    latency_reference: median of a fixed piece of work, timed between the steps in the same process,
        s.
    latency_relative: latency_median over latency_reference.

    Contact
    collided: whether the ego had a contact, except with `struck_from_behind`.
    struck_from_behind: a vehicle that reacts ran into the ego's rear and is at fault. The
        task_share is 0 all the same: any contact ends the drive.
    impact_speed m/s, overlap 0..1, side: as in `Collision`.
    severity: U of a collision, Eq. 15, m/s, or its replacement.
    loss: L of a collision, Eq. 14.
    contact_cause: see `cause_of_contact`.
    no_return_time: last moment at which full braking avoids the contact, s; None: it never does,
        or the drive cannot be repeated.
    braking_time: when the ADS first braked, s.

    Departure from the road; None: the ego stayed on it
    departure_time, departure_speed: when a corner of the ego was first more than `road_margin` off
        the road, s, and its speed then, m/s.
    departure_severity: U of a contact beside the road at that speed.

    References at the same point
    ideal_severity: Ug, U of the ideal vehicle's contact, 0 without one; None: not evaluated.
    no_reaction_severity: U0, the same for the contact or departure of `no_reaction`.
    ideal_error, no_reaction_error: why that drive could not be evaluated.
    ideal_collided: whether the ideal vehicle had a contact.
    beats_ideal: whether severity is less than ideal_severity.
    weight: r of Eq. 16, of every case.
    task_share: t_i, share of the route driven in time; None without a reference.
    excused: whether t_i leaves out the rest of the route, because the ego stands at a road user.

    Likeness to human drivers, of cases in the safe zone
    index: D_i, Eqs. 11-12, called `d_i` in cases.csv; None with a contact.
    length_factor, operation_factor, similarity: factors of D_i.
    index_note: why D_i is missing, or remarks on it.
    drivers, recorded_drivers: number of drivers that D_i is computed from, and of recorded ones
        among them.
    reference_note: set where these are too few.
    human_low, human_mean, human_high: least, mean and largest D_i of these drivers, each compared
        with all other ones.
    bimodal: whether they form two groups somewhere.
    manoeuvre, manoeuvre_share: of the ADS, and share of drivers who made it (mixture mode).
    exposure_note: whether the point lies outside the support of recorded events.
    likeness_length_factor, operation_tolerance, mixture_similarity, plausibility: factors of H_i:
        f_L among all drivers, f_n+, similarity in mixture mode, and plausibility, which every
        evaluated case has.
    human_likeness: H_i, their product; 0 with an incident that the ideal vehicle avoids.

    Measures, see `sumo_eval.method.measures`; None: not defined, or without a bound
    min_ttc s, max_ittc 1/s, min_thw s, min_gap m, max_drac m/s2, pet s, max_deceleration m/s2,
    max_jerk, max_lateral_jerk m/s3, delta_v m/s.
    largest_offset m, overshoot m, over_line_time s, settling_time s: how the lane was kept.
    conflict_pet: PET where an actor's path conflicts with the ego's, s.
    undisturbed_pet: the same if neither of them reacts, s.
    time_to_conflict: time until the ego reaches the conflict area if neither reacts, s.
    """

    case: str
    scenario: str
    ads: str
    values: Mapping[str, float]
    zone: Zone
    exposure: float
    status: str
    end_reason: str | None
    error: str | None
    wall_time: Measure
    simulated_time: Measure
    latency_mean: Measure
    latency_max: Measure
    collided: bool
    impact_speed: Measure = None
    overlap: Measure = None
    side: str | None = None
    severity: Measure = None
    loss: Measure = None
    ideal_severity: Measure = None
    weight: Measure = None
    beats_ideal: bool = False
    index: Measure = None
    length_factor: Measure = None
    operation_factor: Measure = None
    similarity: Measure = None
    index_note: tuple[IndexNote, ...] = ()
    clips: str = ""
    ideal_collided: bool | None = None
    min_ttc: Measure = None
    max_ittc: Measure = None
    min_thw: Measure = None
    min_gap: Measure = None
    max_drac: Measure = None
    pet: Measure = None
    max_deceleration: Measure = None
    max_jerk: Measure = None
    max_lateral_jerk: Measure = None
    delta_v: Measure = None
    drivers: int | None = None
    recorded_drivers: int | None = None
    reference_note: ThinReference | None = None
    human_low: Measure = None
    human_mean: Measure = None
    human_high: Measure = None
    bimodal: bool = False
    manoeuvre: str = ""
    manoeuvre_share: Measure = None
    exposure_note: Literal["", "outside_support"] = ""
    error_place: str = ""
    no_reaction_severity: Measure = None
    operation_tolerance: Measure = None
    mixture_similarity: Measure = None
    plausibility: Measure = None
    human_likeness: Measure = None
    struck_from_behind: bool = False
    largest_offset: Measure = None
    overshoot: Measure = None
    over_line_time: Measure = None
    settling_time: Measure = None
    requirements_missed: str | None = None
    conflict_pet: Measure = None
    undisturbed_pet: Measure = None
    time_to_conflict: Measure = None
    ideal_error: str = ""
    no_reaction_error: str = ""
    task_share: Measure = None
    departure_time: Measure = None
    departure_speed: Measure = None
    departure_severity: Measure = None
    latency_median: Measure = None
    latency_p99: Measure = None
    latency_reference: Measure = None
    latency_relative: Measure = None
    no_return_time: Measure = None
    braking_time: Measure = None
    contact_cause: str = ""
    batched: str = ""
    likeness_length_factor: Measure = None
    excused: bool = False

    def _repr_html_(self) -> str:
        """The table for a notebook."""
        # by name: `report/` imports this file
        return str(load_object("sumo_eval.report.notebook:case_html", None, "Case")(self))
