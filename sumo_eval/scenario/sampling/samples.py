"""Points of a space that become concrete scenarios, those that were left out, and the weight of
each.

Every method is a function of a space and a `Request`; what the constraints exclude is taken out
here, for all of them, and kept as refused points. Random methods draw from a named stream of the
evaluation's seed.

Users: `cli/space.py`, `record/`, `report/points_page.py`, `scenario/file.py`, `scoring/`,
`extras/bench/costs.py`, `extras/wheel/trip.py`.
"""

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

import numpy as np

from sumo_eval.errors import InputError, SumoEvalError, check_known, users_code
from sumo_eval.frozen import frozen
from sumo_eval.scenario.formats import formats
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.adaptive import adaptive
from sumo_eval.scenario.sampling.combinations import combinations
from sumo_eval.scenario.sampling.drawn_points import by_exposure, by_exposure_and_danger, sequence
from sumo_eval.scenario.sampling.grid import full_grid
from sumo_eval.scenario.sampling.listed_points import from_csv, from_function
from sumo_eval.scenario.sampling.request import Drawn, Levels, Request, Steps, owner_of
from sumo_eval.text import capitalised
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray


@frozen(eq=False)
class Sample:
    """Chosen points of a space, one row each, columns in the order of `logical.parameters`.

    points: (n, k), those that exist.
    refused: (m, k), those that a constraint of the scenario rules out.
    exposure: (n,), how much each point counts, up to a factor: the scenario's exposure, divided by
        the density of the method's choice, which is 1 everywhere for an even method.
    notes: sentences about what the choice could not do as asked.
    method: its name.
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
"""Ways to choose points, by the name they have in an evaluation file, and the keys that each of
them takes."""


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
    levels, steps: the same as a request that has only these.
    Raises InputError for an unknown method, for a key that the method does not take, and for what
    makes no points.
    """
    request = request or Request(levels=levels, steps=steps)
    keys = request.given
    if method is None:
        method = request.default_method(logical.default_sample)
    prescribed = {item.name: item for item in logical.samples}
    if method in prescribed:
        if keys:
            raise InputError(
                f"Sample `{method}` of scenario `{logical.name}` is a list: it has no levels or "
                "steps."
            )
        drawn = Drawn(np.array(prescribed[method].points, float))
    else:
        choose, takes = _method(method, prescribed)
        for extra in sorted(keys - takes):
            raise InputError(
                f"`{extra}` of {owner_of(logical)} does nothing in method `{method}`, which takes "
                f"{', '.join(f'`{name}`' for name in sorted(takes))}."
            )
        # a method of another package may raise anything
        with users_code(f"Sampling method `{method}` failed", SumoEvalError):
            drawn = choose(logical, request)
            logical.feasible(drawn.points)  # raises where these are no points
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
    stands_for, stratum = _rows(drawn.stands_for, feasible), _rows(drawn.stratum, feasible)
    return Sample(points, refused, exposure, drawn.notes, method, stands_for, stratum)


def _refusals(logical: LogicalScenario, refused: FloatArray) -> str:
    """Number of points (m, k) that each constraint excludes, as a sentence."""
    values = logical.columns(refused)
    counts = {rule.about: np.sum(~rule.holds(values)) for rule in logical.constraints}
    by = [f"{count} are not `{about}`" for about, count in counts.items() if count]
    return f" Of {len(refused)} points, {', '.join(by)}."


def _rows(values: Any, chosen: BoolArray) -> Any:
    """The chosen rows of an array; None if there is no array."""
    return None if values is None else values[chosen]


def _method(name: str, prescribed: Collection[str]) -> Method:
    """The function of a method, and the keys that it takes."""
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
    # rounded, so that the last bit of a machine does not decide between points that are as near
    point: FloatArray = points[np.argmin(np.round(distance, 12))]
    return point
