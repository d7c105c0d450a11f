"""The scores of a run and its rows of cases, as the cache in the run's folder keeps them.

Users: `evaluation.py`, `scoring/steps.py`.
"""

import itertools
from collections.abc import Sequence
from dataclasses import is_dataclass
from functools import partial

from sumo_eval import results, score_notes
from sumo_eval.case_table import COLUMNS, CaseTable, Chunk, encode_rows
from sumo_eval.cases import CaseResult
from sumo_eval.coded import decoded, encoded
from sumo_eval.errors import InputError
from sumo_eval.frozen import frozen
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.results import Ranking, ScenarioResult, ZoneResult

# bytes of rows that are kept for earlier settings; beyond this the oldest are deleted
_MOST_OF_OTHERS = 256 << 20
_in_use: set[bytes] = set()  # keys of scores that this process has handed out


@frozen
class KeptChunk:
    """Rows of one ADS in one scenario that are kept together.

    rows: their number.
    place: number of this chunk among all chunks of a scoring.
    """

    scenario: str
    ads: str
    rows: int
    place: int


@frozen
class Scores:
    """Results of scoring a run other than its rows.

    chunks: where the rows are.
    """

    zones: tuple[ZoneResult, ...]
    scores: tuple[ScenarioResult, ...]
    ranking: Ranking | None
    chunks: tuple[KeptChunk, ...]


_RECORDS: dict[str, type] = {
    kind.__name__: kind
    for kind in (*vars(results).values(), *vars(score_notes).values(), KeptChunk, Scores)
    if isinstance(kind, type) and is_dataclass(kind)
}


def table_of(cache: KeptResults, key: bytes, chunks: Sequence[KeptChunk]) -> CaseTable:
    """The rows of a scoring, each column read from the run's folder when it is asked for."""
    return CaseTable(
        (
            Chunk(chunk.scenario, chunk.ads, chunk.rows, partial(_columns, cache, key, chunk.place))
            for chunk in chunks
        ),
        key=key,
    )


def _columns(cache: KeptResults, key: bytes, place: int, places: slice) -> list[bytes]:
    first = place * COLUMNS  # each chunk has a part for each column
    data = cache.some("rows", key, first + (places.start or 0), first + places.stop)
    if not data:
        raise InputError(f"Rows of {cache.path} are missing: score the run again.")
    return data


class RowWriter:
    """Takes in the rows of a scoring, some at a time, and gives them back when asked."""

    def __init__(self, cache: KeptResults, key: bytes) -> None:
        self._cache, self._key = cache, key
        self._chunks: list[KeptChunk] = []

    def add(self, rows: Sequence[CaseResult]) -> None:
        """Keep rows of one ADS in one scenario, after the rows of it that are kept already."""
        if rows:
            chunk = KeptChunk(rows[0].scenario, rows[0].ads, len(rows), len(self._chunks))
            self._cache.put(
                ("rows", self._key, place, data)
                for place, data in enumerate(encode_rows(rows), chunk.place * COLUMNS)
            )
            self._chunks.append(chunk)

    def rows(self, ads: str, scenario: str) -> CaseTable:
        """All rows of one ADS in one scenario so far."""
        return table_of(self._cache, self._key, self._chunks).part(scenario, ads)

    def chunks(self, order: Sequence[tuple[str, str]]) -> tuple[KeptChunk, ...]:
        """Chunks of the rows, in this order of (ADS, scenario)."""
        return tuple(
            chunk for pair in order for chunk in self._chunks if (chunk.ads, chunk.scenario) == pair
        )


def kept_scores(cache: KeptResults, key: bytes) -> Scores | None:
    """The scores under a key; None where they are not kept."""
    data = cache.get("evaluation", key)
    if data is None:
        return None
    _in_use.add(key)
    scores: Scores = decoded(data, _RECORDS)
    return scores


def keep_scores(cache: KeptResults, key: bytes, scores: Scores) -> Scores:
    """Keep scores whose rows are kept already, and return them as `kept_scores` will.

    Deletes the oldest rows of other settings where all of these take more than `_MOST_OF_OTHERS`.
    """
    cache.put([("evaluation", key, 0, encoded(scores))])
    _in_use.add(key)
    # the newest first, each with the sum of sizes so far
    others = [pair for pair in reversed(cache.sizes("rows")) if pair[0] not in _in_use]
    pairs = zip(others, itertools.accumulate(size for _, size in others), strict=True)
    cache.forget([other for (other, _), total in pairs if total > _MOST_OF_OTHERS])
    stored = kept_scores(cache, key)
    assert stored is not None, "it was put there just now"
    return stored
