"""Settings of the execution of cases: processes, time limits, memory."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, Le

from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import About, Checked, PositiveFloat, PositiveInt


@frozen
class RunSettings(Checked):
    """Execution of the cases."""

    workers: Annotated[PositiveInt, Le(1_000), About("processes that simulate cases")] = 2
    case_timeout: Annotated[PositiveFloat, Le(1e6), About("wall time a case may take", "s")] = 60.0
    step_timeout: Annotated[
        PositiveFloat, Le(1e6), About("wall time one controller step may take", "s")
    ] = 1.0
    memory_limit: Annotated[
        float, Ge(512.0), Le(1e8), About("memory that the process of a case may fill", "MB")
    ] = 4096.0
    cases_per_child: Annotated[
        PositiveInt, About("cases after which a child process is replaced by a fresh one")
    ] = 500
    cases_per_pack: Annotated[
        PositiveInt,
        Le(512),
        About(
            "cases simulated together at most where the driver of the ego has a form for many; 1: "
            "each alone"
        ),
    ] = 512
    engine: Annotated[
        Literal["processes", "serial", "dask"],
        About(
            "where cases run: in child processes, in this process without isolation, or on a Dask "
            "cluster"
        ),
    ] = "processes"
    scheduler: Annotated[
        str, About("address of the Dask cluster's scheduler, e.g. tcp://host:8786")
    ] = ""
    keep: Annotated[
        Literal["all", "critical", "none"],
        About(
            "whose trajectories stay once a run is scored: all; those of points with a collision, "
            "a drive that could not be evaluated, another outcome than the nearest point's, or "
            "among an ADS's 100 least human-like; none"
        ),
    ] = "all"
    incomplete: Annotated[
        Literal["shown", "gate"],
        About(
            "what cases that could not be evaluated do: widen C and D visibly (exit 3), or fail "
            "the run (exit 1)"
        ),
    ] = "shown"
    qualification: Annotated[
        str,
        About(
            "qualification.json of this installation, made by `sumo-eval qualify`: the report "
            "carries it"
        ),
    ] = ""
    only: Annotated[
        tuple[str, ...],
        About("cases of ADSs that alone are driven, e.g. cut_in-0042-idm; none: all of them"),
    ] = ()
