"""Logical scenarios from recordings: for each class of encounters a scenario file with ranges, a
joint distribution and a rate, and figures on how well it describes the recordings.
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from lxml import etree

from sumo_eval.drivers.recorded.recordings import Recordings
from sumo_eval.errors import InputError
from sumo_eval.extras.rates.encounters import (
    CLASSES,
    Encounters,
    EncounterSurvey,
    Motion,
    find_encounters,
)
from sumo_eval.extras.rates.intervals import (
    end_interval,
    kolmogorov,
    of_each,
    rank_correlation,
    rate_interval,
)
from sumo_eval.extras.rates.scenes import (
    CAR_LENGTH,
    SCENES,
    EncounterScene,
    Quantity,
    content_of,
)
from sumo_eval.report.page import write_csv
from sumo_eval.report.words import count
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.joint import Joint, JointKind
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.text import cell
from sumo_eval.trajectory import BoolArray, FloatArray

FOLDS = 5  # groups of vehicles, each held out once
FACTORS = (0.15, 0.2, 0.27, 0.36, 0.48, 0.64, 0.85)  # bandwidths tried, beside Scott's
MOST_FITTED = 2000  # events that a distribution is fitted to; more only cost time
LEAST_EVENTS = 5  # for each parameter; with fewer there is no distribution
# Kolmogorov distance to held-out vehicles; of models nearer in all parameters the likeliest is best
NEAR = 0.1
SAME = 1e-3  # in the parameter's unit; one with a smaller deviation is a constant
PREFIX = "learnt_"
STEP = 0.1  # s, at which scripted and recorded motion are compared
DATE = "2022-01-01T00:00:00"  # always the same, so that the same events give the same file


class Fit(NamedTuple):
    """Fit of a model to vehicles that it was not fitted to.

    log_likelihood: mean, nats an event.
    kolmogorov: parameter -> distance to the held-out vehicles.
    """

    model: str
    log_likelihood: float
    kolmogorov: Mapping[str, float]


class Learnt(NamedTuple):
    """Results for a class.

    measured: from its events.
    logical: the scenario of its file; None: too few events.
    models: held out, the best first.
    replay: distances from the recorded motion, as `replay_errors` has them, m, (n, 3).
    thinned: number of events beyond `MOST_FITTED`, which the distribution leaves out evenly.
    """

    encounters: Encounters
    measured: Measured
    logical: LogicalScenario | None = None
    joint: Joint | None = None
    models: tuple[Fit, ...] = ()
    replay: FloatArray = np.zeros((0, 3))
    thinned: int = 0


class Lesson(NamedTuple):
    """Results of all classes of a survey."""

    survey: EncounterSurvey
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

    recordings: read one after another, so that memory holds only one.
    source: their name in sentences.
    watch: receives the work under way, and how much is done.
    """
    survey = find_encounters(recordings, watch)
    if not survey.kilometres > 0.0:
        raise InputError("The recordings must hold motor vehicles that drive, got none.")
    about = (
        f"{source}: {count(len(survey.recordings), 'recording')}, "
        f"{survey.kilometres:.1f} vehicle-km in {survey.hours:.2f} h"
    )
    learnt = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for done, name in enumerate(CLASSES):
            watch(f"fitting {name}", done)
            measured = measure(survey.classes[name], survey, folder, about)
            learnt[name] = _learnt(survey.classes[name], measured, folder / name)
    except OSError as error:
        raise InputError(f"The scenarios cannot be written into {folder}: {error}.") from error
    return Lesson(survey, learnt, source)


