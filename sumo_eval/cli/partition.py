"""`sumo-eval partition`: the zones of a scenario."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("scenario")
def partition(scenario: str) -> None:
    """Split the space of SCENARIO into safe and hazardous zones and say where the danger is greatest."""
    from sumo_eval.method.zone_partition import partition as split
    from sumo_eval.scenario.catalogue import find
    from sumo_eval.scenario.sampling.samples import sample
    from sumo_eval.scoring.quantities import describe_zones

    logical = find(scenario, Path.cwd())
    zones = split(logical)
    result = describe_zones(logical, zones, sample(logical))
    share = f"{result.hazardous_share:.1%} of {result.sampled} grid points"
    click.echo(f"{logical.name}: {result.zones} hazardous zone(s), {share}")
    for point in result.most_dangerous:
        click.echo("  most dangerous point: " + ", ".join(f"{name}={value:g}" for name, value in point.items()))
    click.echo(f"  on the wrong side of the exact boundary: {result.boundary_error:.2%} of the possible points")
    for note in result.notes:
        click.echo(f"  {note}")
