"""`sumo-eval drive SCENARIO`: one person, one concrete scenario, as often as they like."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.extras.wheel.page import drive_view, page, replay, sheet
from sumo_eval.extras.wheel.quality import Quality, quality_of
from sumo_eval.extras.wheel.tape import Writer, digest, head_of, read_tape
from sumo_eval.extras.wheel.window import Window
from sumo_eval.record.store import EGO
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import FloatArray, Recording

RATES = (20, 50, 100)  # Hz
PORT = 8765  # always the same, so that the browser remembers a wheel's calibration
TASK = "Drive as you would drive your own car. The road ahead ends by itself."
ENDS = {
    "contact": "You touched another vehicle.", "standstill": "You stood still.",
    "road_end": "You have reached the end of the road.", "off_road": "You have left the road.",
    "time_limit": "The time is over.", "quit": "The drive was ended before its end.",
    "sim_error": "The simulation stopped by a fault of its own.",
}  # fmt: skip


def settings_at(rate: int) -> SimulationSettings:
    """The settings of a drive at a rate, Hz: its step is the rate's, everything else as for any
    ADS.
    """
    if rate not in RATES:
        raise must_be("The rate", "a drive", f"one of {', '.join(map(str, RATES))} Hz", rate)
    return SimulationSettings(step=1.0 / rate)


def concrete_of(logical: LogicalScenario, values: Mapping[str, float]) -> ConcreteScenario:
    """The concrete scenario at the given values; each other parameter in the middle of its range,
    or of its listed values; where that is impossible, those of the nearest point of the sample.
    """
    check_known(f"parameter of scenario `{logical.name}`", logical.names, *values)
    row = logical.row({**{it.name: _middle(it) for it in logical.parameters}, **values})
    if not logical.feasible(row) and len(points := _possible(logical, values)):
        away = logical.to_unit(points) - logical.to_unit(row)
        row = points[np.linalg.norm(away, axis=-1).argmin()]
    return logical.concrete(**dict(zip(logical.names, row.tolist(), strict=True)))


def _middle(parameter: Parameter) -> float:
    listed = parameter.values
    return listed[len(listed) // 2] if listed else (parameter.low + parameter.high) / 2.0


def _possible(logical: LogicalScenario, values: Mapping[str, float]) -> FloatArray:
    """Possible points (n, k) of the scenario's default sample with these values put in."""
    points = sample(logical).points.copy()
    points[:, [logical.column(name) for name in values]] = list(values.values())
    return points[logical.feasible(points)]


def new_tape(folder: Path, name: str) -> Path:
    """File of the next drive of a name: one that does not exist yet."""
    paths = (folder / f"{name}-{number:03d}.jsonl" for number in itertools.count(1))
    return next(path for path in paths if not path.exists())


async def one_drive(
    window: Window,
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    path: Path,
    view: Mapping[str, Any],
    **more: Any,
) -> tuple[Recording, Quality]:
    """Let the person drive, and keep the tape with its result.

    more: for the head of the tape.
    """
    settings = concrete.simulation(settings)
    writer = Writer(path, head_of(concrete, settings, **more))
    try:
        recording, time = await window.drive(concrete, settings, writer, dict(view))
        quality = quality_of(recording, read_tape(path), concrete, time)
        end = {
            "reason": recording.end_reason, "error": recording.error or time["left"] or None,
            "digest": digest(recording), "time": time, "quality": asdict(quality),
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


async def opened(
    title: str, port: int, work: Callable[[Window], Any], watch: Callable[[str], None]
) -> None:
    """A window for as long as `work` uses it.

    watch: receives the address.
    """
    try:
        window = Window(page(title), port=port)
    except InputError:
        if port != PORT:
            raise
        window = Window(page(title))  # another program has the usual port: any other does
    async with window:
        watch(window.address)
        await work(window)
        await asyncio.sleep(0.3)  # the last view is still under way
