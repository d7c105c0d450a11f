"""`sumo-eval drive SCENARIO`: one person drives one concrete scenario, as often as they like.

`study` lets its participants drive with `one_drive`.

Users: `extras/wheel/command.py`, `extras/wheel/study.py`.
"""

from __future__ import annotations

import itertools
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sumo_eval.errors import must_be
from sumo_eval.extras.wheel.page import drive_view, replay, sheet
from sumo_eval.extras.wheel.quality import Quality, quality_of, timing
from sumo_eval.extras.wheel.tape import OWN_WISH, Writer, digest, head_of, read_tape
from sumo_eval.record.store import EGO
from sumo_eval.report.page import Json
from sumo_eval.scenario.concrete import ConcreteScenario, Numbers
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording

if TYPE_CHECKING:
    from sumo_eval.extras.wheel.window import Window

RATES = 20, 50, 100  # Hz
TASK = "Drive as you would drive your own car. The drive ends by itself at the end of the road."
ENDS = {
    "contact": "You touched another vehicle.", "standstill": "You stood still.",
    "road_end": "You have reached the end of the road.", "off_road": "You have left the road.",
    "time_limit": "The time is over.", "quit": "The drive was ended before its end.",
    "sim_error": "The simulation stopped by a fault of its own."
}  # fmt: skip


def settings_at(rate: int) -> SimulationSettings:
    """The settings of a drive by a person, as for any ADS except the step.

    rate: steps a second.
    """
    if rate not in RATES:
        raise must_be("The rate", "a drive", f"one of {', '.join(map(str, RATES))} Hz", rate)
    return SimulationSettings(step=1.0 / rate)


def concrete_of(logical: LogicalScenario, values: Numbers) -> ConcreteScenario:
    """The concrete scenario at these values, with every other parameter in the middle of its range.

    Where the constraints forbid this point, the other parameters are those of the nearest possible
    point of the scenario's default sample.

    values: parameter -> its value.
    """
    columns = [logical.column(name) for name in values]
    row = logical.from_shares([[0.5] * len(logical.names)])[0]
    row[columns] = list(values.values())
    if logical.in_box(row) and not logical.feasible(row):
        points = sample(logical).points
        points[:, columns] = row[columns]
        away = np.linalg.norm(logical.to_unit(points) - logical.to_unit(row), axis=-1)
        # One by one: for an array of points `feasible` of a scenario from an OpenSCENARIO file
        # checks only the constraints, not whether the importer supports the scene. Without a
        # possible point, `row` stays as it was, and `concrete` refuses it.
        row = next(filter(logical.feasible, points[away.argsort(kind="stable")]), row)
    return logical.concrete(**logical.point(row.tolist()))


def new_tape(folder: Path, name: str) -> Path:
    """File of the next drive of a name: NAME-NUMBER.jsonl, one that does not exist yet.

    In a study, `wheel/outcome.py` takes the case of an unfinished drive from this name.
    """
    paths = (folder / f"{name}-{number:03d}.jsonl" for number in itertools.count(1))
    return next(path for path in paths if not path.exists())


async def one_drive(
    window: Window,
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    path: Path,
    view: Json,
    **more: Any,
) -> tuple[Recording, Quality]:
    """Let the person drive, and write the tape with the result of the drive.

    path: of the tape.
    view: as `drive_view` makes it.
    more: further entries of the tape's head.
    """
    settings = concrete.simulation(settings)
    writer = Writer(path, head_of(concrete, settings, **more))
    try:
        recording, page_figures = await window.drive(concrete, settings, writer, view)
        tape = read_tape(path)  # `writer` is still open, but each of its lines is in the file
        figures = timing(tape, page_figures)
        quality = quality_of(recording, tape, concrete, settings, figures)
        end = {
            "reason": recording.end_reason,
            # a drive that the driver left (`quit`) without a fault ended by their own wish
            "error": recording.error or (OWN_WISH if recording.end_reason == "quit" else None),
            "digest": digest(recording), "time": figures, "quality": asdict(quality)
        }  # fmt: skip
        writer.line({"end": end})
    finally:
        writer.close()
    return recording, quality


async def trips(
    window: Window,
    logical: LogicalScenario,
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    out: Path,
    use: str,
) -> None:
    """Drive, see the result, drive again, until the person wishes to end.

    use: locator of the scenario.
    """
    view = drive_view(concrete, settings, logical.name, (logical.about, TASK, concrete.label))
    answer = {"button": "again"}
    while answer.get("button") == "again":
        path = new_tape(out, logical.name)
        recording, quality = await one_drive(window, concrete, settings, path, view, use=use)
        reason = recording.end_reason
        lines = [ENDS.get(reason, reason), recording.error or "", *quality.sentences()]
        vehicles = {EGO: recording.ego, **recording.actors}
        answer = await window.ask(
            sheet("Your drive", "\n".join(filter(None, lines)), f"It is kept in {path}.",
                  replay=replay(concrete, "you", vehicles, recording.collision),
                  buttons=[["again", "Drive again"], ["end", "That is all"]])
        )  # fmt: skip
    await window.show({**sheet("Thank you", "You can close this window."), "show": "over"})
