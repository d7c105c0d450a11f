"""How far ADSs departed from the vehicle that was recorded in their place: a page with a line for
every drive.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

from sumo_eval.errors import InputError
from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.record.run_folder import FACTS, resolved_run
from sumo_eval.record.store import EGO, open_store
from sumo_eval.report.study_page import write_study
from sumo_eval.report.words import point
from sumo_eval.scenario.concrete import departures
from sumo_eval.trajectory import FloatArray

PAGE = "departure.html"


@dataclass(frozen=True, slots=True, eq=False)
class Departure:
    """A drive in a recorded scene. time, s, and apart, m: (n,).

    reacted: when others began to react to it and how many did; None: nobody did.
    """

    ads: str
    scenario: str
    point: str
    time: FloatArray
    apart: FloatArray
    reacted: tuple[float, int] | None
    end: str

    @property
    def most(self) -> int:
        """Number of the sample that is furthest apart."""
        return int(self.apart.argmax())

    def sentence(self) -> str:
        """What to know of it."""
        reacts = (
            "nobody reacts"
            if self.reacted is None
            else f"{self.reacted[1]} react, from {self.reacted[0]:.1f} s on"
        )
        return (
            f"{self.ads} in {self.scenario} ({self.point}): "
            f"up to {self.apart[self.most]:.1f} m, at {self.time[self.most]:.1f} s; "
            f"{self.apart[-1]:.1f} m at the end ({self.end}); {reacts}"
        )


def departures_in(run: Path) -> list[Departure]:
    """Every drive of an ADS in a recorded scene.

    Raises InputError where there is none.
    """
    spaces = resolved_run(run).scenarios
    found = []
    with open_store(run / FACTS) as store:
        for fact in store.facts("ads"):
            places = spaces[fact.scenario].concrete(**fact.values).ego.recorded
            drive = store.trajectories(fact.case).get(EGO) if places else None
            if drive is None:
                continue
            over = next((clip for clip in fact.clips if clip.what == "handed_over"), None)
            found.append(
                Departure(
                    fact.driver,
                    fact.scenario,
                    point(fact.values),
                    drive.time,
                    departures(places, drive.time, drive.x, drive.y),
                    None if over is None else (over.first_time, over.count),
                    fact.end_reason or fact.status,
                )
            )
    if not found:
        raise InputError(
            f"{run} must hold a drive in a recorded scene ([ego] `recorded` of its file), got none."
        )
    return found


def write_departures(run: Path, path: Path) -> list[Departure]:
    """Write the page."""
    found = departures_in(run)
    marks = [Marks(f"{one.ads}, {one.scenario}, {one.point}", one.time, one.apart, colour, "-")
             for one, colour in zip(found, cycle(COLOURS))]  # fmt: skip
    reacted = [one.reacted[0] for one in found if one.reacted is not None]
    panel = Panel(marks, "time, s", "distance from the recorded vehicle, m", verticals=reacted)
    rows = [
        (
            "ADS",
            "scene",
            "point",
            "most, m",
            "at, s",
            "at the end, m",
            "others react from, s",
            "how many",
            "end",
        )
    ]
    for one in found:
        reaction = (
            ("", "") if one.reacted is None else (f"{one.reacted[0]:.2f}", str(one.reacted[1]))
        )
        rows.append(
            (
                one.ads, one.scenario, one.point, f"{one.apart[one.most]:.2f}",
                f"{one.time[one.most]:.1f}",
                f"{one.apart[-1]:.2f}", *reaction, one.end,
            )
        )  # fmt: skip
    sentences = (
        "How far each ADS was, at each time, from the vehicle that was recorded in its place.",
        "Dotted: from then on others react. Before, and where nobody reacts, they drive as they "
        "were recorded to.",
    )
    write_study(
        path,
        kicker=run.name,
        title="Departure from the recorded vehicle",
        sentences=sentences,
        figures={"Departure from the recorded vehicle": on_page([panel], 1, 520)},
        rows=rows,
    )
    return found
