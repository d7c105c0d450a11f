"""Paired bootstrap: how far C, D, S and the collision probability would move with other concrete scenarios.

A resample draws concrete scenarios with replacement and takes from both runs what they did there, so what both have in
common cancels. Whether D exists is a fact of the whole run (step 3 of the method) and is not drawn again.

Of more than `MOST_DRAWN` scenarios `BLOCKS` blocks are drawn in place of single ones, each of as many scenarios (or one
more), put together by chance: a mean has the same variance then, known by B - 1 degrees of freedom for B blocks in
place of n - 1 (2,000 blocks: 1.6 % of the half-width, as much as 2,000 resamples leave open themselves), and a resample
costs B numbers in place of n.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sumo_eval.method.score_terms import Counts
from sumo_eval.scoring.case_terms import CaseTerms, point_values, scores_of
from sumo_eval.settings import MethodSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

IntArray = NDArray[np.intp]
BLOCK = 1_000_000  # counts drawn at once
BLOCK_OF_BLOCKS = 4_000_000  # drawn at once of blocks: for each such part, terms are summed over blocks anew
MOST_DRAWN = 10_000  # scenarios that a resample is drawn from one by one
BLOCKS = 2_000  # that more scenarios are put together to
COMPARED = {
    "T": "task_share",
    "A": "avoided_share",
    "A'": "avoidance_grade",
    "regret": "regret",
    "H": "human_likeness",
    "S+": "s_plus",
    "C": "c",
    "D": "d",
    "S": "s",
    "collision_probability": "collision_probability",
}
"""What two runs are compared by, and its name among the scores."""


@dataclass(frozen=True, slots=True, eq=False)
class CountsOfBlocks:
    """How often each of n scenarios stands in each of m resamples, (m, n), where whole blocks of them are drawn.

    drawn: how often each block is, (m, b). order: the scenarios by block, (n,); starts: where each block begins, (b,).
    """

    drawn: FloatArray
    order: IntArray
    starts: IntArray

    def __matmul__(self, terms: FloatArray, /) -> FloatArray:
        """Sums of terms (n,) in every resample, (m,)."""
        return np.asarray(self.drawn @ np.add.reduceat(terms[self.order], self.starts))


def blocks_of(n: int, seed: int) -> tuple[IntArray, IntArray]:
    """Scenarios in an order drawn by chance, and where each of `BLOCKS` blocks of them begins."""
    order = random_stream(seed, "blocks of scenarios").permutation(n)
    return order, np.arange(BLOCKS) * n // BLOCKS


def quantities(terms: CaseTerms, counts: Counts, method: MethodSettings) -> dict[str, FloatArray | None]:
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
    shuffled = None if len(base.collided) <= MOST_DRAWN else blocks_of(len(base.collided), seed)
    number, at_once = (len(base.collided), BLOCK) if shuffled is None else (BLOCKS, BLOCK_OF_BLOCKS)
    for drawn in _draws(number, resamples, seed, at_once):
        counts = drawn if shuffled is None else CountsOfBlocks(drawn, *shuffled)
        before, after = quantities(base, counts, base_method), quantities(new, counts, new_method)
        for name, then in before.items():
            now = after[name]
            if then is not None and now is not None:
                found.setdefault(name, []).append(now - then)
    joined = {name: np.concatenate(parts) for name, parts in found.items()}
    return {name: values[np.isfinite(values)] for name, values in joined.items()}


def _draws(n: int, resamples: int, seed: int, at_once: int) -> Iterator[FloatArray]:
    rng = np.random.default_rng(seed)
    rows = max(1, at_once // max(n, 1))
    for start in range(0, resamples, rows):
        yield rng.multinomial(n, np.full(n, 1.0 / n), size=min(rows, resamples - start)).astype(float)