class Measured(NamedTuple):
    """Figures of a class's events before a fit.

    rate: 1/km, and its 95 % limits.
    needed: least number of events for a distribution.
    constants: parameters that do not vary, and their values.
    logical: the scenario of the file; None: too few events.
    content: of the scenario file, which is written without a distribution.
    kept: whether each of the encounters' rows is within the ranges and constraints, (n,).
    rows: parameters of those that are, (n, k).
    ends: parameter -> intervals of the range's lower and upper end.
    correlations: pair -> Spearman's rank correlation and its limits.
    rate_together: limits of the rate. With 95 % these, all `ends` and all `correlations` hold at
        once, so each is wider than one that holds alone.
    """

    rate: tuple[float, float, float]
    needed: int
    constants: Mapping[str, float]
    logical: LogicalScenario | None = None
    content: Mapping[str, Any] = {}
    kept: BoolArray = np.zeros(0, dtype=np.bool_)
    rows: FloatArray = np.zeros((0, 0))
    ends: Mapping[str, tuple[tuple[float, float], tuple[float, float]]] = {}
    correlations: Mapping[tuple[str, str], tuple[float, float, float]] = {}
    rate_together: tuple[float, float] = (0.0, math.inf)


def measure(encounters: Encounters, survey: EncounterSurvey, folder: Path, source: str) -> Measured:
    """Rate, ranges and correlations of a class, with their intervals, and its scenario file without
    a distribution; no file where there are too few events for one.
    """
    quantities = {item.name: item for item in SCENES[encounters.name].quantities}
    counts = encounters.events, survey.kilometres
    rate = (encounters.events / survey.kilometres, *rate_interval(*counts))
    columns = {name: np.array([row[name] for row in encounters.rows]) for name in quantities}
    constants = {
        name: np.median(column)
        for name, column in columns.items()
        if len(column) > 1 and column.std() < SAME
    }
    free = [name for name in quantities if name not in constants]
    needed = LEAST_EVENTS * len(free or quantities)
    few = Measured(rate, needed, constants)
    # no distribution is fitted to events that are all alike
    if len(encounters.rows) < needed or not free:
        return few
    rows = np.column_stack([columns[name] for name in free])
    ranges = {name: _range(columns[name], quantities[name]) for name in free}
    content = content_of(
        PREFIX + encounters.name, encounters.name, ranges, constants, survey.lane_width, source
    )
    content["met"] = {
        "events": encounters.events,
        "vehicle_km": round(survey.kilometres, 3),
        "where": source,
    }
    path = folder / f"{encounters.name}.toml"
    # read back, the file says which events its constraints rule out
    path.write_text(tomli_w.dumps(content), encoding="utf-8")
    logical = read_scenario(path)
    kept = logical.in_box(rows) & logical.feasible(rows)
    rows = rows[kept]
    if len(rows) < needed:
        path.unlink()
        return few._replace(kept=kept)
    return Measured(
        rate,
        needed,
        constants,
        logical,
        content,
        kept,
        rows,
        *_intervals_at_once(dict(zip(free, rows.T, strict=True)), *counts),
    )


def _intervals_at_once(
    columns: Mapping[str, FloatArray], events: int, kilometres: float
) -> tuple[Any, ...]:
    """`ends`, `correlations` and `rate_together` of `Measured`, which hold at once with 95 %.

    columns: parameter -> its values, (n,).
    """
    pairs = list(itertools.combinations(columns, 2))
    level = of_each(2 * len(columns) + len(pairs) + 1)  # of a single interval
    ends = {
        name: tuple(end_interval(column, upper=upper, level=level) for upper in (False, True))
        for name, column in columns.items()
    }
    correlations = {(a, b): rank_correlation(columns[a], columns[b], level) for a, b in pairs}
    return ends, correlations, rate_interval(events, kilometres, level)


def _learnt(encounters: Encounters, measured: Measured, path: Path) -> Learnt:
    """Fit a class and write its files.

    path: of the files, without their ending.
    """
    if measured.logical is None:
        return Learnt(encounters, measured)
    free = measured.logical.names
    low, high = _tuples(np.array([measured.logical.low, measured.logical.high]))
    fitted = min(len(measured.rows), MOST_FITTED)
    even = np.linspace(0, len(measured.rows) - 1, fitted).round().astype(np.intp)
    rows = measured.rows[even]
    events = np.flatnonzero(measured.kept)[even]  # index of each row among the encounters
    sources = [encounters.sources[event] for event in events]
    motions = [encounters.motions[event] for event in events]

    models = choose_model(rows, free, (low, high), fold_of(sources))
    kind, factor = _named(models[0].model)
    table = path.with_suffix(".events.csv")
    _write_events(table, free, rows, sources)
    distribution: dict[str, Any] = {"events": table.name, "kind": kind}
    if factor is not None:
        distribution["bandwidth"] = factor
    file = path.with_suffix(".toml")
    file.write_text(tomli_w.dumps({**measured.content, "joint": distribution}), encoding="utf-8")
    value_sets(measured, rows, file)

    logical = read_scenario(file)
    joint = Joint(kind, free, _tuples(rows), low, high, factor, table.name)
    replay = replay_errors(logical, encounters.name, rows, motions)
    return Learnt(encounters, measured, logical, joint, models, replay, len(measured.rows) - fitted)


