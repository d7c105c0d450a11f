"""Commands that look at a run: `report`, `explain`, `find`, `replay` and `export`."""

from pathlib import Path

import click

from sumo_eval.cli.finish import scored
from sumo_eval.cli.named_values import named_values
from sumo_eval.cli.options import RUN, count_option, flag, path_option, trusting
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import open_in_browser, say, tell
from sumo_eval.text import file_stem


@click.command(epilog="Example: sumo-eval report results/first")
@RUN
@trusting
def report(run: Path) -> None:
    """Rewrite RUN/report.html from the recorded facts."""
    from sumo_eval.report.assessed import write_assessed_report

    evaluation = scored(run)
    with Progress() as progress:
        path = write_assessed_report(evaluation, progress=progress)
    tell(str(path))


@click.command(epilog="Example: sumo-eval explain results/first cut_in-0007-idm")
@RUN
@click.argument("case", required=False)
@trusting
def explain(run: Path, case: str | None) -> None:
    """Print what happened in CASE of RUN, then its arithmetic; without CASE, where the points of S+
    and S went.
    """
    from sumo_eval.evaluation import zone_partitions
    from sumo_eval.report.explain import explain_case, known_case

    # a misspelt case is reported before anything is computed
    fact = None if case is None else known_case(run, case)
    evaluation = scored(run)
    if fact is None:
        # imported only here: it loads libraries that a case does not need
        from sumo_eval.report.terminal import ledger_lines

        lines = ledger_lines(evaluation)
    else:
        lines = explain_case(evaluation, zone_partitions(evaluation), fact)
    say(lines)


@click.command(epilog="Example: sumo-eval find results/first ego_speed=30 gap=25 --ads idm")
@RUN
@click.argument("values", nargs=-1, required=True, metavar="NAME=VALUE...")
@click.option("--ads", help="Cases of this ADS only (default: of all).")
@click.option(
    "--scenario", help="The logical scenario (default: the first that has these parameters)."
)
@count_option("--most", default=5, show_default=True, help="Cases to name for each ADS.")
@trusting
def find(
    run: Path, values: tuple[str, ...], ads: str | None, scenario: str | None, most: int
) -> None:
    """Name the cases of RUN nearest to parameter values, by their distance in the unit box of these
    parameters.
    """
    from sumo_eval.report.terminal import nearest_cases
    from sumo_eval.scoring.nearest import nearest

    cases = nearest(scored(run), named_values(values, "A parameter"), ads, scenario, most)
    say(nearest_cases(cases))


@click.command(
    epilog="Example: sumo-eval replay results/first cut_in-0007-idm --beside driver_03 --open"
)
@RUN
@click.argument("case")
@click.option(
    "--beside", metavar="NAME", help="Another ADS, or a driver such as driver_03, next to it."
)
@path_option("--out", help="File of the animation (default: RUN/replay-CASE.html).")
@flag("--open", "opens", help="Open the animation in the browser.")
@flag("--gui", help="Show the recorded vehicles in sumo-gui instead (extra `gui`).")
@trusting
def replay(
    run: Path, case: str, beside: str | None, out: Path | None, opens: bool, gui: bool
) -> None:
    """Write an animation of CASE of RUN: one HTML file that plays in any browser, without a
    server.
    """
    if gui and (beside or out or opens):
        raise click.UsageError(
            "`--gui` writes no animation: leave out `--beside`, `--out` and `--open`."
        )
    from sumo_eval.record.run_folder import resolved_run
    from sumo_eval.report.replay import recorded, write_replay

    scenarios = resolved_run(run).scenarios
    fact = recorded(run, case)
    logical = scenarios[fact.scenario]
    if gui:
        from sumo_eval.cosim.sumo.gui_replay import replay_in_gui
        from sumo_eval.record.store import open_store

        with open_store(run) as store:
            vehicles = store.trajectories(fact.case)
        replay_in_gui(
            logical.road,
            vehicles,
            fact.collision,
            bodies={actor.name: actor.body for actor in logical.placed(fact.values).actors},
        )
        return
    out = out or run / f"replay-{file_stem(case)}.html"
    path = write_replay(run, logical, fact, out, beside=beside)
    tell(f"The replay is {path}")
    if opens:
        open_in_browser(path.absolute().as_uri())


@click.command(epilog="Example: sumo-eval export results/first --format csv --out tables")
@RUN
@click.argument("case", required=False)
@click.option(
    "--format", "kind", type=click.Choice(("csv", "parquet")), help="Of the tables (default: csv)."
)
@flag("--evidence", help="Claims, arguments and evidence of the run, as JSON and a page.")
@path_option("--out", help="Folder for the files (default: RUN/export).")
@trusting
def export(run: Path, case: str | None, kind: str | None, evidence: bool, out: Path | None) -> None:
    """Write the cases, all drives and all trajectories of RUN as tables, or CASE as files.

    CASE becomes a SUMO configuration, OpenSCENARIO, and an evaluation that drives it again.
    --evidence instead writes what the run claims, for a safety case.
    """
    out = out or run / "export"
    if evidence:
        if case is not None or kind is not None:
            raise click.UsageError(
                "`--evidence` is of a whole run, and has its own kinds of files."
            )
        from sumo_eval.report.evidence import write_evidence

        say(map(str, write_evidence(scored(run), out)))
        return
    if case is None:
        from sumo_eval.record.exchange import export as write
        from sumo_eval.record.exchange import open_run

        say(map(str, write(run, out, kind or "csv")))
        if discarded_bytes := open_run(run).discarded:
            tell(
                f"Not among them: {discarded_bytes / 1e6:z,.2f} MB of trajectories that "
                "`[run] keep` has discarded.",
                err=True,
            )
        return
    if kind is not None:
        raise click.UsageError(
            "`--format` is for the tables of a whole run; a case has its own kinds of files."
        )
    from sumo_eval.report.export_case import export_case

    exported = export_case(run, case, out)
    say(map(str, exported.paths))
    tell(f"Drive it again, in that folder: {exported.line}")
