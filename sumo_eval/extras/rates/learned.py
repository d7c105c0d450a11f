"""Logical scenarios from recordings: for each class of encounters a scenario file with ranges, a
joint distribution and a rate, and what is known of how well it describes what was recorded.
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w

from sumo_eval.drivers.recorded.recordings import Recordings
from sumo_eval.errors import InputError
from sumo_eval.extras.rates.encounters import CLASSES, Encounters, Motion, Survey, find_encounters
from sumo_eval.extras.rates.intervals import (
    end_interval,
    kolmogorov,
    of_each,
    rank_correlation,
    rate_interval,
)
from sumo_eval.extras.rates.scenes import CAR_LENGTH, SCENES, Quantity, content_of
from sumo_eval.extras.rates.value_sets import value_sets
from sumo_eval.report.page import write_csv
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.joint import Joint, JointKind
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.text import cell
from sumo_eval.trajectory import BoolArray, FloatArray

FOLDS: Final = 5  # in which vehicles are held out
# bandwidths of a KDE that are tried, over the data's spread
FACTORS: Final = (0.15, 0.2, 0.27, 0.36, 0.48, 0.64, 0.85)
# events of a distribution: its cost grows with them, and the tails are the same
MOST_FITTED: Final = 2000
LEAST_EVENTS: Final = 5  # a parameter: with fewer there is no distribution
# Kolmogorov distance to held-out vehicles; models nearer in every parameter are told by likelihood
NEAR: Final = 0.1
SAME: Final = 1e-3  # in the parameter's unit: a deviation below makes a parameter a constant
PREFIX: Final = "learnt_"
STEP: Final = 0.1  # s, at which scripted and recorded motion are compared


@dataclass(frozen=True, slots=True)
class Held:
    """How well a model describes vehicles that it was not fitted to.

    log_likelihood: mean, nats an event.
    kolmogorov: parameter -> distance to the held-out vehicles.
    """

    model: str
    log_likelihood: float
    kolmogorov: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Learnt:
    """What was learnt of a class.

    measured: what was read off its events.
    logical: the scenario as its file says it; None: too few events.
    models: held out, the best first.
    replay: root mean square distance, m, of the other's scripted motion to its recorded one, along
        and across the road and together, (n, 3).
    thinned: events that the distribution leaves out, evenly, where there are more than
        `MOST_FITTED`.
    """

    encounters: Encounters
    measured: Measured
    logical: LogicalScenario | None = None
    joint: Joint | None = None
    models: tuple[Held, ...] = ()
    replay: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    thinned: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """Everything that was learnt from recordings."""

    found: Survey
    learnt: Mapping[str, Learnt]
    source: str


def learn(
    recordings: Iterable[Recordings],
    folder: Path,
    source: str,
    watch: Callable[[str, int], None] = lambda what, done: None,
) -> Lesson:
    """Learn from recordings and write the scenario files, their events and OpenSCENARIO
    distributions into `folder`.

    recordings: taken one after the other, so that only one has to be held.
    source: what they are called in sentences.
    watch: told what is done, and how much of it.
    """
    found = find_encounters(recordings, watch)
    if not found.kilometres > 0.0:
        raise InputError("The recordings must hold motor vehicles that drive, got none.")
    learnt = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for done, name in enumerate(CLASSES):
            watch(f"fitting {name}", done)
            learnt[name] = _learnt(found.classes[name], found, folder, source)
    except OSError as error:
        raise InputError(f"What was learnt cannot be written into {folder}: {error}.") from error
    return Lesson(found, learnt, source)


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What is read off a class's events before anything is fitted to them.

    rate: 1/km, and its 95 % limits by themselves.
    needed: events for a distribution.
    constants: parameters that do not vary.
    content: of the scenario file, which is written without a distribution.
    kept: which of the encounters' rows the distribution is fitted to, (n,) True or False;
    rows: their parameters (n, k).
    ends: parameter -> intervals of the range's lower and upper end.
    correlations: pairs -> Spearman's rank correlation and its interval.
    rate_together: limits of the rate that, with all `ends` and `correlations`, hold at once with 95
        %.
    """

    rate: tuple[float, float, float]
    needed: int
    constants: Mapping[str, float]
    logical: LogicalScenario | None = None
    content: Mapping[str, Any] = field(default_factory=dict)
    kept: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    rows: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    ends: Mapping[str, tuple[tuple[float, float], tuple[float, float]]] = field(
        default_factory=dict
    )
    correlations: Mapping[tuple[str, str], tuple[float, float, float]] = field(default_factory=dict)
    rate_together: tuple[float, float] = (0.0, math.inf)


