"""`sumo-eval replay`: watch a recorded case."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("case")
@click.option("--beside", metavar="NAME", help="Another ADS, or a driver such as driver_03, next to it.")
@click.option("--out", type=click.Path(path_type=Path), help="File of the animation (default: RUN/replay-CASE.html).")
@click.option("--open", "opens", is_flag=True, help="Open the animation in the browser.")
@click.option("--gui", is_flag=True, help="Show the recorded vehicles in sumo-gui instead (extra `gui`).")
def replay(run: Path, case: str, beside: str | None, out: Path | None, opens: bool, gui: bool) -> None:
    """Write an animation of CASE of RUN: one HTML file that plays in any browser, without a server."""
    from sumo_eval.record.run_folder import read_manifest, read_settings
    from sumo_eval.report.replay import recorded, write_replay
    from sumo_eval.scenario.catalogue import find

    settings, source = read_settings(run), Path(read_manifest(run)["source_folder"])
    fact = recorded(run, case)
    logical = next(space for entry in settings.scenario if (space := find(entry.use, source)).name == fact.scenario)
    if gui:
        from sumo_eval.cosim.sumo.gui_replay import replay_in_gui
        from sumo_eval.record.run_folder import FACTS
        from sumo_eval.record.store import open_store

        with open_store(run / FACTS) as store:
            vehicles = store.trajectories(fact.case)
        replay_in_gui(logical.road, vehicles, fact.collision)
        return
    path = write_replay(run, logical, fact, out or run / f"replay-{case}.html", beside=beside)
    click.echo(f"The replay is {path}")
    if opens:
        click.launch(str(path))
