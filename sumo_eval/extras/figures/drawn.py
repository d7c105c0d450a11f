"""Every figure by its name, drawn from an evaluation or a folder.

`sumo-eval plot` and notebooks call `draw`.

Users: `extras/figures/command.py`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sumo_eval.errors import InputError, check_known
from sumo_eval.evaluation import score
from sumo_eval.extras.figures.chosen import FigureRequest
from sumo_eval.extras.figures.of_scenes import boundary, field, time_history, trajectories, zone_map
from sumo_eval.extras.figures.of_scores import collisions, intervals, points
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.record.run_folder import resolved_run
from sumo_eval.report.explain import known_case
from sumo_eval.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OF_RUNS = {
    drawing.__name__: drawing
    for drawing in (
        zone_map, field, trajectories, time_history, collisions, boundary, intervals, points
    )
}  # fmt: skip
"""Name -> function that draws this figure of a scored run."""

FIGURES = (*OF_RUNS, "trend", "opinion")


def draw(
    evaluation: Evaluation | Path, figure: str, *, scenario: str | None = None,
    ads: str | None = None,
    case: str | None = None, width: str = "page", progress: Progress = quiet,
) -> Figure:  # fmt: skip
    """A figure by its name, of an evaluation or of a folder.

    evaluation: for `trend` the folder of a history of nights, for `opinion` a run's folder, for all
        others a scored run; for `boundary` also a folder that `sumo-eval boundary` wrote.
    scenario, ads, case: names; None: the figure's default.
    width: a key of `style.WIDTHS`.
    progress: receives the progress of scoring a folder.
    Raises InputError for an unknown name, and for an argument that the figure does not take.
    """
    check_known("figure", FIGURES, figure)
    # whether it is of a folder of `sumo-eval boundary`: a run has another figure of that name
    searched = (
        figure == "boundary"
        and isinstance(evaluation, Path)
        and (evaluation / "boundary.json").is_file()
    )
    if figure in OF_RUNS and not searched:
        # both kinds have settings and scenarios
        run: Any = resolved_run(evaluation) if isinstance(evaluation, Path) else evaluation
        # names are checked before a run is scored, which takes longer
        if ads is not None:
            check_known("ADS", [entry.name for entry in run.settings.ads], ads)
        if scenario is not None and case is None:
            check_known("scenario", run.scenarios, scenario)
        if isinstance(evaluation, Path):
            if case is not None:
                known_case(evaluation, case)
            evaluation = score(evaluation, progress=progress, resolved=run)
        return OF_RUNS[figure](FigureRequest(evaluation, scenario, ads, case, width))
    folder = evaluation.folder if isinstance(evaluation, Evaluation) else evaluation
    # of the figures of a folder only `trend` takes a scenario and an ADS, and none takes a case
    for name, value in (("case", case), ("scenario", scenario), ("ads", ads)):
        if value is not None and (name == "case" or figure != "trend"):
            raise InputError(f"Figure `{figure}` of {folder} takes no `{name}`, got {value!r}.")
    from sumo_eval.extras.figures import of_studies

    if figure == "trend":
        return of_studies.trend(folder, scenario=scenario, ads=ads, width=width)
    figure_of = of_studies.edge if searched else of_studies.opinion
    return figure_of(folder, width=width)