def measure(encounters: Encounters, found: Survey, folder: Path, source: str) -> Measured:
    """Rate, ranges and correlations of a class, with their intervals, and its scenario file without
    a distribution; no file where there are too few events for one.
    """
    scene = SCENES[encounters.name]
    rate = (
        encounters.events / found.kilometres,
        *rate_interval(encounters.events, found.kilometres),
    )
    names = [item.name for item in scene.quantities]
    n = len(encounters.rows)
    rows = np.array([[row[name] for name in names] for row in encounters.rows]).reshape(
        n, len(names)
    )
    constants = {
        name: float(np.median(rows[:, j]))
        for j, name in enumerate(names)
        if n > 1 and rows[:, j].std() < SAME
    }
    free = [name for name in names if name not in constants]
    needed = LEAST_EVENTS * len(free or names)  # nothing can be fitted to events that are all alike
    if n < needed or not free:
        return Measured(rate, needed, constants)
    known = {item.name: item for item in scene.quantities}
    rows = rows[:, [names.index(name) for name in free]]
    ranges = {name: _range(rows[:, j], known[name]) for j, name in enumerate(free)}
    name = PREFIX + encounters.name
    content = content_of(
        name, encounters.name, ranges, constants, found.lane_width, _source(source, found)
    )
    content["met"] = {
        "events": encounters.events, "vehicle_km": round(found.kilometres, 3),
        "where": _source(source, found)
    }  # fmt: skip
    path = folder / f"{encounters.name}.toml"
    # without the joint distribution: its constraints say which events are possible
    _write(path, content)
    logical = read_scenario(path)
    kept = logical.in_box(rows) & logical.feasible(rows)
    rows = rows[kept]
    if len(rows) < needed:
        path.unlink()
        return Measured(rate, needed, constants)
    pairs = list(itertools.combinations(range(len(free)), 2))
    each = of_each(2 * len(free) + len(pairs) + 1)
    ends = {
        name: (
            end_interval(rows[:, j], upper=False, level=each),
            end_interval(rows[:, j], upper=True, level=each),
        )
        for j, name in enumerate(free)
    }
    correlations = {
        (free[i], free[j]): rank_correlation(rows[:, i], rows[:, j], each) for i, j in pairs
    }
    together = rate_interval(encounters.events, found.kilometres, each)
    return Measured(
        rate, needed, constants, logical, content, kept, rows, ends, correlations, together
    )


def _learnt(encounters: Encounters, found: Survey, folder: Path, source: str) -> Learnt:
    met = measure(encounters, found, folder, source)
    if met.logical is None:
        return Learnt(encounters, met)
    free = list(met.logical.names)
    low, high = tuple(met.logical.low.tolist()), tuple(met.logical.high.tolist())
    rows, places = met.rows, np.flatnonzero(met.kept)
    if len(places) > MOST_FITTED:
        even = np.linspace(0, len(places) - 1, MOST_FITTED).round().astype(np.intp)
        places, rows = places[even], rows[even]
    who = [encounters.sources[place] for place in places]
    models = choose_model(rows, free, (low, high), fold_of(who))
    best = models[0]
    kind, factor = _named(best.model)
    path = folder / f"{encounters.name}.toml"
    table = folder / f"{encounters.name}.events.csv"
    told = zip(rows.tolist(), who, strict=True)
    write_csv(
        table,
        [*free, *who[0]],
        ([*row, *(cell(str(value)) for value in one.values())] for row, one in told),
    )
    distribution = {"events": table.name, "kind": kind} | (
        {} if factor is None else {"bandwidth": factor}
    )
    _write(path, {**met.content, "joint": distribution})
    value_sets(
        PREFIX + encounters.name,
        free,
        rows,
        path.name,
        met.rate,
        folder / f"{encounters.name}.xosc",
    )
    logical = read_scenario(path)
    joint = Joint(
        kind, tuple(free), tuple(map(tuple, rows.tolist())), low, high, factor, table.name
    )
    replay = replay_errors(
        logical, encounters.name, rows, [encounters.motions[place] for place in places]
    )
    return Learnt(encounters, met, logical, joint, models, replay, len(met.rows) - len(rows))


def _source(source: str, found: Survey) -> str:
    return (
        f"{source}: {len(found.recordings)} recordings, {found.kilometres:.1f} vehicle-km in "
        f"{found.hours:.2f} h"
    )


def _range(values: FloatArray, quantity: Quantity) -> tuple[float, float]:
    """A range that holds the values and one kernel deviation beyond, rounded outwards; there is
    nothing above the quantity's ceiling, and below its floor only what was recorded.
    """
    width = float(values.std(ddof=1)) * len(values) ** -0.2
    scale = 10.0 ** (math.floor(math.log10(max(float(np.ptp(values)), 1e-6))) - 2)
    low = math.floor((values.min() - width) / scale) * scale
    high = math.ceil((values.max() + width) / scale) * scale
    if quantity.floor is not None:
        low = max(low, min(quantity.floor, float(values.min())))
    if quantity.ceiling is not None:
        high = min(high, quantity.ceiling)
    return round(low, 6), round(high, 6)