def _write_events(
    path: Path, names: Sequence[str], rows: FloatArray, sources: Sequence[Mapping[str, Any]]
) -> None:
    """Write events as CSV: parameters (n, k), then where each was recorded."""
    lines = (
        [*row, *(cell(str(value)) for value in source.values())]
        for row, source in zip(rows.tolist(), sources, strict=True)
    )
    write_csv(path, [*names, *sources[0]], lines)


def value_sets(measured: Measured, rows: FloatArray, file: Path) -> None:
    """Write events (n, k) of a scenario file as an OpenSCENARIO ParameterValueDistribution.

    It holds value sets: no other distribution of the standard keeps which values occur together.
    """
    root = etree.Element("OpenSCENARIO")
    value, low, high = measured.rate
    about = (
        f"{PREFIX}{file.stem}: {len(rows)} recorded events, {value:.4g} ({low:.4g} to {high:.4g}) "
        "per vehicle-km"
    )
    header = {"revMajor": "1", "revMinor": "1", "date": DATE, "author": "sumo_eval"}
    etree.SubElement(root, "FileHeader", header | {"description": about})
    distribution = etree.SubElement(root, "ParameterValueDistribution")
    etree.SubElement(distribution, "ScenarioFile", filepath=file.name)
    for name in (
        "Deterministic",
        "DeterministicMultiParameterDistribution",
        "ValueSetDistribution",
    ):
        distribution = etree.SubElement(distribution, name)
    assert measured.logical is not None
    for row in rows.tolist():
        event = etree.SubElement(distribution, "ParameterValueSet")
        for name, number in zip(measured.logical.names, row, strict=True):
            etree.SubElement(
                event,
                "ParameterAssignment",
                {"parameterRef": name, "value": repr(round(number, 9))},
            )
    text = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    file.with_suffix(".xosc").write_bytes(text)


def _tuples(rows: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, rows.tolist()))


def _range(values: FloatArray, quantity: Quantity) -> tuple[float, float]:
    """A range that holds the values and one kernel deviation beyond, rounded outwards.

    It ends at the quantity's ceiling at the latest. It begins below the floor only as far as values
    are recorded there.
    """
    width = values.std(ddof=1) * len(values) ** -0.2
    # unit of the third digit of the values' spread
    scale = 10.0 ** (math.floor(math.log10(max(np.ptp(values), 1e-6))) - 2)
    low = math.floor((values.min() - width) / scale) * scale
    high = math.ceil((values.max() + width) / scale) * scale
    if quantity.floor is not None:
        low = max(low, min(quantity.floor, float(values.min())))
    if quantity.ceiling is not None:
        high = min(high, quantity.ceiling)
    return round(low, 6), round(high, 6)


# --- held out -------------------------------------------------------------------------------------


