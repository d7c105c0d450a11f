"""`sumo-eval sample`: choose points of a space, write and draw them."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("scenario")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for points.csv and points.html.")
@click.option("--method", help="As in an evaluation file: grid, pairwise, combinations, latin_hypercube, sobol ...")
@click.option("--count", type=int, help="How many points to draw.")
@click.option("--levels", type=int, help="Points on each axis of a grid.")
@click.option("--strength", type=int, help="t of t-way combinations.")
@click.option("--file", help="CSV with a column for each parameter.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Source of randomness.")
def sample(
    scenario: str,
    out: Path,
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
    from sumo_eval.settings import AdsSettings, EvaluationSettings, SamplingSettings, ScenarioSettings

    entry = ScenarioSettings(scenario, SamplingSettings(method, levels, count=count, strength=strength, file=file))
    settings = EvaluationSettings("sample", (entry,), (AdsSettings("none", "no_reaction"),), seed)
    logical, chosen = choose_points(entry, Path.cwd(), settings)
    how = method or ("grid" if levels else "file" if file else logical.default_sample)
    title = f"{logical.name}: {how}, {len(chosen.points)} points"
    table, page = write_points(logical, chosen, out, title)
    total = len(chosen.points) + len(chosen.refused)
    share = len(chosen.refused) / total
    click.echo(f"{title}; constraints refuse {len(chosen.refused)} of {total} ({share:.1%}).")
    for note in chosen.notes:
        click.echo(f"  {note}")
    click.echo(str(table))
    click.echo(str(page))
