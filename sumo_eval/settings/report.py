"""Settings of what the report and the JUnit file show.

Users: `record/points.py`, `report/junit.py`, `settings/evaluation.py`.
"""

from typing import Annotated, Literal

from annotated_types import Le

from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import (
    Checked,
    FilledText,
    PositiveInt,
    empty_table,
    setting,
)


@frozen
class ReportSettings(Checked):
    """Content of the report and the JUnit file. Scores do not depend on it."""

    reference: FilledText = setting(
        "careful_driver",
        "name or controller of the ADS that decides what was preventable; the ideal vehicle "
        "if none is so called",
    )
    junit: Literal["case", "cell"] = setting(
        "case", "a JUnit test for each concrete scenario, or for each cell of the space"
    )
    junit_cells: Annotated[PositiveInt, Le(100)] = setting(
        4, "cells on each axis of the space, for JUnit tests by cell"
    )
    junit_failures: Literal["any", "avoidable"] = setting(
        "avoidable",
        "which collisions are JUnit failures: those that the ideal vehicle avoids, or any",
    )
    axes: dict[str, tuple[str, str]] = empty_table(
        "the two parameters that a scenario's maps show, by scenario; others: the two with "
        "most values",
    )
