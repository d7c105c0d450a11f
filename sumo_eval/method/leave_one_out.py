"""How human the humans are: each driver's D_i against the others, the yardstick beside every D_i of
an ADS.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.method.anthropomorphic import AnthropomorphicIndex, Pairing
from sumo_eval.settings import AnthropomorphicSettings


@dataclass(frozen=True, slots=True)
class HumanBand:
    """What the drivers of one concrete scenario score among themselves.

    values: D_i of each driver against all others, in the order of the drivers;
    similarities: its third factor alone. low, mean, high: least, mean and largest of the values.
    """

    values: tuple[float, ...]
    similarities: tuple[float, ...]

    @property
    def low(self) -> float:
        """The least human of the humans."""
        return min(self.values)

    @property
    def mean(self) -> float:
        """The mean human."""
        return float(np.mean(self.values))

    @property
    def high(self) -> float:
        """The most human of the humans."""
        return max(self.values)


def coarse_spacing(settings: AnthropomorphicSettings) -> float:
    """Distance between slices where drivers are scored against each other, or left out, m."""
    return max(settings.slice_spacing, settings.band_slice_spacing)


def band_pairings(drivers: Sequence[int], settings: AnthropomorphicSettings) -> list[Pairing]:
    """Each driver against all the others."""
    spacing = coarse_spacing(settings)
    return [
        Pairing(one, tuple(place for place in drivers if place != one), spacing) for one in drivers
    ]


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
    """An ADS against all drivers, and, if that leaves two, against all but one, for each, and then
    with one counted twice in the place of another, for each exchange: what the choice of drivers
    does to its D_i and to its human-likeness.

    exchanges: places among `drivers` of who is left out and of who counts twice.
    """
    spacing, sets = coarse_spacing(settings), [tuple(drivers)]
    if len(drivers) > 2:
        fewer = [tuple(place for place in drivers if place != one) for one in drivers]
        sets += fewer
        sets += [tuple(sorted((*fewer[leaves], drivers[stays]))) for leaves, stays in exchanges]
    return [Pairing(ads, others, spacing, likeness=True) for others in sets]
