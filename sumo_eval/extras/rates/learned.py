"""Logical scenarios from recordings, one for each class of encounters, for `sumo-eval learn`.

A scenario file has ranges, a joint distribution and a rate. `Learnt` also has how well the file
describes the recordings: the likelihood of vehicles that were held out of the fit, and the distance
of the file's actor from the recorded one.

Users: `extras/rates/command.py`, `extras/rates/learn_page.py`.
"""

import itertools
import math
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import tomli_w
from lxml.etree import Element, SubElement, tostring

from sumo_eval.drivers.recorded.recordings import Recordings
from sumo_eval.errors import InputError
from sumo_eval.extras.rates.encounters import CLASSES, Encounters, EncounterSurvey, find_encounters
from sumo_eval.extras.rates.intervals import (
    Limits,
    correlation_interval,
    end_interval,
    kolmogorov,
    of_each,
    rate_interval,
)
from sumo_eval.extras.rates.measured import Motion
from sumo_eval.extras.rates.scenes import CAR_LENGTH, SCENES, EncounterScene, Quantity, content_of
from sumo_eval.groups import evenly_spread
from sumo_eval.input_file import writing
from sumo_eval.report.page import write_csv
from sumo_eval.report.words import count
from sumo_eval.scenario.concrete import ConcreteScenario, Numbers
from sumo_eval.scenario.file import read_scenario, scenario_from
from sumo_eval.scenario.joint import Joint, JointKind, vary_alone
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.score_notes import Bounds
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.text import cell
from sumo_eval.trajectory import BoolArray, FloatArray

FOLDS = 5  # groups of vehicles, each held out once
FACTORS = (0.15, 0.2, 0.27, 0.36, 0.48, 0.64, 0.85)  # bandwidths to try, in addition to Scott's
MOST_FITTED = 2000  # events to which a distribution is fitted; more only take longer
LEAST_EVENTS = 5  # for each parameter; a class with fewer has no distribution
# Kolmogorov distance within which models count as equally near the held-out vehicles
NEAR = 0.1
LEAST_DEVIATION = 1e-3  # in the parameter's unit; a smaller one makes it a constant
PREFIX = "learnt_"  # of the scenarios' names
STEP = 0.1  # s between two positions of the scripted motion
EGO_WIDTH = 1.8  # m, in the replay
MARGINAL_DRAWS = 8192  # points that give the distribution function of a parameter
DATE = "2022-01-01T00:00:00"  # always the same, so that the same events give the same file


class Fit(NamedTuple):
    """How well a model describes vehicles that were held out of its fit.

    model: `even`, or kind and bandwidth of `joint`, as `copula 0.27`. The kind alone: the bandwidth
        is Scott's.
    log_likelihood: mean over the held-out events, nats.
    kolmogorov: parameter -> Kolmogorov distance to the held-out events; empty of `even`.
    joint: the model over all events; None of `even`.
    """

    model: str
    log_likelihood: float
    kolmogorov: Numbers
    joint: Joint | None = None


class Learnt(NamedTuple):
    """Results for a class.

    By `measure`. Without a distribution, `logical` is None, and the fields after it are empty,
    except perhaps `kept`:

    encounters: of the class.
    rate: of encounters, 1/km, and its 95 % limits.
    needed: least number of events for a distribution.
    constants: parameter that does not vary -> its value.
    logical: the scenario; None: too few events, or they do not vary in each parameter on its own.
    content: tables of its file without a distribution.
    kept: whether each row of the encounters is within the ranges and constraints, (n,).
    rows: parameters of these rows, (kept, k).
    ends: parameter -> intervals of the lower and of the upper end of its range.
    correlations: pair of parameters -> Spearman's rank correlation and its limits.
    rate_together: limits of the rate. With 95 %, they hold together with all intervals of `ends`
        and `correlations`: each of these is wider than an interval that holds alone.

    By `_fitted`, which also replaces `logical` by the scenario of the file:

    joint: distribution of the parameters.
    models: all that were tried, the best first.
    replay: error of the actor's motion in each fitted event, m, (n, 3), as by `replay_errors`.
    thinned: number of events beyond `MOST_FITTED`, which the distribution leaves out evenly.
    """

    encounters: Encounters
    rate: Limits
    needed: int
    constants: Numbers
    logical: LogicalScenario | None = None
    content: Mapping[str, Any] = {}
    kept: BoolArray = np.zeros(0, dtype=np.bool_)
    rows: FloatArray = np.zeros((0, 0))
    ends: Mapping[str, tuple[Bounds, Bounds]] = {}
    correlations: Mapping[tuple[str, str], Limits] = {}
    rate_together: Bounds = (0.0, math.inf)
    joint: Joint | None = None
    models: tuple[Fit, ...] = ()
    replay: FloatArray = np.zeros((0, 3))
    thinned: int = 0


