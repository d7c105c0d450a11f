"""Paired bootstrap: how far C, D, S and the collision probability would move with other concrete scenarios.

A resample draws concrete scenarios with replacement and takes from both runs what they did there, so what both have in
common cancels. Whether D exists is a fact of the whole run (step 3 of the method) and is not drawn again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.report.words import avoided_share
from sumo_eval.results import CaseResult
from sumo_eval.settings import MethodSettings
from sumo_eval.trajectory import BoolArray, FloatArray

BLOCK = 1_000_000  # counts drawn at once


@dataclass(frozen=True, slots=True, eq=False)
class Cases:
    """The cases of one ADS in one logical scenario as arrays (n,), 0 where a case has no part in a mean.

    weight, avoided: r and Ug/U of collisions that have both (`compared`). hit, judged: collided, evaluated.
    exposure: p. index: D_i of the safe cases that have one (`indexed`). has_c, has_d: whether C, D exist at all.
    """

    weight: FloatArray
    avoided: FloatArray
    compared: BoolArray
    hit: BoolArray
    judged: BoolArray
    exposure: FloatArray
    index: FloatArray
    indexed: BoolArray
    has_c: bool
    has_d: bool


def as_arrays(cases: Sequence[CaseResult], method: MethodSettings) -> Cases:
    """The cases in the order they are given."""
    hit = np.array([case.collided for case in cases])
    judged = np.array([case.evaluated for case in cases])
    ratios = [avoided_share(case, method.collision.loss) if case.collided else None for case in cases]
    compared = np.array(
        [ratio is not None and case.weight is not None for ratio, case in zip(ratios, cases, strict=True)]
    )
    safe = np.array([case.zone == "safe" for case in cases])
    safe_hit = bool(np.any(safe & hit))
    indexed = safe & np.array([case.index is not None for case in cases])
    return Cases(
        weight=np.array([case.weight or 0.0 for case in cases]),
        avoided=np.array([ratio or 0.0 for ratio in ratios]),
        compared=compared,
        hit=hit,
        judged=judged,
        exposure=np.array([case.exposure for case in cases]),
        index=np.array([case.index or 0.0 for case in cases]),
        indexed=indexed,
        has_c=bool(compared.any() or (judged.any() and not hit.any())),
        has_d=bool(indexed.any() and not safe_hit),
    )


def quantities(cases: Cases, counts: FloatArray, method: MethodSettings) -> dict[str, FloatArray | None]:
    """C, D, S and the collision probability, (m,) each, for m resamples. counts: how often each case is drawn, (m, n).

    None where a quantity does not exist. All ones gives the printed values.
    """
    c = _collision_index(cases, counts) if cases.has_c else None
    d = _mean(counts, cases.exposure * cases.indexed, cases.index, empty=np.nan) if cases.has_d else None
    terms = method.score
    zero = np.zeros(len(counts))
    s = terms.a * terms.k5 * (zero if c is None else c) + terms.b * terms.k6 * (zero if d is None else d)
    risk = _mean(counts, cases.exposure * cases.judged, cases.hit.astype(float), empty=np.nan)
    return {"S": s, "C": c, "D": d, "collision_probability": risk if cases.judged.any() else None}


def _collision_index(cases: Cases, counts: FloatArray) -> FloatArray:
    """Eq. 17 of each resample: the plain mean where all weights are 0, 1 without a collision."""
    plain = _mean(counts, cases.compared.astype(float), cases.avoided, empty=1.0)
    weighted = _mean(counts, cases.compared * cases.weight, cases.avoided, empty=np.nan)
    return np.where(np.isnan(weighted), plain, weighted)


def _mean(counts: FloatArray, weight: FloatArray, values: FloatArray, *, empty: float) -> FloatArray:
    total = counts @ weight
    mean: FloatArray = np.divide(counts @ (weight * values), total, out=np.full(total.shape, empty), where=total > 0.0)
    return mean


def paired_differences(
    base: Cases, new: Cases, base_method: MethodSettings, new_method: MethodSettings, *, resamples: int, seed: int
) -> dict[str, FloatArray]:
    """New minus base of every quantity that both have, one value a resample in which both exist."""
    found: dict[str, list[FloatArray]] = {}
    for counts in _draws(len(base.hit), resamples, seed):
        before, after = quantities(base, counts, base_method), quantities(new, counts, new_method)
        for name, then in before.items():
            now = after[name]
            if then is not None and now is not None:
                found.setdefault(name, []).append(now - then)
    joined = {name: np.concatenate(parts) for name, parts in found.items()}
    return {name: values[np.isfinite(values)] for name, values in joined.items()}


def _draws(n: int, resamples: int, seed: int) -> Iterator[FloatArray]:
    rng = np.random.default_rng(seed)
    rows = max(1, BLOCK // max(n, 1))
    for start in range(0, resamples, rows):
        yield rng.multinomial(n, np.full(n, 1.0 / n), size=min(rows, resamples - start)).astype(float)
