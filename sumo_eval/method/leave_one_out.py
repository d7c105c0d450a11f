"""Human band of a concrete scenario: each driver's D_i against all other drivers, the yardstick
beside every D_i of an ADS.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.method.anthropomorphic import AnthropomorphicIndex, Pairing
from sumo_eval.settings import AnthropomorphicSettings


@dataclass(frozen=True, slots=True)
class HumanBand:
    """Scores of the drivers of one concrete scenario among themselves.

    values: D_i of each driver against all other drivers, in the order of the drivers.
    similarities: its third factor alone.
    """

    values: tuple[float, ...]
    similarities: tuple[float, ...]

    @property
    def low(self) -> float:
        """The least of the values."""
        return min(self.values)

    @property
    def mean(self) -> float:
        """The mean of the values."""
        return float(np.mean(self.values))

    @property
    def high(self) -> float:
        """The largest of the values."""
        return max(self.values)


def _spacing(settings: AnthropomorphicSettings) -> float:
    """Distance between slices where drivers are scored against each other, or left out, m."""
    return max(settings.slice_spacing, settings.band_slice_spacing)


def _all_but_one(places: Sequence[int]) -> list[tuple[int, ...]]:
    """The places without each of them."""
    return [tuple(place for place in places if place != without) for without in places]


def band_pairings(drivers: Sequence[int], settings: AnthropomorphicSettings) -> list[Pairing]:
    """Each driver against all other drivers."""
    others = zip(drivers, _all_but_one(drivers), strict=True)
    return [Pairing(driver, rest, _spacing(settings)) for driver, rest in others]


def band_of(indexes: Sequence[AnthropomorphicIndex]) -> HumanBand:
    """The band of the indexes of `band_pairings`."""
    return HumanBand(
        tuple(index.value for index in indexes), tuple(index.similarity for index in indexes)
    )


def left_out_pairings(
    ads: int,
    drivers: Sequence[int],
    exchanges: Sequence[tuple[int, int]],
    settings: AnthropomorphicSettings,
) -> list[Pairing]:
    """An ADS against all drivers and, if that leaves two, against all but one, for each, then with
    one driver counted twice instead of another, for each exchange: the effect of the choice of
    drivers on its D_i and its human-likeness.

    ads: its place.
    drivers: their places.
    exchanges: places among `drivers` of the one left out and of the one that counts twice.
    settings: `[method.anthropomorphic]`.
    """
    sets = [tuple(drivers)]
    if len(drivers) > 2:
        fewer = _all_but_one(drivers)
        exchanged = [tuple(sorted((*fewer[out], drivers[twice]))) for out, twice in exchanges]
        sets += fewer + exchanged
    return [Pairing(ads, others, _spacing(settings), likeness=True) for others in sets]