class Lesson(NamedTuple):
    """Results of all classes.

    learnt: class -> its results.
    source: name of the recordings in sentences.
    """

    survey: EncounterSurvey
    learnt: Mapping[str, Learnt]
    source: str


def learn(
    recordings: Iterable[Recordings],
    folder: Path,
    source: str,
    watch: Callable[[str, int], None] = lambda what, done: None,
) -> Lesson:
    """Learn from recordings; write scenario files, their events and OpenSCENARIO distributions.

    recordings: read one by one, so that memory holds only one.
    folder: receives the files.
    source: name of the recordings in sentences.
    watch: receives a recording that was read or a class that was fitted, and the number of those
        done so far.
    """
    survey = find_encounters(recordings, watch)
    if not survey.kilometres > 0.0:
        raise InputError("The recordings must hold motor vehicles that drive, got none.")
    about = (
        f"{source}: {count(len(survey.recordings), 'recording')}, "
        f"{survey.kilometres:.1f} vehicle-km in {survey.hours:.2f} h"
    )
    learnt = {}
    with writing(f"The scenarios in {folder}", folder):
        for done, name in enumerate(CLASSES, start=1):
            learnt[name] = _fitted(measure(survey.classes[name], survey, about), folder / name)
            watch(f"fitted {name}", done)
    return Lesson(survey, learnt, source)


def measure(encounters: Encounters, survey: EncounterSurvey, source: str) -> Learnt:
    """Measure rate, ranges and correlations of a class, and make its scenario without a
    distribution.

    source: of the recordings, for the scenario's file.
    """
    quantities = {item.name: item for item in SCENES[encounters.name].quantities}
    events, kilometres = encounters.events, survey.kilometres
    rate = (events / kilometres, *rate_interval(events, kilometres))
    columns = {name: np.array([row[name] for row in encounters.rows]) for name in quantities}
    constants = {
        name: np.median(column)
        for name, column in columns.items()
        if len(column) > 1 and column.std() < LEAST_DEVIATION
    }
    free = [name for name in quantities if name not in constants]
    # `quantities`: where no parameter is free, the report still needs a number
    needed = LEAST_EVENTS * len(free or quantities)
    learnt = Learnt(encounters, rate, needed, constants)
    # events that are all alike have no distribution
    if len(encounters.rows) < needed or not free:
        return learnt

    ranges = {name: _range(columns[name], quantities[name]) for name in free}
    content = content_of(
        PREFIX + encounters.name, encounters.name, ranges, constants, survey.lane_width, source
    )
    content["met"] = {"events": events, "vehicle_km": round(kilometres, 3), "where": source}
    # the scenario's own ranges and constraints decide which events are kept
    logical = scenario_from(content, f"learnt scenario `{encounters.name}`", Path())
    rows = np.column_stack([columns[name] for name in free])
    learnt = learnt._replace(kept=logical.in_box(rows) & logical.feasible(rows))
    rows = rows[learnt.kept]
    if len(rows) < needed or not vary_alone(rows):
        return learnt
    intervals = _intervals_at_once(dict(zip(free, rows.T, strict=True)), events, kilometres)
    return learnt._replace(logical=logical, content=content, rows=rows, **intervals)


def _intervals_at_once(
    columns: Mapping[str, FloatArray], events: int, kilometres: float
) -> dict[str, Any]:
    """Fields of `Learnt` with their intervals: `ends`, `correlations` and `rate_together`.

    columns: parameter -> its values, (n,).
    events, kilometres: from which the rate was counted.
    """
    pairs = list(itertools.combinations(columns, 2))
    level = of_each(2 * len(columns) + len(pairs) + 1)  # of a single interval
    ends = {
        name: tuple(end_interval(column, upper=upper, level=level) for upper in (False, True))
        for name, column in columns.items()
    }
    correlations = {(a, b): correlation_interval(columns[a], columns[b], level) for a, b in pairs}
    rate = rate_interval(events, kilometres, level)
    return {"ends": ends, "correlations": correlations, "rate_together": rate}