# --- held out -------------------------------------------------------------------------------------


def fold_of(who: Sequence[Mapping[str, Any]]) -> FloatArray:
    """The fold of each event, by the vehicle that met it: no vehicle is in two."""
    return np.array(
        [zlib.crc32(f"{one['recording']}/{one['ego']}".encode()) % FOLDS for one in who]
    )


_CANDIDATES: Final = (
    "kde",
    "copula",
    *(f"{kind} {factor:g}" for kind in ("kde", "copula") for factor in FACTORS),
)


def _named(model: str) -> tuple[JointKind, float | None]:
    """Kind and bandwidth of a model by its name, `copula 0.27` or `kde`; None: Scott's."""
    kind, _, factor = model.partition(" ")
    return ("kde" if kind == "kde" else "copula"), float(factor) if factor else None


def choose_model(
    rows: FloatArray,
    names: Sequence[str],
    box: tuple[Sequence[float], Sequence[float]],
    folds: FloatArray,
) -> tuple[Held, ...]:
    """Every model on vehicles that it was not fitted to, the best first, the even density last.

    Best is the likeliest of those that are within `NEAR` of the held-out vehicles in every
    parameter; where none is, the nearest.
    """
    found = []
    for model in _CANDIDATES:
        kind, factor = _named(model)
        logs, shares = [], []
        for fold in range(FOLDS):
            train, test = rows[folds != fold], rows[folds == fold]
            if not len(test) or len(train) < len(names) + 2:
                continue
            joint = Joint(
                kind,
                tuple(names),
                tuple(map(tuple, train.tolist())),
                tuple(box[0]),
                tuple(box[1]),
                factor,
            )
            density = joint.density(test) / joint.mass()
            logs.append(np.log(np.maximum(density, 1e-300)))
            shares.append(marginal_shares(joint, test))
        if logs:
            distances = {
                name: kolmogorov(np.concatenate(shares)[:, j]) for j, name in enumerate(names)
            }
            found.append(Held(model, float(np.concatenate(logs).mean()), distances))
    found.sort(key=lambda item: (max(*item.kolmogorov.values(), NEAR), -item.log_likelihood))
    whole = float(np.prod(np.array(box[1]) - np.array(box[0])))
    return (*found, Held("even", -math.log(whole), {}))


def marginal_shares(joint: Joint, points: FloatArray) -> FloatArray:
    """The distribution function of each parameter by itself at points (n, k), within the box."""
    drawn = np.sort(joint.draw(8192, random_stream(0, "marginals", len(joint.events))), axis=0)
    columns = [
        np.searchsorted(drawn[:, j], points[:, j]) / len(drawn) for j in range(points.shape[1])
    ]
    return np.column_stack(columns)


# --- replay ---------------------------------------------------------------------------------------


def replay_errors(
    logical: LogicalScenario, class_: str, rows: FloatArray, motions: Sequence[Motion]
) -> FloatArray:
    """Root mean square distance, m, between the other's motion as the file says it and as it was:
    along the road, across it and together, (n, 3).

    rows: the events' parameters (n, k).
    """
    scene = SCENES[class_]
    number = [other.name for other in scene.others].index(scene.replayed)
    found = []
    for row, motion in zip(rows.tolist(), motions, strict=True):
        concrete = logical.placed(dict(zip(logical.names, row, strict=True)))
        until = max(float(motion.time[-1]), STEP)
        seen = tracks([concrete], [(CAR_LENGTH, 1.8)], STEP, until).others[0, number]
        clock = np.arange(len(seen)) * STEP
        body = CAR_LENGTH if not scene.behind else -CAR_LENGTH
        real = motion.bodies if not scene.behind else -motion.bodies
        along = np.interp(motion.time, clock, seen[:, 0] - concrete.ego.x - body) - (
            motion.x - real
        )
        level = 1.0 if scene.behind else float(scene.level)
        across = np.interp(motion.time, clock, seen[:, 1] - level * concrete.road.lane_width)
        across = across - (motion.y - (concrete.road.lane_width if scene.behind else 0.0))
        squares = [float(np.mean(along**2)), float(np.mean(across**2))]
        found.append([math.sqrt(squares[0]), math.sqrt(squares[1]), math.sqrt(sum(squares))])
    return np.array(found).reshape(-1, 3)


# --- files ----------------------------------------------------------------------------------------


def _write(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(tomli_w.dumps(dict(content)), encoding="utf-8")
