"""Scenario, ADSs and drives that a figure of a run shows: as the user asks, or by default.

Users: `extras/figures/drawn.py`, `extras/figures/of_scenes.py`, `extras/figures/of_scores.py`.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.frozen import frozen
from sumo_eval.record.store import EGO, open_store
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scenario.road.reference_line import Piece
from sumo_eval.text import point_words
from sumo_eval.trajectory import Trajectories, Trajectory


@frozen
class DrivenPoint:
    """Drives through one concrete scenario of a run: those of the figure's ADSs and of all human
    drivers.

    scenario: name of the logical scenario.
    words: parameters of the point and their values.
    cases: ADS -> its case there.
    runs: ADS -> trajectory of its ego.
    others: actor -> its trajectory in the drive of the first ADS.
    people: human driver -> trajectory of their ego; empty in the hazardous zone.
    line: reference line of the road, as in `Road`.
    """

    scenario: str
    words: str
    cases: Mapping[str, str]
    runs: Trajectories
    others: Trajectories
    people: Trajectories
    line: tuple[Piece, ...]

    @property
    def title(self) -> str:
        """Words above a figure of the drives."""
        return f"{self.scenario}: {self.words}"


class FigureRequest(NamedTuple):
    """A user's request for a figure of a scored run.

    scenario, ads, case: names; None: the user gives none.
    width: a key of `style.WIDTHS`.

    The properties are what the figure shows: the request, completed by defaults. They raise
    InputError for an unknown case, and for a scenario that is not the case's.
    """

    evaluation: Evaluation
    scenario: str | None
    ads: str | None
    case: str | None
    width: str

    @property
    def names(self) -> list[str]:
        """Names of the ADSs: that of the request, else all."""
        all_names = [entry.name for entry in self.evaluation.settings.ads]
        return all_names if self.ads is None else [self.ads]

    @property
    def chosen_scenario(self) -> str | None:
        """Name of the scenario: that of the request's case, else that of the request; None: all."""
        return self.scenario if self.case is None else self.row.scenario

    @property
    def one_scenario(self) -> str:
        """Scenario of a figure that shows one: `chosen_scenario`, else the run's first."""
        return self.chosen_scenario or self.evaluation.scenario_names[0]

    @property
    def scores(self) -> list[ScenarioResult]:
        """The scores of `names` in `chosen_scenario`."""
        names, scenario = self.names, self.chosen_scenario
        return [
            score
            for score in self.evaluation.scores
            if score.ads in names and scenario in (None, score.scenario)
        ]

    @property
    def row(self) -> CaseResult:
        """The case of the request, else the case with the least D_i (`index`) in `one_scenario`.

        Where no case has a D_i, it is the first by name.
        """
        if self.case is None:
            return min(
                self.evaluated, key=lambda row: (row.index is None, row.index or 0.0, row.case)
            )
        row = self.evaluation.case(self.case)
        if row is None:
            raise unknown("case", self.case, self.evaluation.cases.case)
        if self.scenario not in (None, row.scenario):
            raise must_be("The scenario", f"case `{row.case}`", row.scenario, self.scenario)
        return row

    @property
    def evaluated(self) -> CaseTable:
        """The cases of `one_scenario` that were evaluated, of all ADSs; at least one."""
        name = self.one_scenario
        cases = self.evaluation.cases_in(name)
        evaluated: CaseTable = cases[cases.evaluated]
        if not len(evaluated):
            raise InputError(
                f"No case of scenario `{name}` was evaluated, so there is nothing to draw."
            )
        return evaluated


def driven_point(request: FigureRequest, ads: Sequence[str]) -> DrivenPoint:
    """The drives of these ADSs and of all human drivers at the point of the case `request.row`.

    ads: names; ADSs without a drive there are left out.
    Raises InputError where no trajectory of these ADSs is kept.
    """
    evaluation, case = request.evaluation, request.row
    with open_store(evaluation.folder) as store:
        drives = list(store.names("ads", case.scenario))  # (case, number of its point, ADS)
        point = next(number for key, number, _ in drives if key == case.case)
        case_of = {name: key for key, number, name in drives if number == point}
        runs = {}
        others: dict[str, Trajectory] = {}
        for name in ads:
            vehicles = store.trajectories(case_of[name]) if name in case_of else {}
            if EGO in vehicles:
                runs[name] = vehicles.pop(EGO)
                others = others or vehicles  # those of the first ADS
        people = {}
        for key, number, driver in store.names("human", case.scenario):
            vehicles = store.trajectories(key) if number == point else {}
            if EGO in vehicles:
                people[driver] = vehicles[EGO]
    if not runs:
        cases = ", ".join(case_of.get(name, name) for name in ads)
        raise InputError(f"No trajectory is kept of {cases}, so there is nothing to draw.")
    return DrivenPoint(
        case.scenario,
        point_words(case.values),
        case_of,
        runs,
        others,
        people,
        evaluation.scenarios[case.scenario].placed(case.values).road.line,
    )