def _fitted(measured: Learnt, path: Path) -> Learnt:
    """Fit a class's distribution and write its files.

    path: of the files, without their ending.
    """
    if measured.logical is None:
        for ending in (".toml", ".xosc", ".events.csv"):  # that an earlier `learn` has written
            path.with_suffix(ending).unlink(missing_ok=True)
        return measured
    encounters = measured.encounters
    names = measured.logical.names
    low, high = _tuples(np.array([measured.logical.low, measured.logical.high]))
    # indices of the rows to fit, and the index of each in the encounters
    even = evenly_spread(range(len(measured.rows)), MOST_FITTED)
    rows = measured.rows[even]
    events = np.flatnonzero(measured.kept)[even].tolist()
    sources = [encounters.sources[event] for event in events]
    table, file = path.with_suffix(".events.csv"), path.with_suffix(".toml")
    # `choose_model` tries every kind
    any_model = Joint("kde", names, _tuples(rows), low, high, source=table.name)
    models = choose_model(any_model, folds_of(sources, rows))
    joint = models[0].joint
    assert joint is not None  # `even`, which has none, is the last

    _write_events(table, names, rows, sources)
    distribution: dict[str, Any] = {"events": table.name, "kind": joint.kind}
    if joint.bandwidth is not None:
        distribution["bandwidth"] = joint.bandwidth
    file.write_text(tomli_w.dumps({**measured.content, "joint": distribution}), encoding="utf-8")
    write_value_sets(names, measured.rate, rows, file)

    logical = read_scenario(file)
    motions = [encounters.motions[event] for event in events]
    return measured._replace(
        logical=logical, joint=joint, models=models,
        replay=replay_errors(logical, encounters.name, rows, motions),
        thinned=len(measured.rows) - len(rows),
    )  # fmt: skip


def _write_events(
    path: Path, names: Sequence[str], rows: FloatArray, sources: Sequence[Mapping[str, Any]]
) -> None:
    """Write events as CSV.

    names: of the parameters.
    rows: parameters of the events, (n, k).
    sources: of the events, as in `Encounters`.
    """
    lines = (
        [*row, *(cell(str(value)) for value in source.values())]
        for row, source in zip(rows.tolist(), sources, strict=True)
    )
    write_csv(path, [*names, *sources[0]], lines)


def write_value_sets(names: Sequence[str], rate: Limits, rows: FloatArray, file: Path) -> None:
    """Write events as an OpenSCENARIO ParameterValueDistribution, next to their scenario file.

    It holds value sets: no other distribution of the standard keeps which values occur together.

    names: of the parameters.
    rate: of encounters, 1/km, and its limits.
    rows: parameters of the events, (n, k).
    file: the scenario file.
    """
    root = Element("OpenSCENARIO")
    value, low, high = rate
    about = (
        f"{PREFIX}{file.stem}: {len(rows)} recorded events, {value:.4g} ({low:.4g} to {high:.4g}) "
        "per vehicle-km"
    )
    header = {
        "revMajor": "1", "revMinor": "1", "date": DATE, "author": "sumo_eval", "description": about,
    }  # fmt: skip
    SubElement(root, "FileHeader", header)
    element = SubElement(root, "ParameterValueDistribution")
    SubElement(element, "ScenarioFile", filepath=file.name)
    # each within the one before
    for tag in ("Deterministic", "DeterministicMultiParameterDistribution", "ValueSetDistribution"):
        element = SubElement(element, tag)
    for row in rows.tolist():
        event = SubElement(element, "ParameterValueSet")
        for name, number in zip(names, row, strict=True):
            text = repr(round(number, 9))
            SubElement(event, "ParameterAssignment", parameterRef=name, value=text)
    content = tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    file.with_suffix(".xosc").write_bytes(content)


def _tuples(rows: FloatArray) -> tuple[tuple[float, ...], ...]:
    """The rows of an array as tuples of floats."""
    return tuple(map(tuple, rows.tolist()))


def _range(values: FloatArray, quantity: Quantity) -> Bounds:
    """Range of a parameter: its values and one kernel deviation beyond, rounded outwards.

    The range ends at the quantity's ceiling or before. It begins at the floor or above it, except
    where values lie below the floor: then it begins with the lowest value.
    """
    width = values.std(ddof=1) * len(values) ** -0.2  # Scott's, of one parameter
    # the range is rounded at the third digit of the values' spread
    scale = 10.0 ** (math.floor(math.log10(max(np.ptp(values), 1e-6))) - 2)
    low = math.floor((values.min() - width) / scale) * scale
    high = math.ceil((values.max() + width) / scale) * scale
    low = max(low, min(quantity.floor, float(values.min())))
    return round(low, 6), round(min(high, quantity.ceiling), 6)


# --- held out -------------------------------------------------------------------------------------


def folds_of(sources: Sequence[Mapping[str, Any]], rows: FloatArray) -> np.ndarray:
    """The fold of each event, 0 to `FOLDS` - 1, by a hash of its ego: no ego is in two folds.

    If no fold leaves events that a model can be fitted to, the events are dealt out in order
    instead. So it is if all egos fall into one fold.

    sources: as in `Encounters`.
    rows: parameters of the events, (n, k).
    """
    egos = (f"{source['recording']}/{source['ego']}" for source in sources)
    folds = np.array([zlib.crc32(ego.encode()) % FOLDS for ego in egos])
    fitted = any(_has_fit(rows[folds != fold]) for fold in np.unique(folds))
    return folds if fitted else np.arange(len(folds)) % FOLDS


