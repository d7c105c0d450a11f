"""`sumo-eval compare`: two runs side by side, case by case."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED, NOT_EVALUATED
from sumo_eval.cli.progress import Progress


@click.command()
@click.argument("base", type=click.Path(path_type=Path))
@click.argument("new", type=click.Path(path_type=Path))
@click.option("--gate", type=click.Path(path_type=Path), help="Limits on changes and values (docs/compare.md).")
@click.option("--junit", type=click.Path(path_type=Path), help="Write gates and changed cases as JUnit XML.")
@click.option("--pair", "pairs", multiple=True, metavar="BASE=NEW", help="ADSs that belong together; may be repeated.")
@click.option(
    "--accept-differences", is_flag=True, help="Compare although settings or versions differ; they are shown."
)
@click.option("--report", "with_report", is_flag=True, help="Write NEW/report.html anew, with the comparison first.")
def compare(
    base: Path,
    new: Path,
    gate: Path | None,
    junit: Path | None,
    pairs: tuple[str, ...],
    accept_differences: bool,
    with_report: bool,
) -> None:
    """Compare run NEW with run BASE, the same cases side by side, and apply a gate.

    Exit status: 0 the gate holds, 1 it does not, 2 the runs cannot be compared, 3 cases of NEW could not be evaluated.
    """
    from sumo_eval.errors import InputError
    from sumo_eval.evaluation import score
    from sumo_eval.report.assessed import write_assessed_report
    from sumo_eval.report.comparison import compare as compare_runs
    from sumo_eval.report.gate_settings import read_gate
    from sumo_eval.report.gates import failed, judge
    from sumo_eval.report.junit import comparison_suites, write_junit
    from sumo_eval.report.sections import Beside
    from sumo_eval.report.terminal import comparison_lines

    settings = read_gate(gate)
    partners = dict(pair.partition("=")[::2] for pair in pairs)
    if any(not old or not now for old, now in partners.items()):
        raise InputError(f"A pair must have the form BASE=NEW, got {' '.join(pairs)!r}.")
    with Progress() as progress:
        before, after = score(base, progress=progress), score(new, progress=progress)
    comparison = compare_runs(before, after, settings, pairs=partners, accept_differences=accept_differences)
    gates = judge(after, comparison, settings)
    if junit is not None:
        write_junit(comparison_suites(comparison, gates), junit)
    for line in comparison_lines(comparison, gates, after):
        click.echo(line)
    if with_report:
        report = write_assessed_report(after, Beside(comparison, gates))
        click.echo(f"The report is {report}")
    sys.exit(GATE_FAILED if failed(gates) else NOT_EVALUATED if after.not_evaluated else DONE)
