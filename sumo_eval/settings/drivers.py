"""Settings of the drivers that D compares with, synthetic and recorded."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Literal

from annotated_types import Ge, Le

from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import About, Checked, PositiveFloat, Share


@frozen
class PopulationSettings(Checked):
    """How synthetic drivers differ from those drawn of the fitted distributions.

    The defaults are fitted to recorded drivers (docs/explanation/drivers.md).
    """

    overtake_share: Annotated[Share, About("share who overtake a slower lead vehicle")] = 0.771
    headway_scale: Annotated[
        PositiveFloat, About("factor on the desired time headway of all drivers (IDM)", symbol="T")
    ] = 1.0
    reaction_scale: Annotated[
        PositiveFloat, About("factor on the reaction time of all drivers")
    ] = 1.0
    lane_change_scale: Annotated[
        PositiveFloat, About("factor on the duration of all lane changes")
    ] = 1.1
    onset: Annotated[
        Literal["recorded", "limits"],
        About(
            "headway and TTC that drivers pass at: `recorded`, as measured, or `limits`, fitted so "
            "that their drives begin to pass where recorded ones do"
        ),
    ] = "recorded"


@frozen
class DriverSettings(Checked):
    """The skilled human drivers that D compares with."""

    count: Annotated[
        int, Ge(2), Le(10_000), About("number of drivers in each concrete scenario")
    ] = 10
    population: PopulationSettings = field(default_factory=PopulationSettings)
    source: Annotated[
        str,
        About(
            "`synthetic`, `recorded`, or package.module:function from concrete scenario to "
            "trajectories"
        ),
    ] = "synthetic"
    recordings: Annotated[
        tuple[str, ...],
        About("canonical tables of recorded driving, as `sumo-eval humans import` writes them"),
    ] = ()
    cases: Annotated[
        str, About("folder of drives recorded in named cases, with its cases.csv; empty: none")
    ] = ""
    tolerance: Annotated[
        dict[str, PositiveFloat] | None,
        About(
            "how far an event's parameter may be from the concrete scenario's, by parameter; a "
            "parameter without an entry keeps the tolerance of its scenario"
        ),
    ] = None
    least: Annotated[int, Ge(2), About("recorded drivers below which a reference is too thin")] = 10
    too_thin: Annotated[
        Literal["fill", "leave_out"],
        About(
            "a reference that is too thin is filled from the synthetic population, or its case "
            "gets no D_i"
        ),
    ] = "fill"
    coverage: Annotated[
        PositiveFloat,
        Le(1.0),
        About("share of the road that a recorded drive must cover to be compared with"),
    ] = 0.8