def _has_fit(rows: FloatArray) -> bool:
    """Whether a `Joint` can be fitted to events (n, k)."""
    return len(rows) >= rows.shape[1] + 2 and vary_alone(rows)


def choose_model(joint: Joint, folds: np.ndarray) -> tuple[Fit, ...]:
    """The fits of all models, the best first, the even density last.

    Best is the likeliest model within `NEAR` of the held-out vehicles in every parameter. If there
    is none, it is the nearest one.

    joint: over the events, of any kind and bandwidth.
    folds: of each event, (n,).
    """
    fits = [
        _fit(replace(joint, kind=kind, bandwidth=bandwidth), folds)
        for bandwidth in (None, *FACTORS)
        for kind in get_args(JointKind)
    ]
    # by the largest distance of a parameter, all within `NEAR` alike; then by the likelihood
    fits.sort(key=lambda fit: (max(*fit.kolmogorov.values(), NEAR), -fit.log_likelihood))
    return (*fits, Fit("even", -math.log(np.prod(np.subtract(joint.high, joint.low))), {}))


def _fit(joint: Joint, folds: np.ndarray) -> Fit:
    """Fit a model to its events without each fold in turn, and compare it with that fold."""
    rows = np.array(joint.events)
    logs, shares = [], []
    for fold in range(FOLDS):
        train, test = rows[folds != fold], rows[folds == fold]
        # with the folds of `folds_of`, at least one leaves events that have a fit
        if len(test) and _has_fit(train):
            fitted = replace(joint, events=_tuples(train))
            logs.append(np.log(np.maximum(fitted.density(test) / fitted.mass(), 1e-300)))
            shares.append(marginal_shares(fitted, test))
    columns = zip(joint.names, np.concatenate(shares).T, strict=True)
    distances = {name: kolmogorov(column) for name, column in columns}
    model = joint.kind if joint.bandwidth is None else f"{joint.kind} {joint.bandwidth:g}"
    return Fit(model, np.concatenate(logs).mean(), distances, joint)


def marginal_shares(joint: Joint, points: FloatArray) -> FloatArray:
    """Distribution function of each parameter alone at points (n, k), from draws within the box."""
    stream = random_stream(0, "marginals", len(joint.events))
    drawn = np.sort(joint.draw(MARGINAL_DRAWS, stream), axis=0)
    columns = zip(drawn.T, points.T, strict=True)
    return np.column_stack([np.searchsorted(own, at) / len(drawn) for own, at in columns])


# --- replay ---------------------------------------------------------------------------------------


def replay_errors(
    logical: LogicalScenario, class_: str, rows: FloatArray, motions: Sequence[Motion]
) -> FloatArray:
    """Errors of the actor's motion in the file against its recorded motion, for each event.

    Root mean square distances, m: along the road, across it and together, (n, 3).

    class_: of the encounters.
    rows: parameters of the events, (n, k).
    motions: recorded motion of the actor in each event.
    """
    scene = SCENES[class_]
    squares = (
        _replay_squares(logical.placed(logical.point(row)), scene, motion)
        for row, motion in zip(rows.tolist(), motions, strict=True)
    )
    return np.sqrt([(along, across, along + across) for along, across in squares])


def _replay_squares(
    concrete: ConcreteScenario, scene: EncounterScene, motion: Motion
) -> tuple[float, float]:
    """Mean squares, m2, of an event's distances along the road and across it.

    Along the road, the gaps between the bodies of ego and actor are compared, because recorded
    lengths differ from those of the file.

    concrete: the event by the file.
    motion: the recorded one.
    """
    number = [actor.name for actor in scene.actors].index(scene.replayed)
    body = CAR_LENGTH, EGO_WIDTH
    until = max(motion.time[-1], STEP)
    # (steps, columns), a row each `STEP`; the first columns are x and y
    driven = tracks([concrete], [body], STEP, until).others[0, number]
    clock = np.arange(len(driven)) * STEP
    side = -1.0 if scene.behind else 1.0  # the actor is behind the ego, or ahead of it
    x = driven[:, 0] - concrete.ego.x - side * CAR_LENGTH
    y = driven[:, 1] - scene.level * concrete.road.lane_width
    along = np.interp(motion.time, clock, x) - (motion.x - side * motion.bodies)
    across = np.interp(motion.time, clock, y) - motion.y
    return np.mean(along**2), np.mean(across**2)
