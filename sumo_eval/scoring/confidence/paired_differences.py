"""Paired bootstrap: how far the differences between two runs' scores would move with other concrete
scenarios.

A replicate draws concrete scenarios with replacement, and takes the cases of both runs there. So
their common part cancels. A replicate has a D if the whole run has one (step 3 of the method).

More than `MOST_DRAWN` concrete scenarios are put together in `BLOCKS` random blocks, and blocks are
drawn instead. The variance of a mean stays the same.

Users: `scoring/comparison.py`.
"""

import numpy as np

from sumo_eval.method.score_terms import AskedTerms, KnownSums
from sumo_eval.scoring.case_terms import SCORES, CaseTerms, ScoreSamples, scores_of
from sumo_eval.scoring.confidence.resamples import one_list, resamples
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

MOST_DRAWN, BLOCKS = 10_000, 2_000  # concrete scenarios, blocks
COMPARED = {name: field for name, (field, _) in SCORES.items()} | {
    "collision_probability": "collision_probability"
}
"""Quantity by which two runs are compared -> field of ScenarioResult."""


def paired_differences(base: CaseTerms, new: CaseTerms, replicates: int, seed: int) -> ScoreSamples:
    """Quantity of `COMPARED` -> new minus base, a value for each replicate in which both exist.

    base, new: terms of the cases at the same points, in the same order.
    replicates: number of replicates.
    """
    runs = base, new
    tables = [_summed_terms(run, seed) for run in runs]
    sums = [np.zeros((replicates, table.shape[1])) for table in tables]
    for part in resamples(one_list(len(tables[0])), replicates, seed, ("comparison",)):
        for total, table in zip(sums, tables, strict=True):
            total += part.counts @ table[part.places]

    # scores from known sums: `slice(0, 0)`, because no case is read
    before, after = (
        scores_of(run, KnownSums(total.T), rows=slice(0, 0))
        for total, run in zip(sums, runs, strict=True)
    )
    changes = {name: after[score] - before[score] for name, score in COMPARED.items()}
    return {name: change[np.isfinite(change)] for name, change in changes.items()}


def _summed_terms(terms: CaseTerms, seed: int) -> FloatArray:
    """The k terms that the scores of a run sum, of each case, (n, k); sums over blocks if there are
    more than `MOST_DRAWN` cases, (BLOCKS, k).
    """
    asked, n = AskedTerms(), len(terms.collided)
    scores_of(terms, asked)
    if n <= MOST_DRAWN:
        return np.column_stack(asked.terms)
    order = random_stream(seed, "blocks of scenarios").permutation(n)
    starts = np.arange(BLOCKS) * n // BLOCKS
    return np.column_stack([np.add.reduceat(term[order], starts) for term in asked.terms])
