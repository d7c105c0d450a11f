"""The choice of the points of a space that become concrete scenarios, by a method of `sampling`.

Every method is a function of a space and a `Request` that returns a `Drawn`. The points that the
constraints exclude are separated here, for all methods. Random methods draw from a named stream of
the evaluation's seed. Names of methods are public; a method that draws other points than before
changes every user's results.

Users: `cli/space.py`, `record/`, `report/points_page.py`, `scenario/file.py`, `scoring/`,
`extras/bench/costs.py`, `extras/rates/recorded_scene.py`, `extras/wheel/trip.py`.
"""

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

import numpy as np

from sumo_eval.errors import InputError, SumoEvalError, check_known, must_be, users_code
from sumo_eval.frozen import frozen
from sumo_eval.scenario.formats import formats
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.adaptive import adaptive
from sumo_eval.scenario.sampling.combinations import combinations
from sumo_eval.scenario.sampling.drawn_points import by_exposure, by_exposure_and_danger, sequence
from sumo_eval.scenario.sampling.grid import full_grid
from sumo_eval.scenario.sampling.listed_points import check_on_axes, from_csv, from_function
from sumo_eval.scenario.sampling.request import Drawn, Levels, Request, Steps, owner_of
from sumo_eval.text import capitalised, point_words
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray


@frozen(eq=False)
class Sample:
    """Chosen points of a space, a row each, columns in the order of `LogicalScenario.parameters`.

    points: (n, k), those that satisfy all constraints.
    refused: (m, k), those that do not.
    exposure: how much each point counts, up to a factor, (n,): the scenario's exposure, divided by
        the density of the method's choice, which is 1 everywhere for an even method.
    notes: as in `Drawn`.
    method: name of the method.
    stands_for, stratum: as in `Drawn`.
    """

    points: FloatArray
    refused: FloatArray
    exposure: FloatArray
    notes: tuple[str, ...] = ()
    method: str = ""
    stands_for: FloatArray | None = None
    stratum: IntArray | None = None


def sample_of(points: FloatArray, method: str) -> Sample:
    """Points (n, k) as the sample of a method, none of them refused."""
    return Sample(points, points[:0], np.ones(len(points)), method=method)


Method = tuple[Callable[[LogicalScenario, Request], Drawn], frozenset[str]]
"""A way to choose points: its function, and the keys of a request that it takes."""
METHODS: Mapping[str, Method] = {
    "grid": (full_grid, frozenset({"levels", "steps"})),
    "pairwise": (combinations, frozenset({"levels", "steps"})),
    "combinations": (combinations, frozenset({"levels", "steps", "strength"})),
    **{
        name: (sequence(name), frozenset({"count"}))
        for name in ("latin_hypercube", "sobol", "halton")
    },
    "exposure": (by_exposure, frozenset({"count"})),
    "exposure_danger": (by_exposure_and_danger, frozenset({"count"})),
    "adaptive": (adaptive, frozenset({"count", "round", "aim", "until", "rounds"})),
    "file": (from_csv, frozenset({"file"})),
}
"""Methods by their name in an evaluation file."""


def all_methods() -> dict[str, Method]:
    """The methods of this package and of the installed formats."""
    return {
        **METHODS,
        **{name: method for form in formats() for name, method in form.samplings.items()},
    }


def sample(
    logical: LogicalScenario,
    method: str | None = None,
    levels: Levels = None,
    steps: Steps = None,
    *,
    request: Request | None = None,
) -> Sample:
    """Choose points of a space.

    method: a name in METHODS, the name of one of the scenario's own samples, or the locator of a
        function `(space, n, rng) -> points`. None: as `SamplingSettings.default_method` says.
    levels, steps: short for a request that has only these.
    Raises InputError for an unknown method, for a key that the method does not take, and if no
    point is possible.
    """
    request = request or Request(levels=levels, steps=steps)
    if method is None:
        method = request.default_method(logical.default_sample)
    drawn = _drawn(logical, method, request)
    feasible = logical.feasible(drawn.points)
    points, refused = drawn.points[feasible], drawn.points[~feasible]
    if not len(points):
        raise InputError(
            f"{capitalised(owner_of(logical))} must choose at least one possible point, got none."
            f"{_refusals(logical, refused)}"
        )
    exposure = _rows(drawn.exposure, feasible)
    if exposure is None:
        exposure = logical.exposures(points).astype(float)
    wrong = ~(np.isfinite(exposure) & (exposure >= 0.0))
    if wrong.any():  # the density of a distribution may be infinite at an end of its range
        got = f"{exposure[wrong][0]:g} at {point_words(logical.point(points[wrong][0]))}"
        raise must_be("The exposure", owner_of(logical), "finite and at least 0 at each point", got)
    stands_for, stratum = _rows(drawn.stands_for, feasible), _rows(drawn.stratum, feasible)
    return Sample(points, refused, exposure, drawn.notes, method, stands_for, stratum)


def _drawn(logical: LogicalScenario, method: str, request: Request) -> Drawn:
    """The points of a method, or of one of the scenario's own samples."""
    keys = request.given
    prescribed = {item.name: item for item in logical.samples}
    if method in prescribed:
        owner = f"sample `{method}` of scenario `{logical.name}`"
        if keys:
            raise InputError(
                f"{capitalised(owner)} is a list: it takes no "
                f"{', '.join(f'`{key}`' for key in sorted(keys))}."
            )
        points = np.array(prescribed[method].points, float)
        check_on_axes(logical, points, owner)
        return Drawn(points)
    choose, takes = _method(method, prescribed)
    for extra in sorted(keys - takes):
        raise InputError(
            f"`{extra}` of {owner_of(logical)} does nothing in method `{method}`, which takes "
            f"{', '.join(f'`{name}`' for name in sorted(takes))}."
        )
    # a method of another package may raise anything
    with users_code(f"Sampling method `{method}` failed", SumoEvalError):
        drawn = choose(logical, request)
        logical.feasible(drawn.points)  # for its error only, if these are no points
    return drawn


def _refusals(logical: LogicalScenario, refused: FloatArray) -> str:
    """Number of points (m, k) that each constraint excludes, as a sentence."""
    values = logical.columns(refused)
    counts = {rule.about: np.sum(~rule.holds(values)) for rule in logical.constraints}
    by = [
        f"{count} {'is' if count == 1 else 'are'} not `{about}`"
        for about, count in counts.items()
        if count
    ]
    points = "1 point" if len(refused) == 1 else f"{len(refused)} points"
    return f" Of {points}, {', '.join(by)}."


def _rows(values: Any, chosen: BoolArray) -> Any:
    """The chosen rows of an array; None if there is no array."""
    return None if values is None else values[chosen]


def _method(name: str, prescribed: Collection[str]) -> Method:
    """A method by its name or locator.

    prescribed: names of the scenario's own samples, for messages.
    """
    if ":" in name:
        return partial(from_function, locator=name), frozenset({"count"})
    methods = METHODS if name in METHODS else all_methods()
    check_known("sampling method", (*methods, *prescribed), name)
    return methods[name]


def central_point(logical: LogicalScenario) -> FloatArray:
    """The point (k,) of the space's default sample nearest to the centre of the unit box; of
    equals, the first.
    """
    points = sample(logical).points
    distance = np.linalg.norm(logical.to_unit(points) - 0.5, axis=-1)
    # rounded, so that the last bit of a machine does not decide between equally near points
    point: FloatArray = points[np.argmin(np.round(distance, 12))]
    return point
