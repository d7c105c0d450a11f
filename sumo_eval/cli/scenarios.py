"""`sumo-eval scenarios`: what ships."""

from __future__ import annotations

import click


@click.command()
def scenarios() -> None:
    """List the logical scenarios that ship, with their parameters."""
    from sumo_eval.scenario.catalogue import SCENARIOS

    for scenario in SCENARIOS.values():
        click.echo(f"{scenario.name}\n  {scenario.about}")
        for item in scenario.parameters:
            click.echo(f"  {item.name:<16} {item.low:g}..{item.high:g} {item.unit}, step {item.step:g}: {item.about}")
        for option in scenario.options:
            click.echo(f"  ?{option.name}=... {option.unit}: {option.about}")
