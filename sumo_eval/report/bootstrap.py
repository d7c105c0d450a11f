"""Paired bootstrap: how far C, D, S and the collision probability would move with other concrete scenarios.

A resample draws concrete scenarios with replacement and takes from both runs what they did there, so what both have in
common cancels. Whether D exists is a fact of the whole run (step 3 of the method) and is not drawn again.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sumo_eval.scoring.case_terms import CaseTerms, point_values, scores_of
from sumo_eval.settings import MethodSettings
from sumo_eval.trajectory import FloatArray

BLOCK = 1_000_000  # counts drawn at once
COMPARED = {
    "A": "avoided_share",
    "regret": "regret",
    "H": "human_likeness",
    "S+": "s_plus",
    "C": "c",
    "D": "d",
    "S": "s",
    "collision_probability": "collision_probability",
}
"""What two runs are compared by, and its name among the scores."""


def quantities(terms: CaseTerms, counts: FloatArray, method: MethodSettings) -> dict[str, FloatArray | None]:
    """C, D, S and the collision probability, (m,) each, for m resamples. counts: how often each case is drawn, (m, n).

    None where a quantity does not exist. All ones gives the printed values.
    """
    printed, found = point_values(terms, method), scores_of(terms, counts, method)
    return {name: None if printed[score] is None else found[score] for name, score in COMPARED.items()}


def paired_differences(
    base: CaseTerms,
    new: CaseTerms,
    base_method: MethodSettings,
    new_method: MethodSettings,
    *,
    resamples: int,
    seed: int,
) -> dict[str, FloatArray]:
    """New minus base of every quantity that both have, one value a resample in which both exist."""
    found: dict[str, list[FloatArray]] = {}
    for counts in _draws(len(base.collided), resamples, seed):
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
