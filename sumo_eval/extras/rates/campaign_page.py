"""Results of `sumo-eval campaign`: a page, JSON and sentences.

Users: `extras/rates/command.py`.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from sumo_eval.extras.rates.campaign import MILLION, AdsRate, Campaign, ScenarioRate
from sumo_eval.extras.rates.importance import DEFENSIVE
from sumo_eval.extras.rates.intervals import LEVEL, Limits
from sumo_eval.report.page import Json, write_json
from sumo_eval.report.study_page import (
    Fold,
    Piece,
    Table,
    Text,
    amount,
    interval,
    table,
    write_parts,
)
from sumo_eval.report.words import count

PAGE, PLAIN = "campaign.html", "campaign.json"
OUTSIDE = (
    "Outside these rates: driving between the encounters of these scenarios; other roads, weather "
    "and times of day than those recorded; road users of other sizes than the scenarios'; vehicles "
    "that react where the scenarios' follow their scripts; sensors that fail; and tails of the "
    "distributions, where encounters are rarer than the recordings show. These are rates in "
    "simulated encounters, not of accidents on the road."
)
BASIS = (
    "Intervals of ADSs' rates allow for the small number of drives. Where the recorded events are "
    "known, they also allow for their number: the rate of encounters and the distribution of "
    "points are resampled with them. They cover two forms of this distribution: one as wide as "
    "the events, and the driven one, which its kernels widen. Where the events are not known, the "
    "distribution is assumed to be right."
)

# the fields of `logical.Occurrence`, where the campaign file gives a rate instead of counted events
_AS_GIVEN = {"events": None, "vehicle_km": None, "where": "as given"}


def write_campaign(campaign: Campaign, folder: Path) -> tuple[Path, ...]:
    """Write `campaign.html` and `campaign.json` into a folder; return their paths."""
    content = plain(campaign)
    data = write_json(folder / PLAIN, content, "The campaign")
    page = write_parts(
        folder / PAGE,
        kicker="Crash rates",
        title=f"{campaign.settings.name}: collisions per million km",
        sentences=[],
        parts=parts(campaign, content),
    )
    return page, data


def plain(campaign: Campaign) -> Json:
    """All results in plain values, for `campaign.json` and the page."""
    return {
        "name": campaign.settings.name,
        "seed": campaign.settings.seed,
        "budget": campaign.settings.budget,
        "unit": "per million vehicle-km",
        "scenarios": [
            {
                "use": space.use, "name": space.logical.name, "per_vehicle_km": space.per_km,
                "per_vehicle_km_interval": space.interval,
                **(asdict(space.counted) if space.counted else _AS_GIVEN),
                "exposure": space.logical.exposure_about,
            }
            for space in campaign.spaces
        ],
        "ads": [
            {
                "name": rate.ads, "controller": rate.controller, **_plain_rates(rate),
                # of collisions, valid wherever in the spaces of the scenarios they lie
                "upper_limit_whatever_collides": rate.limit,
                "by_scenario": [_plain_part(part, rate.collisions[0]) for part in rate.parts],
            }
            for rate in campaign.rates
        ],
        "people": [{"where": where, "vehicle_km": km, "collisions": 0, "upper_limit": limit}
                   for where, km, limit in _recorded_drivers(campaign)],
    }  # fmt: skip


def _plain_rates(rate: AdsRate | ScenarioRate) -> Json:
    """Both rates per million km, with their limits."""
    return {
        "collisions": rate.collisions[0],
        "collisions_interval": rate.collisions[1:],
        "loss": rate.loss[0],
        "loss_interval": rate.loss[1:],
    }


def _plain_part(part: ScenarioRate, total: float) -> Json:
    """Results of one ADS in one scenario.

    total: collisions of the ADS in all scenarios, per million km.
    """
    estimate = part.estimate
    return {
        "scenario": part.space.logical.name,
        **_plain_rates(part),
        "share_of_collisions": part.collisions[0] / total if total > 0.0 else None,
        "collision_probability": estimate.probability[0],
        "collision_probability_interval": estimate.probability[1:],
        # all drives: the first ones explore, the later ones count for the estimate
        "drives": estimate.drives,
        "drives_with_a_collision": estimate.collisions,
        # points of the estimate, impossible ones included, and collisions of its drives
        "drawn_for_the_estimate": estimate.drawn,
        "collisions_that_count": estimate.hits,
        "stopped": part.stopped,
        "not_evaluated": part.not_evaluated,
    }


def rate_words(rate: Limits) -> str:
    """A rate with its limits as words; without a collision the upper limit alone."""
    value, low, high = rate
    if value == 0.0:
        return f"none seen, at most {amount(high)}"
    return f"{amount(value)} ({interval(low, high)})"


def lost_words(lost: Mapping[str, int]) -> str:
    """A sentence on the drives that could not be evaluated.

    lost: status -> number of drives.
    """
    why = ", ".join(f"{status} {number}" for status, number in sorted(lost.items()))
    drives = sum(lost.values())
    verb = "counts" if drives == 1 else "count"
    return (
        f"{count(drives, 'drive')} could not be evaluated ({why}) and {verb} as without a "
        "collision."
    )


def unseen_words(rate: AdsRate) -> str:
    """A sentence on the scenarios without a collision; empty if these are none or all."""
    unseen = [part for part in rate.parts if part.collisions[0] == 0.0]
    if not unseen or len(unseen) == len(rate.parts):
        return ""
    names = ", ".join(part.space.logical.name for part in unseen)
    # the largest of the scenarios' limits, each of which holds for its scenario alone
    most = amount(max(part.limit for part in unseen))
    return (
        f"The rate and its interval do not include {names}: no collision was seen there, at most "
        f"{most} (95 %)."
    )


def sentences(campaign: Campaign) -> list[str]:
    """The result: a line for each ADS, then one for the drivers of each recording."""
    rates = [
        f"{rate.ads}: collisions per million km {rate_words(rate.collisions)}; expected loss "
        f"{rate_words(rate.loss)}. {unseen_words(rate)}".rstrip()
        for rate in campaign.rates
    ]
    return rates + [
        f"people ({where}): no collision in {km:.1f} vehicle-km, at most {amount(limit)} per "
        "million km."
        for where, km, limit in _recorded_drivers(campaign)
    ]


def parts(campaign: Campaign, content: Json) -> list[Piece]:
    """The page, piece by piece.

    content: as made by `plain`.
    """
    collisions, loss = "collisions per million km (95 %)", "expected loss L per million km (95 %)"
    rates = [
        {"who": rate.ads, collisions: rate_words(rate.collisions), loss: rate_words(rate.loss)}
        for rate in campaign.rates
    ] + [
        {"who": f"people ({where})", collisions: f"none in {km:.1f} km, at most {amount(limit)}"}
        for where, km, limit in _recorded_drivers(campaign)
    ]
    unseen = (f"{rate.ads}: {words}" for rate in campaign.rates if (words := unseen_words(rate)))
    basis = Fold(
        "Basis of the rates",
        "rate of encounters of each scenario, and its source",
        (table(content["scenarios"]), Text(BASIS)),
    )
    notes = (Text(words, "note") for words in (*unseen, OUTSIDE))
    return [table(rates), *notes, basis, *map(_of_ads, campaign.rates, content["ads"])]


def _of_ads(rate: AdsRate, content: Json) -> Fold:
    """Rates of an ADS by scenario, and the drives behind them.

    content: of the ADS, as made by `plain`.
    """
    pieces: list[Text | Table] = [table(content["by_scenario"])]
    if rate.lost:
        pieces.append(Text(lost_words(rate.lost), "note"))
    if rate.collisions[0] == 0.0:
        pieces.append(
            Text(
                "No drive that counted collided. The upper limit holds wherever the collisions may "
                f"be; it rests on the {DEFENSIVE:.0%} of the counted drives that are drawn by "
                "exposure."
            )
        )
    return Fold(rate.ads, "rates per million km by scenario, and the drives behind them", pieces)


def _recorded_drivers(campaign: Campaign) -> list[tuple[str, float, float]]:
    """Drivers of each recording: where it was recorded, its km, and the upper limit of their
    collisions per million km.

    The limit is that of a recording without a collision. No recording has one, because an event
    with the gap of a collision counts as a ghost of the tracker (`drivers.recorded.events`) and is
    dropped.
    """
    roads = {
        (counted.where, counted.vehicle_km) for it in campaign.spaces if (counted := it.counted)
    }
    return [(where, km, MILLION * -math.log(1.0 - LEVEL) / km) for where, km in sorted(roads)]
