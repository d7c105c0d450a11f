"""Settings of the execution of cases: processes, time limits, memory.

Users: `cli/tools.py`, `cosim/`, `record/`, `settings/evaluation.py`,
`extras/rates/campaign.py`, `extras/studies/`.
"""

from typing import Annotated, Literal

from annotated_types import Ge, Le

from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import Checked, PositiveFloat, PositiveInt, setting


@frozen
class RunSettings(Checked):
    """Execution of the cases."""

    workers: Annotated[PositiveInt, Le(1_000)] = setting(2, "processes that simulate cases")
    case_timeout: Annotated[PositiveFloat, Le(1e6)] = setting(
        60.0, "wall time a case may take", "s"
    )
    step_timeout: Annotated[PositiveFloat, Le(1e6)] = setting(
        1.0, "wall time one controller step may take", "s"
    )
    memory_limit: Annotated[float, Ge(512.0), Le(1e8)] = setting(
        4096.0, "memory that the process of a case may fill", "MB"
    )
    cases_per_child: PositiveInt = setting(
        500,
        "cases after which a child process is replaced by a fresh one; no batch in it, and no "
        "fixed batch, has more",
    )
    cases_per_pack: Annotated[PositiveInt, Le(512)] = setting(
        512,
        "most cases in one simulation, if the ego's controller can serve several; in a child "
        "process at most `cases_per_child`, of a TraCI hook at most 128; 1: each alone",
    )
    engine: Literal["processes", "serial", "dask"] = setting(
        "processes",
        "where cases run: in child processes, in this process without isolation, or on a Dask "
        "cluster",
    )
    scheduler: str = setting("", "address of the Dask cluster's scheduler, e.g. tcp://host:8786")
    keep: Literal["all", "critical", "none"] = setting(
        "all",
        "trajectories that stay once a run is scored; critical: at points where an ADS collides, "
        "leaves the road or cannot be evaluated, where it collides at the nearest other point, or "
        "where its case is among its 100 least human-like of the scenario",
    )
    incomplete: Literal["shown", "gate"] = setting(
        "shown",
        "effect of cases that could not be evaluated; shown: C, D and S become intervals "
        "(exit 3); gate: the run fails (exit 1)",
    )
    qualification: str = setting(
        "",
        "qualification.json of this installation, made by `sumo-eval qualify`: the report "
        "carries it",
    )
    only: tuple[str, ...] = setting(
        (), "the only cases of ADSs to drive, e.g. cut_in-0042-idm; empty: all of them"
    )