def fold_of(sources: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """The fold of each event, by a hash of its ego, so that no vehicle is in two folds.

    By the event's number where all egos fall into one fold.
    """
    egos = (f"{source['recording']}/{source['ego']}" for source in sources)
    folds = np.array([zlib.crc32(ego.encode()) % FOLDS for ego in egos])
    return folds if np.ptp(folds) else np.arange(len(folds)) % FOLDS


def _named(model: str) -> tuple[JointKind, float | None]:
    """Kind and bandwidth of a model by its name, `copula 0.27`; `kde` alone has Scott's, None."""
    kind, _, factor = model.partition(" ")
    return ("kde" if kind == "kde" else "copula"), float(factor) if factor else None


def choose_model(
    rows: FloatArray,
    names: Sequence[str],
    box: Sequence[tuple[float, ...]],
    folds: np.ndarray,
) -> tuple[Fit, ...]:
    """Every model on vehicles that it was not fitted to, the best first, the even density last.

    Best is the likeliest of those that are within `NEAR` of the held-out vehicles in every
    parameter; where none is, the nearest.

    box: lower and upper ends of the ranges.
    """
    fits = []
    for factor in ("", *(f" {factor:g}" for factor in FACTORS)):
        for kind in ("kde", "copula"):
            fits += _fits(kind + factor, rows, names, box, folds)
    # within `NEAR` all count as equally near
    fits.sort(key=lambda item: (max(*item.kolmogorov.values(), NEAR), -item.log_likelihood))
    return (*fits, Fit("even", -math.log(np.prod(np.subtract(box[1], box[0]))), {}))


def _fits(
    model: str,
    rows: FloatArray,
    names: Sequence[str],
    box: Sequence[tuple[float, ...]],
    folds: np.ndarray,
) -> list[Fit]:
    """The fit of a model to the folds that are held out in turn; none where too few events are left
    to fit it to.
    """
    kind, bandwidth = _named(model)
    logs, shares = [], []
    for fold in range(FOLDS):
        train, test = rows[folds != fold], rows[folds == fold]
        if len(test) and len(train) >= len(names) + 2:
            joint = Joint(kind, tuple(names), _tuples(train), box[0], box[1], bandwidth)
            logs.append(np.log(np.maximum(joint.density(test) / joint.mass(), 1e-300)))
            shares.append(marginal_shares(joint, test))
    if not logs:
        return []
    columns = zip(names, np.concatenate(shares).T, strict=True)
    distances = {name: kolmogorov(column) for name, column in columns}
    return [Fit(model, np.concatenate(logs).mean(), distances)]


def marginal_shares(joint: Joint, points: FloatArray) -> FloatArray:
    """The distribution function of each parameter alone at points (n, k), from draws within the
    box.
    """
    drawn = np.sort(joint.draw(8192, random_stream(0, "marginals", len(joint.events))), axis=0)
    return np.column_stack(
        [np.searchsorted(own, at) / len(drawn) for own, at in zip(drawn.T, points.T, strict=True)]
    )


# --- replay ---------------------------------------------------------------------------------------


def replay_errors(
    logical: LogicalScenario, class_: str, rows: FloatArray, motions: Sequence[Motion]
) -> FloatArray:
    """Root mean square distance, m, between the actor's motion of the file and its recorded one:
    along the road, across it and together, (n, 3).

    Along the road the gap to the ego counts, as vehicles of the file all have the same length.

    rows: the events' parameters (n, k).
    """
    squares = [
        _replay_squares(
            logical.placed(dict(zip(logical.names, row, strict=True))), SCENES[class_], motion
        )
        for row, motion in zip(rows.tolist(), motions, strict=True)
    ]
    both = np.reshape(squares, (-1, 2))
    return np.asarray(np.sqrt(np.column_stack([both, both.sum(axis=1)])))


def _replay_squares(
    concrete: ConcreteScenario, scene: EncounterScene, motion: Motion
) -> tuple[float, float]:
    """Mean squares, m2, of an event's distances along the road and across it."""
    number = [actor.name for actor in scene.actors].index(scene.replayed)
    body = CAR_LENGTH, 1.8  # of the ego, m
    until = max(motion.time[-1], STEP)
    driven = tracks([concrete], [body], STEP, until).others[0, number]
    clock = np.arange(len(driven)) * STEP
    lane = concrete.road.lane_width
    # side of the ego that the actor is on, its lane, and the lane that the record begins in
    side, level, first = (-1.0, 1.0, lane) if scene.behind else (1.0, scene.level, 0.0)
    x = driven[:, 0] - concrete.ego.x - side * CAR_LENGTH
    y = driven[:, 1] - level * lane
    along = np.interp(motion.time, clock, x) - (motion.x - side * motion.bodies)
    across = np.interp(motion.time, clock, y) - (motion.y - first)
    return np.mean(along**2), np.mean(across**2)
