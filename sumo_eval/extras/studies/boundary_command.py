"""`sumo-eval boundary`: where an ADS collides in a space."""

import sys
from functools import partial
from pathlib import Path

import click

from sumo_eval.cli import out_folder
from sumo_eval.cli.exit_status import DONE, NOT_EVALUATED
from sumo_eval.cli.named_values import named_values
from sumo_eval.cli.options import RESUME, SEED, Range, count_option, path_option
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import say


@click.command(
    epilog="Example: sumo-eval boundary cut_in careful_driver --fix ego_speed=25 --budget 64 "
    "--out boundary"
)
@click.argument("scenario")
@click.argument("ads")
@path_option("--out",
              help="Folder for trials, chances, summary and page (default: "
                   "results/SCENARIO-ADS-TIME).")  # fmt: skip
@click.option(
    "--fix", multiple=True, metavar="NAME=VALUE", help="Hold a parameter fixed; may be repeated."
)
@click.option(
    "--budget",
    type=click.IntRange(min=16),
    default=500,
    show_default=True,
    help="Most simulations.",
)
@click.option("--tolerance", type=Range(0.0, 1.0, max_open=True), default=0.001, show_default=True,
              help="Stop once the next round is expected to move a smaller share of the space "
                   "to the other side.")  # fmt: skip
@SEED
@count_option("--workers", default=2, show_default=True, help="Processes that simulate.")
@RESUME
def boundary(
    scenario: str,
    ads: str,
    out: Path | None,
    fix: tuple[str, ...],
    budget: int,
    tolerance: float,
    seed: int,
    workers: int,
    resume: bool,
) -> None:
    """Find regions of any shape in SCENARIO where ADS collides, with few simulations.

    SCENARIO is a shipped name, a scenario file (.toml) or module:name; ADS a controller as in an
    evaluation file.
    """
    from sumo_eval.extras.studies.boundary import find_boundary, slice_of
    from sumo_eval.extras.studies.boundary_page import (
        check_columns,
        sentences,
        summary,
        write_boundary,
    )
    from sumo_eval.extras.studies.trials import trials_in
    from sumo_eval.record.cases import Setup
    from sumo_eval.scenario.catalogue import find
    from sumo_eval.settings import RunSettings, SimulationSettings
    from sumo_eval.text import point_words

    held = named_values(fix, "--fix")
    logical = slice_of(find(scenario, Path.cwd()), held)
    check_columns(logical)
    setup = Setup(SimulationSettings(), RunSettings(workers=workers), Path.cwd())
    out = out or out_folder.default(scenario, ads)
    # `study` names all that decides which points are driven: only the same study can be resumed
    with trials_in(
        out, setup, [ads], study=f"{scenario} {ads} {point_words(held)} seed={seed}", resume=resume
    ) as trials:
        with Progress(at_most=True) as progress:
            result = find_boundary(
                logical, ads, trials, budget=budget, tolerance=tolerance, seed=seed,
                watch=partial(progress, f"{logical.name}: {ads}")
            )  # fmt: skip
        content = summary(result, held)
        say(sentences(content))
        say(map(str, write_boundary(result, content, out)))
    sys.exit(NOT_EVALUATED if result.not_evaluated else DONE)
