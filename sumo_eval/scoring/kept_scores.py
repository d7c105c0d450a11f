"""The scores of a run and its rows of cases, as the cache (`kept.sqlite`) in the run's folder keeps
them.

Each scoring has a key, a hash of all that it depends on. Under it stand the scores (table
`evaluation`) and, part by part, the columns of the rows (table `rows`).

Users: `evaluation.py`, `scoring/steps.py`. Free to change: everything, since a change of this code
changes the keys; old parts are then computed again.
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

# bytes of rows that are kept for other settings, 256 MiB; beyond this the oldest are deleted
_MOST_OF_OTHERS = 256 << 20
_in_use: set[bytes] = set()  # keys of scores that this process has returned to a caller


@frozen
class KeptChunk:
    """Some rows of one ADS in one scenario, which are kept together.

    rows: number of rows.
    place: number of this chunk among all chunks of a scoring.
    """

    scenario: str
    ads: str
    rows: int
    place: int


@frozen
class Scores:
    """Results of scoring a run, without its rows.

    chunks: where the rows are kept, in the order of the scores.
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


class KeptScoring:
    """The scores and rows of one scoring in the cache.

    cache: of the run's folder.
    key: of the scoring.
    """

    def __init__(self, cache: KeptResults, key: bytes) -> None:
        self._cache, self._key = cache, key
        self._chunks: list[KeptChunk] = []  # of the rows that `add` has written

    def table(self, chunks: Sequence[KeptChunk]) -> CaseTable:
        """The rows in these chunks. Each column is read from the run's folder at its first use."""
        return CaseTable(
            (
                Chunk(chunk.scenario, chunk.ads, chunk.rows, partial(self._columns, chunk.place))
                for chunk in chunks
            ),
            key=self._key,
        )

    def _columns(self, place: int, places: slice) -> list[bytes]:
        """Some columns of a chunk, encoded.

        place: number of the chunk.
        places: numbers of the columns.

        Raises InputError if the cache does not have them any more.
        """
        first = place * COLUMNS  # the parts of a scoring: column after column of each chunk
        data = self._cache.some("rows", self._key, first + (places.start or 0), first + places.stop)
        if not data:
            raise InputError(f"Rows of {self._cache.path} are missing: score the run again.")
        return data

    def add(self, rows: Sequence[CaseResult]) -> None:
        """Write rows of one ADS in one scenario, after its earlier rows."""
        if rows:
            chunk = KeptChunk(rows[0].scenario, rows[0].ads, len(rows), len(self._chunks))
            self._cache.put(
                ("rows", self._key, place, data)
                for place, data in enumerate(encode_rows(rows), chunk.place * COLUMNS)
            )
            self._chunks.append(chunk)

    def rows(self, ads: str, scenario: str) -> CaseTable:
        """All rows of one ADS in one scenario so far."""
        return self.table(self._chunks).part(scenario, ads)

    def chunks(self, order: Sequence[tuple[str, str]]) -> tuple[KeptChunk, ...]:
        """All chunks, sorted by an order of (ADS, scenario)."""
        return tuple(
            chunk for pair in order for chunk in self._chunks if (chunk.ads, chunk.scenario) == pair
        )

    def scores(self) -> Scores | None:
        """The scores; None if the cache does not have them."""
        data = self._cache.get("evaluation", self._key)
        if data is None:
            return None
        _in_use.add(self._key)
        scores: Scores = decoded(data, _RECORDS)
        return scores

    def keep(self, scores: Scores) -> Scores:
        """Write scores whose rows are in the cache already, and return them as `scores` will.

        If the rows of other settings take more than `_MOST_OF_OTHERS`, the oldest of them are
        deleted.
        """
        self._cache.put([("evaluation", self._key, 0, encoded(scores))])
        stored = self.scores()
        assert stored is not None, "it was put there just now"
        # (key, size) of other settings, the newest first; `total`: the sum of sizes so far
        others = [pair for pair in reversed(self._cache.sizes("rows")) if pair[0] not in _in_use]
        pairs = zip(others, itertools.accumulate(size for _, size in others), strict=True)
        self._cache.forget([other for (other, _), total in pairs if total > _MOST_OF_OTHERS])
        return stored
