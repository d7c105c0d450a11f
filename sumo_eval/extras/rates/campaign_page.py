"""Results of a campaign: a page, JSON and sentences."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from sumo_eval.extras.rates.campaign import AdsRate, Campaign, Part, people
from sumo_eval.extras.rates.importance import DEFENSIVE
from sumo_eval.extras.rates.page import (
    Fold,
    Piece,
    Table,
    Text,
    amount,
    interval,
    table,
    write_parts,
)
from sumo_eval.report.page import write_page

PAGE, PLAIN = "campaign.html", "campaign.json"
OUTSIDE: Final = (
    "What is outside: everything that is no encounter of these scenarios; other roads, weather "
    "and times of day than "
    "those recorded; other bodies than the scenarios'; vehicles that react where the scenarios' "
    "follow their scripts; "
    "sensors that fail; and what the distributions' tails make of encounters rarer than the "
    "recordings show. These are "
    "rates in simulated encounters, not of accidents on the road."
)


def write_campaign(campaign: Campaign, folder: Path) -> tuple[Path, ...]:
    """Write `campaign.html` and `campaign.json` into a folder; return their paths."""
    write_page(
        folder / PLAIN,
        json.dumps(plain(campaign), indent=2, allow_nan=False) + "\n",
        "The campaign",
    )
    title = f"{campaign.settings.name}: collisions per million km"
    write_parts(
        folder / PAGE, kicker="Crash rates", title=title, sentences=[], parts=parts(campaign)
    )
    return folder / PAGE, folder / PLAIN


def plain(campaign: Campaign) -> dict[str, Any]:
    """Everything in plain values."""
    return {
        "name": campaign.settings.name,
        "seed": campaign.settings.seed,
        "budget": campaign.settings.budget,
        "unit": "per million vehicle-km",
        "scenarios": [
            {
                "use": space.use, "name": space.logical.name, "per_vehicle_km": space.per_km,
                "per_vehicle_km_interval": list(space.interval), "events": space.events,
                "vehicle_km": space.vehicle_km, "where": space.where,
                "exposure": space.logical.exposure_about,
            }
            for space in campaign.spaces
        ],
        "ads": [_plain_rate(rate) for rate in campaign.rates],
        "people": [{"where": where, "vehicle_km": km, "collisions": 0, "upper_limit": limit}
                   for where, km, limit in people(campaign.spaces)],
    }  # fmt: skip


def _plain_rate(rate: AdsRate) -> dict[str, Any]:
    return {
        "name": rate.ads,
        "controller": rate.controller,
        **_plain_limits(rate),
        "upper_limit_whatever_collides": rate.limit,
        "by_scenario": [_plain_part(part, rate.collisions[0]) for part in rate.parts],
    }


def _plain_limits(one: AdsRate | Part) -> dict[str, Any]:
    return {
        "collisions": one.collisions[0],
        "collisions_interval": list(one.collisions[1:]),
        "loss": one.loss[0],
        "loss_interval": list(one.loss[1:]),
    }


def _plain_part(part: Part, total: float) -> dict[str, Any]:
    """A scenario of an ADS.

    total: of its collisions in all scenarios, per million km.
    """
    known = part.estimate
    return {
        "scenario": part.space.logical.name,
        **_plain_limits(part),
        "share_of_collisions": part.collisions[0] / total if total > 0.0 else None,
        "collision_probability": known.probability,
        "collision_probability_interval": list(known.interval),
        "drives": known.drives,
        "drives_with_a_collision": known.collisions,
        "drawn_for_the_estimate": known.drawn,
        "collisions_that_count": known.hits,
        "stopped": part.stopped,
        "not_evaluated": part.not_evaluated,
    }


def rate_words(rate: tuple[float, float, float]) -> str:
    """A rate with its limits; without a collision the upper limit alone."""
    if rate[0] == 0.0:
        return f"none seen, at most {amount(rate[2])}"
    return f"{amount(rate[0])} ({interval(rate[1], rate[2])})"


def lost_words(lost: Mapping[str, int]) -> str:
    """That drives could not be evaluated, and why."""
    why = ", ".join(f"{status} {count}" for status, count in sorted(lost.items()))
    return (
        f"{sum(lost.values())} drives could not be evaluated ({why}) and count as without a "
        "collision."
    )


def unseen_words(rate: AdsRate) -> str:
    """Scenarios that a rate leaves out: those without a collision, where others have some."""
    unseen = [part for part in rate.parts if part.collisions[0] == 0.0]
    if not unseen or len(unseen) == len(rate.parts):
        return ""
    names = ", ".join(part.space.logical.name for part in unseen)
    most = amount(max(part.limit for part in unseen))
    return (
        f"The rate and its interval hold nothing of {names}: no collision was seen there, at most "
        f"{most} (95 %)."
    )


def sentences(campaign: Campaign) -> list[str]:
    """The result, a line or two an ADS and one for the people."""
    said = []
    for rate in campaign.rates:
        found = (
            f"collisions per million km {rate_words(rate.collisions)}; expected loss "
            f"{rate_words(rate.loss)}."
        )
        said.append(f"{rate.ads}: {found} {unseen_words(rate)}".rstrip())
    for where, km, limit in people(campaign.spaces):
        said.append(
            f"people ({where}): no collision in {km:.1f} vehicle-km, at most {amount(limit)} per "
            "million km."
        )
    return said


def parts(campaign: Campaign) -> list[Piece]:
    """The page, piece by piece."""
    known = plain(campaign)
    collisions, loss = "collisions per million km (95 %)", "expected loss L per million km (95 %)"
    rates = [
        {"who": rate.ads, collisions: rate_words(rate.collisions), loss: rate_words(rate.loss)}
        for rate in campaign.rates
    ]
    people_ = [
        {"who": f"people ({where})", collisions: f"none in {km:.1f} km, at most {amount(limit)}"}
        for where, km, limit in people(campaign.spaces)
    ]
    out: list[Piece] = [
        table([*rates, *people_]),
        *(Text(f"{rate.ads}: {words}",
            "note") for rate in campaign.rates if (words := unseen_words(rate))),
        Text(OUTSIDE, "note"),
        Fold("What the rates rest on", "how often each scenario is met, and where that is known "
                                       "from",
             (table(known["scenarios"]), Text(
                 "Rates of ADSs hold the doubt of the drives, and where the recorded events are "
                 "known that "
                 "of how often the scenario is met and of the events' distribution, both by "
                 "counting the "
                 "events anew. Intervals hold what comes of a distribution that varies as much as "
                 "its events "
                 "do, and as much as its kernels make it; else its form is taken to be right."))),
    ]  # fmt: skip
    return [*out, *map(_of_one, campaign.rates, known["ads"])]


def _of_one(rate: AdsRate, known: dict[str, Any]) -> Fold:
    """An ADS's rate by scenario, and what it rests on."""
    inside: list[Text | Table] = [table(known["by_scenario"])]
    if rate.lost:
        inside.append(Text(lost_words(rate.lost), "note"))
    if rate.collisions[0] == 0.0:
        inside.append(
            Text("No drive that counted collided. The upper limit holds whatever the collisions "
                 "may look like; it "
                 f"rests on the {DEFENSIVE:.0%} of the drives that are drawn as points are met.")
        )  # fmt: skip
    return Fold(rate.ads, "the rate by scenario, and the drives it rests on", tuple(inside))
