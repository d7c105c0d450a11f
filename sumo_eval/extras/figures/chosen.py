"""Scenario, ADS and concrete scenario of a run that a figure shows: those requested, or telling
ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sumo_eval.cases import CaseResult
from sumo_eval.errors import InputError, unknown
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import open_store
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scenario.road.reference_line import Piece
from sumo_eval.text import point_words
from sumo_eval.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class DrivenPoint:
    """One concrete scenario of a run as it was driven.

    runs: the ego of every ADS, others: the other vehicles in the drive of the first, people: the
        egos of the human drivers by name, none in the hazardous zone.
    words: where it lies in the space.
    line: of the road, as in `Road`.
    """

    scenario: str
    words: str
    runs: Mapping[str, Trajectory]
    others: Mapping[str, Trajectory]
    people: Mapping[str, Trajectory]
    line: tuple[Piece, ...]

    @property
    def title(self) -> str:
        """Words above a figure of the drives."""
        return f"{self.scenario.replace('_', ' ')}: {self.words}"


@dataclass(frozen=True, slots=True)
class Asked:
    """Request for a figure of a scored run; None: telling ones.

    width: its name, as in `style.WIDTHS`.

    Its properties raise InputError for an unknown scenario, ADS or case.
    """

    evaluation: Evaluation
    scenario: str | None
    ads: str | None
    case: str | None
    width: str

    @property
    def names(self) -> list[str]:
        """The ADS asked for, else all."""
        names = [entry.name for entry in self.evaluation.settings.ads]
        if self.ads is not None and self.ads not in names:
            raise unknown("ADS", self.ads, names)
        return names if self.ads is None else [self.ads]

    @property
    def place(self) -> str | None:
        """The scenario asked for, or that of the case asked for; None: any."""
        if self.case is not None:
            return self.row.scenario
        names = [zone.scenario for zone in self.evaluation.zones]
        if self.scenario is not None and self.scenario not in names:
            raise unknown("scenario", self.scenario, names)
        return self.scenario

    @property
    def one_place(self) -> str:
        """The scenario asked for, else the first."""
        return self.place or self.evaluation.zones[0].scenario

    @property
    def scores(self) -> list[ScenarioResult]:
        """The scores of the ADSs and scenarios asked for."""
        names, place = self.names, self.place
        return [
            one
            for one in self.evaluation.scores
            if one.ads in names and place in (None, one.scenario)
        ]

    @property
    def row(self) -> CaseResult:
        """The case asked for, else a telling one: the least human-like of the scenario's that have
        an index D_i.
        """
        if self.case is not None:
            found = self.evaluation.case(self.case)
            if found is None:
                raise unknown("case", self.case, self.evaluation.cases.case)
            return found
        rows = self.evaluated
        judged = [row for row in rows if row.index is not None]
        return min(
            judged or rows, key=lambda row: (row.index if row.index is not None else 0.0, row.case)
        )

    @property
    def evaluated(self) -> list[CaseResult]:
        """The cases of the scenario that were evaluated, at least one."""
        name = self.one_place
        rows = [row for row in self.evaluation.cases_in(name) if row.evaluated]
        if not rows:
            raise InputError(
                f"No case of scenario `{name}` was evaluated, so there is nothing to draw."
            )
        return rows


def driven_point(asked: Asked, ads: Sequence[str]) -> DrivenPoint:
    """All drives through the concrete scenario of a case."""
    evaluation, case = asked.evaluation, asked.row
    with open_store(evaluation.folder / FACTS) as store:
        named = {name: (point, who) for name, point, who in store.names("ads", case.scenario)}
        point = named[case.case][0]
        driven = {who: name for name, (at, who) in named.items() if at == point and who in ads}
        runs: dict[str, Trajectory] = {}
        others: dict[str, Trajectory] = {}
        for who in ads:
            drive = store.trajectories(driven[who]) if who in driven else {}
            if "ego" in drive:
                runs[who] = drive.pop("ego")
                others = others or drive
        people = {
            who: drive["ego"]
            for name, at, who in store.names("human", case.scenario)
            if at == point and "ego" in (drive := store.trajectories(name))
        }
    if not runs:
        raise InputError(f"Case `{case.case}` has no trajectory to draw.")
    logical = evaluation.scenarios[case.scenario]
    return DrivenPoint(
        case.scenario,
        point_words(case.values),
        runs,
        others,
        people,
        logical.placed(case.values).road.line,
    )
