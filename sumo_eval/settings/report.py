"""Settings of what the report and the JUnit file show."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Literal

from annotated_types import Le

from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import About, Checked, FilledText, PositiveInt


@frozen
class ReportSettings(Checked):
    """Content of the report and the JUnit file. Scores do not depend on it."""

    reference: Annotated[
        FilledText,
        About(
            "name or controller of the ADS that decides what was preventable; the ideal vehicle "
            "if none is so called"
        ),
    ] = "careful_driver"
    junit: Annotated[
        Literal["case", "cell"],
        About("a JUnit test for each concrete scenario, or for each cell of the space"),
    ] = "case"
    junit_cells: Annotated[
        PositiveInt, Le(100), About("cells on each axis of the space, for JUnit tests by cell")
    ] = 4
    junit_failures: Annotated[
        Literal["any", "avoidable"],
        About("which collisions are JUnit failures: those that the ideal vehicle avoids, or any"),
    ] = "avoidable"
    axes: Annotated[
        dict[str, tuple[str, str]],
        About(
            "the two parameters that a scenario's maps show, by scenario; others: the two with "
            "most values"
        ),
    ] = field(default_factory=dict)
