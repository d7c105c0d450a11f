"""Settings of the drivers that D compares with, synthetic and recorded.

Users: `cli/tools.py`, `drivers/`, `record/`, `report/people.py`, `scoring/`,
`settings/evaluation.py`, `extras/rates/people_command.py`.
"""

from typing import Annotated, Literal

from annotated_types import Ge, Le

from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import Checked, PositiveFloat, Share, optional, setting


@frozen
class PopulationSettings(Checked):
    """Changes to the synthetic drivers, which are drawn from distributions.

    The distributions and these defaults are fitted to recorded drivers
    (docs/explanation/drivers.md).
    """

    overtake_share: Share = setting(0.771, "share who overtake a slower lead vehicle")
    headway_scale: PositiveFloat = setting(
        1.0, "factor on the desired time headway of all drivers (IDM)", symbol="T"
    )
    reaction_scale: PositiveFloat = setting(1.0, "factor on the reaction time of all drivers")
    lane_change_scale: PositiveFloat = setting(1.1, "factor on the duration of all lane changes")
    onset: Literal["recorded", "limits"] = setting(
        "recorded",
        "headway and TTC at which drivers begin to pass: `recorded`, as measured, or `limits`, "
        "fitted so that synthetic drivers do so where recorded ones do",
    )


@frozen
class DriverSettings(Checked):
    """The skilled human drivers that D compares with."""

    count: Annotated[int, Ge(2), Le(10_000)] = setting(
        10, "number of synthetic drivers at each safe point of a scenario that they can drive"
    )
    population: PopulationSettings = PopulationSettings()
    source: str = setting(
        "synthetic",
        "`synthetic`, `recorded`, or package.module:function from concrete scenario to "
        "trajectories",
    )
    recordings: tuple[str, ...] = setting(
        (), "canonical tables of recorded driving, as `sumo-eval humans import` writes them"
    )
    cases: str = setting(
        "", "folder of drives recorded in named cases, with its cases.csv; empty: none"
    )
    tolerance: dict[str, PositiveFloat] | None = optional(
        "how far an event's parameter may be from the concrete scenario's, by parameter; a "
        "parameter without an entry keeps the tolerance of its scenario",
    )
    least: Annotated[int, Ge(2)] = setting(
        10, "recorded drivers below which a reference is too thin"
    )
    too_thin: Literal["fill", "leave_out"] = setting(
        "fill",
        "a reference that is too thin is filled from the synthetic population where that can "
        "drive the scenario, or its case gets no D_i",
    )
    coverage: Annotated[PositiveFloat, Le(1.0)] = setting(
        0.8,
        "share of the road that a recorded drive must cover to be compared with, unless it ends "
        "at standstill or was recorded in a named case",
    )
