"""The scores of a run as its folder keeps them, and rows of cases as they are put there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass

from sumo_eval import results
from sumo_eval.record.coded import decoded, encoded
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.results import CaseResult, Ranking, ScenarioResult, ZoneResult
from sumo_eval.scoring.kept_rows import Chunk, KeptRows, encode_rows
from sumo_eval.trajectory import Alone

_MOST_OF_OTHERS = 256 << 20  # bytes of rows that other settings than the last gave, before the oldest go
_in_use: set[bytes] = set()  # keys of scores that this process has handed out


@dataclass(frozen=True, slots=True)
class Scores:
    """What scoring a run gives besides its rows. chunks: where these are."""

    zones: tuple[ZoneResult, ...]
    scores: tuple[ScenarioResult, ...]
    ranking: Ranking
    chunks: tuple[Chunk, ...]


_RECORDS: dict[str, type] = {
    one.__name__: one
    for one in (*vars(results).values(), Alone, Chunk, Scores)
    if isinstance(one, type) and is_dataclass(one)
}


class RowWriter:
    """Takes in the rows of a scoring, some at a time, and gives them back when asked."""

    def __init__(self, kept: KeptResults, key: bytes) -> None:
        self._kept, self._key = kept, key
        self._chunks: list[Chunk] = []

    def add(self, scenario: str, ads: str, rows: Sequence[CaseResult]) -> None:
        """Keep rows of one ADS in one scenario, after those of it that are there."""
        if rows:
            chunk = Chunk(scenario, ads, len(self._chunks), len(rows))
            self._kept.put([("rows", self._key, chunk.place, encode_rows(rows))])
            self._chunks.append(chunk)

    def rows(self, ads: str, scenario: str) -> KeptRows:
        """All rows of one ADS in one scenario so far."""
        return KeptRows(self._kept, self._key, self._chunks).part(ads, scenario)

    def chunks(self, order: Sequence[tuple[str, str]]) -> tuple[Chunk, ...]:
        """Where the rows are, ADSs and scenarios in this order of (ADS, scenario)."""
        return tuple(chunk for pair in order for chunk in self._chunks if (chunk.ads, chunk.scenario) == pair)


def kept_scores(kept: KeptResults, key: bytes) -> Scores | None:
    """The scores under a key; None where they are not kept."""
    data = kept.get("evaluation", key)
    if data is None:
        return None
    _in_use.add(key)
    found: Scores = decoded(data, _RECORDS)
    return found


def keep_scores(kept: KeptResults, key: bytes, scores: Scores) -> Scores:
    """Put scores whose rows are there, and take the oldest of other settings out where they take much room.

    What comes back is what whoever asks later gets.
    """
    kept.put([("evaluation", key, 0, encoded(scores))])
    _in_use.add(key)
    others = [(other, size) for other, size in kept.sizes("rows") if other not in _in_use]
    room, gone = _MOST_OF_OTHERS, []
    for other, size in reversed(others):
        room -= size
        if room < 0:
            gone.append(other)
    kept.forget(gone)
    found = kept_scores(kept, key)
    assert found is not None, "it was put there just now"
    return found
