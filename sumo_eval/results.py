"""Results of an evaluation as records of plain values.

`scoring/` makes them, `report/` and `nightly/` read them; the record of a case is in `cases.py`.

Users: `cli/finish.py`, `evaluation.py`, `nightly/`, `report/`, `scoring/`, `extras/figures/`,
`extras/studies/`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult, Measure
from sumo_eval.errors import check_known
from sumo_eval.frozen import frozen
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.score_notes import Bounds, ScoreNote
from sumo_eval.settings import EvaluationSettings
from sumo_eval.settings.locators import load_object


@frozen
class NotComputed:
    """Reason why an ADS has no D or H in a scenario, i.e. no mean over its safe cases.

    why: `collisions`: it collided in the safe zone (D only). `no_drivers`: the scenario has no
        human drivers. `no_safe_case`: there is no safe case. `nothing_compared`: no safe case was
        compared with drivers. `no_exposure`: those compared have exposure 0.
    collisions: their number, where they are the reason.
    """

    why: Literal["collisions", "no_safe_case", "nothing_compared", "no_exposure", "no_drivers"]
    collisions: int = 0


@frozen
class ScenarioResult:
    """Scores of one ADS in one logical scenario. A score is None where it could not be computed.

    Scores of the paper
    c: C, Eq. 17; None: no case, or no collision, could be evaluated.
    d: D, Eq. 13; None: see d_reason.
    s: S, Eq. 18, points; None: neither C nor D.
    c_points, d_points: the two terms of S.

    Scores that order ADSs
    task_share: T; None without a safe point.
    avoided_share: A, points weighted by r; avoided_share_exposure: A, points weighted by p.
    avoidance_grade: A'.
    human_likeness: H; None: see h_reason.
    s_plus: S+ = T A' (a + b H), points; None without a safe point.
    a_points, h_points: T A' a and T A' b H, the two terms of S+.
    regret: mean U beyond Ug, m/s.
    task_reference: the reference car of T; "": the run holds none, and T compares with drivers
        only.

    Numbers of cases
    cases: number of all; safe_cases, hazardous_cases: those of the zone.
    collisions: avoidable_collisions (the ideal vehicle avoids them) + unavoidable_collisions (it
        collides too) + those whose ideal vehicle could not be evaluated.
    caused_collisions: the avoidable ones that `no_reaction` avoids too.
    safe_collisions: collisions in the safe zone.
    off_road, departures, gave_up, struck_from_behind: see `CaseProperties` and `CaseResult`.
    not_evaluated: cases whose outcome, Ug, U0 or D_i (of a safe case) is missing.
    requirements_missed: cases that miss a requirement; None: the scenario has none.
    collision_probability: share of the exposure of evaluated cases that collides.

    Intervals
    <score>_interval: 95 % interval of a score, from the points, the drivers and collisions that
        the points may have missed (`sumo_eval.scoring.confidence.intervals`). Its ends include the
        score with the missing cases counted as worst and as best. The worst of a missing safe case
        is a collision, which leaves S without D. None: fewer than two cases are counted
        (`CaseProperties.counted`: evaluated, or given up), and none is missing.
    half_widths_by_source: score (`s`, `s_plus`) -> source (`cases`, `drivers`) -> half the width of
        its interval by that source alone.
    """

    ads: str
    scenario: str
    c: Measure
    d: Measure
    d_reason: NotComputed | None
    s: Measure
    c_points: float
    d_points: float
    cases: int
    safe_cases: int
    hazardous_cases: int
    collisions: int
    safe_collisions: int
    avoidable_collisions: int
    collision_probability: float
    off_road: int
    not_evaluated: int
    notes: tuple[ScoreNote, ...]
    c_interval: Bounds | None = None
    d_interval: Bounds | None = None
    s_interval: Bounds | None = None
    avoided_share: Measure = None
    avoided_share_exposure: Measure = None
    regret: Measure = None
    human_likeness: Measure = None
    h_reason: NotComputed | None = None
    s_plus: Measure = None
    a_points: float = 0.0
    h_points: float = 0.0
    avoided_share_interval: Bounds | None = None
    avoided_share_exposure_interval: Bounds | None = None
    regret_interval: Bounds | None = None
    human_likeness_interval: Bounds | None = None
    s_plus_interval: Bounds | None = None
    unavoidable_collisions: int = 0
    struck_from_behind: int = 0
    caused_collisions: int = 0
    half_widths_by_source: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    requirements_missed: int | None = None
    task_share: Measure = None
    avoidance_grade: Measure = None
    departures: int = 0
    gave_up: int = 0
    task_reference: str = ""
    task_share_interval: Bounds | None = None
    avoidance_grade_interval: Bounds | None = None

    @property
    def nobody_compared(self) -> bool:
        """Whether the scenario has no drivers to compare with: then no ADS has D or H in it."""
        return self.h_reason == NotComputed("no_drivers")

    def _repr_html_(self) -> str:
        """The table for a notebook."""
        # by name: `report/` imports this file
        return str(load_object("sumo_eval.report.notebook:score_html", None, "Score")(self))


@frozen
class ZoneResult:
    """Safe and hazardous zones of one logical scenario.

    zones: number of hazardous zones.
    hazardous_share: share of the sampled points in a hazardous zone, each weighted by the number of
        points of an even sample that it stands for.
    most_dangerous: x* of each hazardous zone, by name of parameter.
    boundary_error: share of the possible points that the learnt zones put on the wrong side.
    boundary_error_box: the same over the whole box of parameters, impossible points included.
    sampled, refused: numbers of points that are simulated, and that the scenario refuses.
    """

    scenario: str
    zones: int
    hazardous_share: float
    most_dangerous: tuple[Mapping[str, float], ...]
    boundary_error: float
    boundary_error_box: float
    sampled: int
    refused: int
    notes: tuple[str, ...]


@frozen
class RankedAds:
    """An ADS in the ranking of an evaluation.

    place: from 1; None: not ranked, as it has no S+ in a scenario that counts (`Ranking`).
    s_plus: weighted mean of S+ over the scenarios that count; None like place.
    interval: of s_plus.
    a_points, h_points: means of T A' a and T A' b H, the two terms of S+.
    """

    ads: str
    place: int | None
    s_plus: Measure
    interval: Bounds | None
    a_points: Measure = None
    h_points: Measure = None


@frozen
class RankedPair:
    """Two ADSs of a ranking.

    difference: S+ of `above` minus S+ of `below`, 0 or more.
    interval: of the difference, both ADSs at the same points and drivers; None: one of them has no
        interval.
    told_apart: whether the interval lies above 0.
    """

    above: str
    below: str
    difference: float
    interval: Bounds | None
    told_apart: bool

    @property
    def scored_alike(self) -> bool:
        """Whether both have equal scores in every case that counts: the interval is exactly 0."""
        return self.interval == (0.0, 0.0)


@frozen
class Ranking:
    """ADSs in the order of S+ over all scenarios. An ADS that is not told apart from the first of a
    place shares this place.

    A scenario counts in it if its weight is above 0 and it has a task, i.e. a safe point.

    weights: by scenario, of every scenario.
    level: of the intervals, 0..1.
    pairs: every two ranked ADSs, in the order of `ads`.
    without_people: scenarios of weight above 0 without drivers to compare with: H counts 0 there.
    without_task: scenarios of weight above 0 without a safe point: they have no S+.
    """

    weights: Mapping[str, float]
    level: float
    ads: tuple[RankedAds, ...]
    pairs: tuple[RankedPair, ...]
    without_people: tuple[str, ...] = ()
    without_task: tuple[str, ...] = ()

    @property
    def with_people(self) -> int:
        """Number of scenarios of weight above 0 with drivers to compare with."""
        return sum(weight > 0.0 for weight in self.weights.values()) - len(self.without_people)

    def pair(self, above: str, below: str) -> RankedPair:
        """The pair of these two.

        Raises InputError where there is none.
        """
        pairs = {f"{pair.above} above {pair.below}": pair for pair in self.pairs}
        name = f"{above} above {below}"
        check_known("pair of this ranking", pairs, name)
        return pairs[name]


@frozen
class Evaluation:
    """A scored run.

    cases: of every ADS in every scenario; columns are read from the run's folder on first use.
    exposures: by scenario, as `drivers.recorded.exposure.RunExposure.plain` makes them.
    ranking: None: its ADSs were not ranked.
    scenarios: the logical scenarios by name.
    left_out: as `record.store.Store.left_out` gives it.
    """

    name: str
    folder: Path
    settings: EvaluationSettings
    manifest: Mapping[str, Any]
    zones: tuple[ZoneResult, ...]
    scores: tuple[ScenarioResult, ...]
    cases: CaseTable
    exposures: Mapping[str, Any] = field(default_factory=dict)
    ranking: Ranking | None = None
    scenarios: Mapping[str, LogicalScenario] = field(default_factory=dict)
    left_out: Sequence[tuple[int, float, int]] = ()

    def __post_init__(self) -> None:
        # cases may be given as records or as a part of a table: both become a whole table, which
        # can be divided into parts
        is_part = isinstance(self.cases, CaseTable) and self.cases.rows is not None
        object.__setattr__(self, "cases", CaseTable.of(iter(self.cases) if is_part else self.cases))

    @property
    def source(self) -> Path:
        """Folder where relative paths of its settings start."""
        return Path(str(self.manifest.get("source_folder", ".")))

    @property
    def resolved(self) -> Resolved:
        """Its settings and scenarios."""
        return Resolved(self.settings, self.source, self.scenarios)

    @property
    def checks(self) -> dict[str, dict[str, str]]:
        """Condition of each requirement by its name, by scenario."""
        return {
            name: {it.name: it.text for it in logical.requirements.all}
            for name, logical in self.scenarios.items()
            if logical.requirements is not None
        }

    @property
    def not_evaluated(self) -> int:
        """Number of cases whose outcome, Ug, U0 or D_i is missing, of all scores."""
        return sum(score.not_evaluated for score in self.scores)

    def exposure_known(self, scenario: str | None = None) -> bool:
        """Whether the exposure of one scenario, or (None) of any, was declared or measured.

        False: it is 1 at every point, so a mean is over points, not over encounters on the road.
        """
        names = self.scenario_names if scenario is None else [scenario]
        return any(self.exposures.get(name, {}).get("known", False) for name in names)

    def cases_of(self, ads: str, scenario: str) -> CaseTable:
        """The cases of one ADS in one scenario; an empty table for names that the run lacks."""
        return self.cases.part(scenario, ads)

    def cases_behind(self, score: ScenarioResult) -> CaseTable:
        """The cases that a score is computed from."""
        return self.cases_of(score.ads, score.scenario)

    def cases_in(self, scenario: str) -> CaseTable:
        """The cases of all ADSs in one scenario."""
        return self.cases.part(scenario)

    @property
    def scenario_names(self) -> list[str]:
        """Names of its scenarios, in the order of the scores."""
        return list(dict.fromkeys(score.scenario for score in self.scores))

    @property
    def ads_names(self) -> list[str]:
        """Names of its ADSs, in the order of the scores."""
        return list(dict.fromkeys(score.ads for score in self.scores))

    def scores_in(self, scenario: str) -> list[ScenarioResult]:
        """The results of all ADSs in one scenario."""
        return [score for score in self.scores if score.scenario == scenario]

    def case(self, key: str) -> CaseResult | None:
        """A case by its key; None where there is none."""
        return next(iter(self.cases[np.flatnonzero(self.cases.case == key)]), None)

    def score(self, ads: str, scenario: str) -> ScenarioResult:
        """The result of one ADS in one scenario.

        Raises InputError where there is none.
        """
        check_known("scenario of this evaluation", self.scenario_names, scenario)
        by_ads = {score.ads: score for score in self.scores_in(scenario)}
        check_known(f"ADS of scenario `{scenario}`", by_ads, ads)
        return by_ads[ads]

    def __repr__(self) -> str:
        """The table for a terminal."""
        return str(load_object("sumo_eval.report.notebook:text_table", None, "Table")(self))

    def _repr_html_(self) -> str:
        """The table for a notebook."""
        return str(load_object("sumo_eval.report.notebook:html_table", None, "Table")(self))

    def plot(self) -> Any:
        """Draw S+ of every ADS with its interval: a figure of matplotlib (extra `plots`)."""
        return load_object("sumo_eval.report.notebook:picture", None, "Picture")(self)
