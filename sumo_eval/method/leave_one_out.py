"""Comparisons behind the human band of a concrete scenario (each driver's D_i against all other
drivers) and behind the effect of the choice of drivers on an ADS's D_i.

`record.human_reference` computes them.
"""

from __future__ import annotations

from collections.abc import Sequence

from sumo_eval.method.anthropomorphic import Pairing
from sumo_eval.settings import AnthropomorphicSettings


def _spacing(settings: AnthropomorphicSettings) -> float:
    """Distance between slices where drivers are scored against each other, or left out, m."""
    return max(settings.slice_spacing, settings.band_slice_spacing)


def _all_but_one(places: Sequence[int]) -> list[tuple[int, ...]]:
    """For each place, all other places."""
    return [tuple(index for index in places if index != without) for without in places]


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
    """An ADS against all drivers. With more than two, also against all but one, for each driver,
    and then with one driver counted twice instead of another, for each exchange.

    ads: index of its trajectory.
    drivers: indices of theirs.
    exchanges: pairs of positions in `drivers`: of the one left out, of the one that counts twice.
    settings: `[method.anthropomorphic]`.

    This measures the effect of the choice of drivers on the D_i and the human-likeness of the ADS.
    """
    sets = [tuple(drivers)]
    if len(drivers) > 2:
        fewer = _all_but_one(drivers)
        sets += fewer
        sets += [tuple(sorted((*fewer[out], drivers[twice]))) for out, twice in exchanges]
    return [Pairing(ads, members, _spacing(settings), likeness=True) for members in sets]
