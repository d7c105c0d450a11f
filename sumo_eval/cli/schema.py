"""`sumo-eval schema`: what editors need to help with a file."""

from __future__ import annotations

import json

import click


@click.command()
@click.argument("what", type=click.Choice(["scenario", "evaluation"]))
def schema(what: str) -> None:
    """Print the JSON schema of a scenario file or of an evaluation file, for editors that check TOML."""
    from sumo_eval.scenario.schema import evaluation_schema, scenario_schema

    click.echo(json.dumps(scenario_schema() if what == "scenario" else evaluation_schema(), indent=2))
