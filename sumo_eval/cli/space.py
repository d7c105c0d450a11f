"""Commands on spaces: the `scenarios` that ship, the `partition` of one, a `sample` of it."""

import math
from pathlib import Path

import click

from sumo_eval.cli import out_folder
from sumo_eval.cli.options import SEED, count_option, path_option
from sumo_eval.cli.sentences import say, tell
from sumo_eval.text import point_words


@click.command(epilog="Example: sumo-eval scenarios")
def scenarios() -> None:
    """List the logical scenarios that ship, with their parameters."""
    from sumo_eval.scenario.catalogue import SCENARIOS, load

    for scenario in map(load, SCENARIOS):
        tell(f"{scenario.name}\n  {scenario.about}")
        for item in scenario.parameters:
            tell(
                f"  {item.name:<16} {item.low:g}..{item.high:g}{item.unit_suffix}, "
                f"step {item.step:g}: {item.about}"
            )
        for option in scenario.options:
            unit = "" if option.unit == "1" else f" {option.unit}"
            tell(f"  ?{option.name}=...{unit}: {option.about}")


@click.command(epilog="Example: sumo-eval partition front_vehicle_cut_out")
@click.argument("scenario")
def partition(scenario: str) -> None:
    """Split the space of SCENARIO into safe and hazardous zones and say where the danger is
    greatest.
    """
    from sumo_eval.method.zone_partition import partition as split
    from sumo_eval.scenario.catalogue import find
    from sumo_eval.scenario.sampling.samples import sample as draw
    from sumo_eval.scoring.quantities import describe_zones

    logical = find(scenario, Path.cwd())
    result = describe_zones(logical, split(logical), draw(logical))
    tell(
        f"{logical.name}: {result.zones} hazardous zone(s), {result.hazardous_share:z.1%} of "
        f"{result.sampled} grid points"
    )
    say(f"  most dangerous point: {point_words(point)}" for point in result.most_dangerous)
    wrong = f"{result.boundary_error:z.2%} of the possible points"
    if math.isnan(result.boundary_error):
        wrong = "unknown, as no point between those of the grid is possible"
    tell(f"  on the wrong side of the exact boundary: {wrong}")
    say(f"  {note}" for note in result.notes)


@click.command(epilog="Example: sumo-eval sample cut_in --method sobol --count 64 --out points")
@click.argument("scenario")
@path_option("--out",
              help="Folder for points.csv and points.html (default: "
                   "results/SCENARIO-points-TIME).")  # fmt: skip
@click.option(
    "--method",
    help="As in an evaluation file: grid, pairwise, combinations, latin_hypercube, sobol ...",
)
@count_option("--count", help="How many points to draw.")
@count_option("--levels", help="Points on each axis of a grid.")
@count_option("--strength", help="t of t-way combinations.")
@click.option("--file", help="CSV with a column for each parameter.")
@SEED
def sample(
    scenario: str,
    out: Path | None,
    method: str | None,
    count: int | None,
    levels: int | None,
    strength: int | None,
    file: str | None,
    seed: int,
) -> None:
    """Choose points of SCENARIO's space, write them as CSV and draw them.

    SCENARIO is a shipped name, a scenario file (.toml) or module:name. No simulation is run.
    """
    from sumo_eval.record.points import choose_points
    from sumo_eval.report.points_page import write_points
    from sumo_eval.report.words import count as counted
    from sumo_eval.scenario.catalogue import find
    from sumo_eval.scenario.sampling.samples import METHODS
    from sumo_eval.settings import EvaluationSettings, SamplingSettings, ScenarioSettings

    # settings that the method takes
    keys = METHODS[method][1] if method is not None and method in METHODS else ()
    if count is None and "count" in keys:
        raise click.UsageError(
            f"`--method {method}` needs `--count`, the number of points, e.g. --count 64."
        )
    entry = ScenarioSettings(
        scenario, SamplingSettings(method, levels, count=count, strength=strength, file=file)
    )
    settings = EvaluationSettings("sample", (entry,), seed=seed)
    logical = find(scenario, Path.cwd())
    chosen = choose_points(logical, entry, Path.cwd(), settings)
    title = f"{logical.name}: {chosen.method}, {counted(len(chosen.points), 'point')}"
    table, page = write_points(
        logical, chosen, out or out_folder.default(logical.name, "points"), title
    )
    refused = len(chosen.refused)
    total = len(chosen.points) + refused
    tell(f"{title}; constraints refuse {refused} of {total} ({refused / total:z.1%}).")
    if chosen.method == "adaptive" and total != count:
        first = counted(count or 0, "point")  # `or 0` for the type checker alone
        tell(f"  The first round of {first}: in a run, results choose the further ones.")
    say((*(f"  {note}" for note in chosen.notes), str(table), str(page)))
