"""`sumo-eval bench`: processor time of the package's parts on this machine."""

from pathlib import Path

import click

from sumo_eval.cli.options import flag
from sumo_eval.cli.sentences import tell

# parts of `sumo_eval.extras.bench.costs.benchmark`, repeated: its import is slow
PARTS = ("co-simulation", "field and D", "zones")


@click.command(epilog="Example: sumo-eval bench --small")
@flag("--small", help="A few cases and one round: shows that it works, in seconds.")
@click.option(
    "--only",
    multiple=True,
    type=click.Choice(PARTS),
    help="Measure this part alone; may be repeated.",
)
@click.option(
    "--cases",
    default=500,
    show_default=True,
    type=click.IntRange(2),
    help="Cases of the UN R157 cut-in grid.",
)
@click.option(
    "--json",
    "file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the figures to this file.",
)
def bench(small: bool, only: tuple[str, ...], cases: int, file: Path | None) -> None:
    """Measure bare libsumo, the harness, the field, D and zones in one run, and print costs and
    ratios.

    Processor time of one core. How to read the table: docs/benchmarks.md.
    """
    from sumo_eval.extras.bench.costs import benchmark
    from sumo_eval.report.page import write_json

    results = benchmark(
        cases=8 if small else cases,
        rounds=1 if small else 3,
        parts=only or PARTS,
        progress=lambda part: tell(f"measuring: {part}", err=True),
    )
    if file is not None:
        write_json(
            file, {**results, "rows": [row._asdict() for row in results["rows"]]}, "The figures"
        )
    tell(", ".join(f"{name} {value}" for name, value in results["machine"].items()))
    for row in results["rows"]:
        ratio = "" if row.ratio is None else f"  {row.ratio:z.2f} x {row.ratio_of}"
        tell(f"{row.group:<14} {row.what:<62} {row.value:z10.3g} {row.unit:<8}{ratio}")
