"""The command line. Every command imports what it needs when it runs, so that `--help` answers at once."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from sumo_eval.errors import SumoEvalError, did_you_mean

if TYPE_CHECKING:
    from sumo_eval.results import Evaluation

DONE, INPUT_WRONG, NOT_EVALUATED, INTERRUPTED = 0, 2, 3, 130


class _Group(click.Group):
    """Offers the nearest command for a misspelt one and turns the package's errors into sentences."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            raise click.UsageError(f"There is no command `{args[0]}`.{did_you_mean(args[0], self.list_commands(ctx))}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except SumoEvalError as error:
            _refuse(str(error))
        except KeyboardInterrupt:
            click.echo("Stopped by Ctrl-C.", err=True)
            sys.exit(INTERRUPTED)


def _refuse(sentence: str) -> NoReturn:
    click.echo(f"sumo-eval: {sentence}", err=True)
    sys.exit(INPUT_WRONG)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="sumo_eval", message="%(version)s")
def main() -> None:
    """Score automated driving systems over the whole parameter space of logical scenarios, in simulation with SUMO.

    Exit status: 0 done, 1 a gate failed, 2 the input is wrong, 3 some cases could not be evaluated.
    """


@main.command()
@click.argument("evaluation", required=False, type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="New folder for facts, scores and report.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes that simulate cases (default: as in the file).")
def run(evaluation: Path | None, out: Path, workers: int | None) -> None:
    """Simulate and score EVALUATION, a TOML file; without one, the paper's evaluation."""
    from sumo_eval.evaluation import evaluate

    with _progress() as progress:
        result = evaluate(evaluation, out, workers=workers, progress=progress)
    _finish(result)


@main.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="e.g. method.score.a=60; may be repeated.")
def score(run: Path, changes: tuple[str, ...]) -> None:
    """Score RUN again from its recorded facts, without a simulation."""
    from sumo_eval.evaluation import score as score_run

    with _progress() as progress:
        result = score_run(run, changes, progress=progress)
    _finish(result)


@main.command()
@click.argument("run", type=click.Path(path_type=Path))
def report(run: Path) -> None:
    """Write RUN/report.html anew from the recorded facts."""
    from sumo_eval.evaluation import score as score_run
    from sumo_eval.evaluation import zone_partitions
    from sumo_eval.report.html import write_report

    with _progress() as progress:
        evaluation = score_run(run, progress=progress)
    click.echo(str(write_report(evaluation, zone_partitions(evaluation))))


@main.command()
def scenarios() -> None:
    """List the logical scenarios that ship, with their parameters."""
    from sumo_eval.scenario.catalogue import SCENARIOS

    for scenario in SCENARIOS.values():
        click.echo(f"{scenario.name}\n  {scenario.about}")
        for item in scenario.parameters:
            click.echo(f"  {item.name:<16} {item.low:g}..{item.high:g} {item.unit}, step {item.step:g}: {item.about}")


@main.command()
@click.argument("scenario")
def partition(scenario: str) -> None:
    """Split the space of SCENARIO into safe and hazardous zones and say where the danger is greatest."""
    from sumo_eval.method.zone_partition import partition as split
    from sumo_eval.scenario.catalogue import find
    from sumo_eval.scenario.sampling import sample
    from sumo_eval.scoring import describe_zones

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


def _finish(evaluation: Evaluation) -> None:
    """Write what a person and a machine read, print the table, and leave with the status that the cases deserve."""
    import json

    from sumo_eval.evaluation import zone_partitions
    from sumo_eval.report.html import write_report
    from sumo_eval.report.tables import cases_csv, scores_json
    from sumo_eval.report.terminal import closing_lines, plain_table, score_table

    scores = json.dumps(scores_json(evaluation), indent=2, allow_nan=False)
    (evaluation.folder / "scores.json").write_text(scores + "\n", encoding="utf-8")
    cases_csv(evaluation, evaluation.folder / "cases.csv")
    write_report(evaluation, zone_partitions(evaluation))
    if sys.stdout.isatty():
        from rich.console import Console

        Console().print(score_table(evaluation))
    else:
        click.echo(plain_table(evaluation))
    for line in closing_lines(evaluation):
        click.echo(line)
    sys.exit(NOT_EVALUATED if evaluation.not_evaluated else DONE)


class _progress:  # noqa: N801
    """A progress bar on a terminal, one line a stage elsewhere."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._tasks: dict[str, Any] = {}
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            self._bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
                console=Console(stderr=True),
            )

    def __enter__(self) -> Callable[[str, int, int], None]:
        if self._bar is not None:
            self._bar.start()
        return self._show

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _show(self, stage: str, done: int, total: int) -> None:
        if self._bar is None:
            if done == total:
                click.echo(f"{stage}: {total} done", err=True)
            return
        if stage not in self._tasks:
            self._tasks[stage] = self._bar.add_task(stage, total=total)
        self._bar.update(self._tasks[stage], completed=done)
