"""Distance of ADSs from the recorded ego: the page of `sumo-eval humans departure`.

It has a line for every drive with trajectories in a recorded scene
(`extras/rates/recorded_scene.py`).

Users: `extras/rates/people_command.py`.
"""

from itertools import cycle
from pathlib import Path
from typing import NamedTuple

from sumo_eval.errors import InputError, check_known
from sumo_eval.extras.panels import COLOURED_LINES, Marks, Panel, on_page
from sumo_eval.record.run_folder import read_exposures, resolved_run
from sumo_eval.record.scenario_files import refuse_edited
from sumo_eval.record.store import EGO, open_store
from sumo_eval.report.study_page import Table, write_study
from sumo_eval.scenario.concrete import departures
from sumo_eval.text import point_words
from sumo_eval.trajectory import FloatArray

PAGE = "departure.html"
# columns of the table; its rows are `SceneDrive.cells`
HEAD = (
    "ADS", "scene", "point", "most, m", "at, s", "at the end, m", "others react from, s",
    "how many", "end",
)  # fmt: skip


class SceneDrive(NamedTuple):
    """A drive in a recorded scene.

    point: its parameters and their values.
    time: s, (n,).
    apart: distance from the recorded ego at these times, m, (n,).
    reacted: when the first actor began to react to the ADS, s, and how many did; None: none did.
    end: why the drive ended.
    """

    ads: str
    scenario: str
    point: str
    time: FloatArray
    apart: FloatArray
    reacted: tuple[float, int] | None
    end: str

    def cells(self) -> tuple[str, ...]:
        """The drive's row of the table under `HEAD`."""
        peak = self.apart.argmax()
        reacted = (
            ("", "") if self.reacted is None else (f"{self.reacted[0]:.2f}", f"{self.reacted[1]}")
        )
        return (
            self.ads, self.scenario, self.point, f"{self.apart[peak]:.2f}",
            f"{self.time[peak]:.1f}", f"{self.apart[-1]:.2f}", *reacted, self.end,
        )  # fmt: skip

    def sentence(self) -> str:
        """The drive in words."""
        reacts = (
            "no actor reacts"
            if self.reacted is None
            else f"{self.reacted[1]} react, from {self.reacted[0]:.1f} s on"
        )
        peak = self.apart.argmax()
        return (
            f"{self.ads} in {self.scenario} ({self.point}): up to {self.apart[peak]:.1f} m, at "
            f"{self.time[peak]:.1f} s; {self.apart[-1]:.1f} m at the end ({self.end}); {reacts}."
        )


def departures_in(run: Path) -> tuple[list[SceneDrive], int]:
    """Drives of ADSs in recorded scenes, and the number of those left out, without trajectories.

    Raises InputError where there is none, and where the file of a scene has changed since.
    """
    resolved = resolved_run(run)
    drives = []
    left_out = 0
    with open_store(run) as store:
        for fact in store.facts("ads"):
            # a run whose evaluation was edited may lack the scenario
            check_known("scenario of the run", resolved.scenarios, fact.scenario)
            # places of the recorded ego; empty where the scenario is not a recorded scene
            recorded = resolved.scenarios[fact.scenario].concrete(**fact.values).ego.recorded
            drive = store.trajectories(fact.case).get(EGO) if recorded else None
            if drive is None:
                left_out += bool(recorded)  # its trajectories were discarded, or it never began
                continue
            # an actor that begins to react is handed over to SUMO, which is counted among the clips
            reactions = ((it.first_time, it.count) for it in fact.clips if it.what == "handed_over")
            drives.append(
                SceneDrive(
                    fact.driver, fact.scenario, point_words(fact.values), drive.time,
                    departures(recorded, drive.time, drive.x, drive.y),
                    next(reactions, None), fact.end_reason or fact.status,
                )
            )  # fmt: skip
    # The distances above are from today's files. These must be those that were driven, by the
    # hashes that the run keeps beside its exposures.
    refuse_edited(resolved, read_exposures(run), {it.scenario for it in drives})
    if not drives:
        raise InputError(
            f"{run} must hold trajectories in a recorded scene ([ego] `recorded` of its file), got "
            "none."
        )
    return drives, left_out


def write_departures(run: Path, path: Path) -> list[str]:
    """Write the page of a run folder to a path, and return its drives in words."""
    drives, left_out = departures_in(run)
    note = f"Drives left out, without trajectories: {left_out}."
    panel = Panel(
        [
            Marks(f"{it.ads}, {it.scenario}, {it.point}", it.time, it.apart, *look)
            for it, look in zip(drives, cycle(COLOURED_LINES))
        ],
        "time, s",
        "distance from the recorded vehicle, m",
        verticals=[it.reacted[0] for it in drives if it.reacted is not None],
    )
    title = "Departure from the recorded vehicle"
    sentences = (
        "Distance of each ADS, at each time, from the vehicle that was recorded in its place; once "
        "the recording has ended, from where that vehicle was last.",
        "Dotted: from then on actors react. Before, and without reactions, they drive as recorded.",
        note,
    )
    write_study(
        path, kicker=run.name, title=title, sentences=sentences,
        figures={title: on_page([panel], 1, 520)},
        data=Table(HEAD, [*map(SceneDrive.cells, drives)]),
    )  # fmt: skip
    return [*map(SceneDrive.sentence, drives), note]
