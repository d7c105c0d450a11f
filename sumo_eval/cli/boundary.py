"""`sumo-eval boundary`: where one ADS begins to collide."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from sumo_eval.cli.exit_status import DONE, NOT_EVALUATED
from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("scenario")
@click.argument("ads")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for trials, summary and picture.")
@click.option("--fix", multiple=True, metavar="NAME=VALUE", help="Hold a parameter fixed; may be repeated.")
@click.option("--budget", type=click.IntRange(min=16), default=500, show_default=True, help="Most simulations.")
@click.option("--tolerance", type=float, default=0.001, show_default=True,
              help="Stop when a round is expected to move less than this share of the space.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Source of randomness.")
@click.option("--workers", type=click.IntRange(min=1), default=2, show_default=True, help="Processes that simulate.")
def boundary(
    scenario: str, ads: str, out: Path, fix: tuple[str, ...], budget: int, tolerance: float, seed: int, workers: int
) -> None:
    """Find where ADS collides in SCENARIO, with few simulations, whatever the shape of that set.

    SCENARIO is a shipped name, a scenario file (.toml) or module:name; ADS a controller as in an evaluation file.
    """
    from sumo_eval.errors import InputError
    from sumo_eval.record.cases import Setup
    from sumo_eval.scenario.catalogue import find
    from sumo_eval.settings import RunSettings, SimulationSettings
    from sumo_eval.studies.boundary import find_boundary
    from sumo_eval.studies.boundary_page import summary, write_boundary
    from sumo_eval.studies.slices import slice_of

    fixed = {}
    for text in fix:
        name, _, value = text.partition("=")
        try:
            fixed[name.strip()] = float(value)
        except ValueError:
            raise InputError(f"--fix must have the form NAME=VALUE with a number, got {text!r}.") from None
    logical = slice_of(find(scenario, Path.cwd()), fixed)
    setup = Setup(SimulationSettings(), RunSettings(workers=workers), Path.cwd())
    with Progress() as progress:
        found = find_boundary(
            logical, ads, setup, budget=budget, tolerance=tolerance, seed=seed,
            watch=lambda done, total: progress(f"{logical.name}: {ads}", done, total),
        )  # fmt: skip
    told = summary(found)
    click.echo(
        f"{logical.name}: {ads} collides in {told['collision_share_of_space']:.1%} of the space "
        f"({told['collision_share_of_exposure']:.1%} of the exposure), from {told['simulations']} simulations."
    )
    change = found.rounds[-1].expected_change
    if found.stopped == "settled":
        click.echo(f"  The next round is expected to move {change:.2%} of the space: settled.")
    else:
        click.echo(f"  The search ended with its {found.stopped}; a further round may move {change:.2%} of the space.")
    if not found.collided.any() or found.collided.all():
        click.echo("  Every trial ended alike: there is no boundary that these simulations could find.")
    for status, number in found.not_evaluated.items():
        click.echo(f"  {number} simulations could not be evaluated ({status}); the search went on without them.")
    for path in write_boundary(found, out):
        click.echo(str(path))
    sys.exit(NOT_EVALUATED if found.not_evaluated else DONE)
