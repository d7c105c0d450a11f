"""Human band of a concrete scenario: each driver's D_i against all other drivers, the yardstick
beside every D_i of an ADS.
"""

from __future__ import annotations

from collections.abc import Sequence

from sumo_eval.method.anthropomorphic import Pairing
from sumo_eval.settings import AnthropomorphicSettings


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
