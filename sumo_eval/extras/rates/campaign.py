"""Crash rates: every ADS in every scenario of a campaign, per million kilometres, with intervals.

A scenario is met so many times a kilometre ([met] of its file); in each round the ADS drives points
that were drawn by importance (`rates.importance`); the rate is the sum over the scenarios of how
often they are met times how often they end in a collision. Intervals hold four doubts: the drives',
the rate of events' and that of the events' distribution (both by counting the recorded events
anew), and that of how far its kernels reach beyond the events.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Le, MinLen

from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError
from sumo_eval.extras.rates.importance import (
    Estimate,
    Met,
    RareEvents,
    degrees_of_freedom,
    how_met,
    resampled,
)
from sumo_eval.extras.rates.intervals import rate_interval
from sumo_eval.extras.studies.boundary import outcomes_at
from sumo_eval.method.collision_avoidance import collision_loss, impact_severity
from sumo_eval.record.cases import Outcome, Setup
from sumo_eval.record.engines import identify
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings import (
    About,
    AdsSettings,
    Checked,
    Positive,
    RunSettings,
    SimulationSettings,
)
from sumo_eval.settings.config import read_checked
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

MILLION: Final = 1e6  # km
ANEW: Final = 60  # times that a scenario's events are counted anew
DRAWS: Final = 4000  # of each rate, for intervals of sums
LEVEL: Final = 0.95


@dataclass(frozen=True, slots=True)
class CampaignScenario(Checked):
    """A scenario of the campaign."""

    use: Annotated[str, About("a scenario file or a shipped name")]
    per_km: Annotated[
        float | None, Positive, About("how often it is met; default: [met] of its file", "1/km")
    ] = None


@dataclass(frozen=True, slots=True)
class CampaignSettings(Checked):
    """A campaign file."""

    name: Annotated[str, MinLen(1), About("name")]
    scenario: Annotated[tuple[CampaignScenario, ...], About("where the ADSs drive")]
    ads: Annotated[tuple[AdsSettings, ...], About("the ADSs, and drivers to put beside them")]
    seed: Annotated[int, Ge(0), About("source of randomness")] = 1
    budget: Annotated[
        int, Ge(40), Le(1_000_000), About("drives of an ADS in a scenario, at most")
    ] = 400
    width: Annotated[
        float,
        Positive,
        About("stop where the interval's upper end is at most that many times its lower end"),
    ] = 1.5
    simulation: SimulationSettings = field(
        default_factory=lambda: SimulationSettings(end_when_decided=True)
    )
    run: RunSettings = field(default_factory=RunSettings)


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """A scenario of the campaign, the distribution of its points and its rate of encounters.

    events, vehicle_km: None where `per_km` was given by hand.
    """

    use: str
    logical: LogicalScenario
    met: Met
    per_km: float
    events: int | None
    vehicle_km: float | None
    where: str

    @property
    def interval(self) -> tuple[float, float]:
        """95 % limits of its encounters, 1/km."""
        if self.events is None or self.vehicle_km is None:
            return self.per_km, self.per_km
        return rate_interval(self.events, self.vehicle_km)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One ADS in one scenario.

    collisions, loss: per million km, with limits;
    draws: of both, (2, 2, `DRAWS`), by the narrow form of what is met and by the form that was
        driven.
    limit: of collisions per million km, whatever they look like.
    stopped: why.
    """

    space: Space
    estimate: Estimate
    collisions: tuple[float, float, float]
    loss: tuple[float, float, float]
    draws: FloatArray
    limit: float
    stopped: str
    not_evaluated: dict[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class AdsRate:
    """One ADS over all scenarios: collisions and expected loss per million km, each with 95 %
    limits.

    limit: of collisions per million km where none was seen.
    """

    ads: str
    controller: str
    parts: tuple[Part, ...]
    collisions: tuple[float, float, float]
    loss: tuple[float, float, float]
    limit: float

    @property
    def lost(self) -> Counter[str]:
        """How many drives could not be evaluated, by why."""
        return sum((Counter(part.not_evaluated) for part in self.parts), Counter[str]())


@dataclass(frozen=True, slots=True, eq=False)
class Campaign:
    """Results of a campaign."""

    settings: CampaignSettings
    spaces: tuple[Space, ...]
    rates: tuple[AdsRate, ...]


def read_campaign(path: Path) -> CampaignSettings:
    """The settings in a campaign file.

    Raises InputError naming every mistake in it.
    """
    settings = read_checked(path, CampaignSettings, "campaign file")
    for what, names in (
        ("scenario", [item.use for item in settings.scenario]),
        ("ads", [i.name for i in settings.ads]),
    ):
        if not names:
            raise InputError(f"{path} must have at least one [[{what}]].")
        double = {name for name in names if names.count(name) > 1}
        if double:
            raise InputError(
                f"Each [[{what}]] of {path} must be another one, got {sorted(double)[0]!r} twice."
            )
    return settings


def spaces_of(settings: CampaignSettings, folder: Path) -> tuple[Space, ...]:
    """The scenarios of a campaign.

    Raises InputError for one of which nobody says how often it is met.
    """
    found = []
    for item in settings.scenario:
        logical = catalogue.find(item.use, folder)
        met = logical.met
        if item.per_km is not None:
            rest: tuple[float, int | None, float | None, str] = item.per_km, None, None, "as given"
        elif met is not None and met.events:
            rest = met.events / met.vehicle_km, met.events, met.vehicle_km, met.where
        else:
            raise InputError(
                f"Scenario `{item.use}` needs an encounter rate: [met] with events in its file, "
                "or `per_km` in its "
                "[[scenario]]."
            )
        found.append(Space(item.use, logical, how_met(logical), *rest))
    return tuple(found)


Watch = Callable[[str, int, int], None]


def run_campaign(
    settings: CampaignSettings, folder: Path, watch: Watch = lambda what, done, total: None
) -> Campaign:
    """Drive every ADS through every scenario.

    folder: where relative paths start.
    watch: told what is driven, drives done and the budget.
    """
    setup = Setup(settings.simulation, settings.run, folder)
    identify([("ADS", item.locator) for item in settings.ads], setup)
    spaces = spaces_of(settings, folder)
    rates = []
    for item in settings.ads:
        parts = [_driven(space, item, settings, setup, watch) for space in spaces]
        rates.append(summed(item.name, item.controller, parts))
    return Campaign(settings, spaces, tuple(rates))


def _driven(
    space: Space, item: AdsSettings, settings: CampaignSettings, setup: Setup, watch: Watch
) -> Part:
    search = RareEvents(space.met, settings.budget, settings.seed)
    lost: Counter[str] = Counter()
    stopped = "budget"
    while len((batch := search.ask()).points):
        first = search.drives - len(batch.points)
        outcomes = outcomes_at(
            batch.points, space.logical, item.locator, setup, first=first,
            ended=lambda done: watch(f"{space.logical.name}: {item.name}", done, settings.budget),
        )  # fmt: skip
        collided = np.array([outcome.status == "collision" for outcome in outcomes])
        lost.update(outcome.status for outcome in outcomes if outcome.status not in EVALUATED)
        search.tell(batch, collided, np.array([loss_of(outcome) for outcome in outcomes]))
        estimate = search.estimate()
        low, high = estimate.interval
        if (
            not search.exploring
            and estimate.hits > 1
            and low > 0.0
            and high <= settings.width * low
        ):
            stopped = "width"
            break
    return part_of(space, search, settings.seed, stopped, dict(sorted(lost.items())))


def loss_of(outcome: Outcome) -> float:
    """L of Eq. 14 of a drive: 0 without a collision."""
    hit = None if outcome.recording is None else outcome.recording.collision
    if outcome.status != "collision" or hit is None:
        return 0.0
    return float(collision_loss(impact_severity(hit.ego_velocity, hit.other_velocity, hit.overlap)))


def part_of(
    space: Space, search: RareEvents, seed: int, stopped: str, lost: dict[str, int]
) -> Part:
    """The rates of one ADS in one scenario, from the search's drives."""
    from scipy.special import stdtrit

    estimate = search.estimate()
    limit = MILLION * space.interval[1] * estimate.upper_limit
    hits = search.counted & search.collided
    if not hits.any():
        zero = np.zeros((2, 2, DRAWS))
        return Part(
            space, estimate, (0.0, 0.0, limit), (0.0, 0.0, limit), zero, limit, stopped, lost
        )
    stream = random_stream(seed, "rates", space.logical.name)
    often = _often(space, search, seed, stream)
    terms = np.stack([search.weights[hits], search.weights[hits] * search.loss[hits]])
    relative = math.sqrt(math.log1p(estimate.deviation**2))
    # Student's, as the drives' own interval: else a sum would be told more narrowly than what it is
    # mostly made of. Evenly spaced and shuffled: with few degrees of freedom the limits of draws by
    # chance would be chance themselves.
    even = [(stream.permutation(DRAWS) + 0.5) / DRAWS for _ in terms]
    wide = np.stack(
        [stdtrit(degrees_of_freedom(row), share) for row, share in zip(terms, even, strict=True)]
    )
    noise = np.exp(np.minimum(relative * wide, 50.0))[:, None]
    most = MILLION * space.interval[1]  # every encounter ends in a collision, and L is at most 1
    draws = np.minimum(
        MILLION * np.stack([often(row) for row in terms]) * noise / search.drawn, most
    )
    values = MILLION * space.per_km * np.array([estimate.probability, estimate.loss])
    limits = [_limits(row) for row in draws]
    # The drives' own interval is Student's and wider where few of them collided.
    own = [
        MILLION * space.per_km * np.array(pair)
        for pair in (estimate.interval, estimate.loss_interval)
    ]
    rows = [
        (
            float(values[i]),
            float(min(limits[i][0], own[i][0])),
            float(min(max(limits[i][1], own[i][1]), most)),
        )
        for i in range(2)
    ]
    return Part(space, estimate, rows[0], rows[1], draws, limit, stopped, lost)


def _often(
    space: Space, search: RareEvents, seed: int, stream: np.random.Generator
) -> Callable[[FloatArray], FloatArray]:
    """A function from terms (h,) of the hits to (2, `DRAWS`) draws of their sum times how often the
    scenario is met: by the narrow form of the distribution over its events and by the form that was
    driven; alike where there is none.
    """
    hits = search.counted & search.collided
    points = search.points[hits]
    anew = resampled(space.met, ANEW, seed)
    if not anew or space.events is None or space.vehicle_km is None:
        events = np.full(DRAWS, space.per_km)
        if space.events is not None and space.vehicle_km is not None:
            events = stream.gamma(space.events + 0.5, size=DRAWS) / space.vehicle_km
        return lambda terms: np.stack([events, events]) * terms.sum()
    before = np.maximum(space.met.base_density(points), 1e-300)
    forms = [[replace(other, narrow=True) for other, _ in anew], [other for other, _ in anew]]
    ratios = np.array(
        [[one.density(points) / one.mass() / before for one in form] for form in forms]
    )
    counts = np.array([count for _, count in anew])
    chosen = stream.integers(len(anew), size=DRAWS)
    return lambda terms: space.per_km * (counts * (ratios @ terms))[:, chosen]


def _limits(draws: FloatArray) -> tuple[float, float]:
    """The lower of the two rows' lower limits, and the higher of their upper ones, of draws (2,
    `DRAWS`).

    Nothing but what lies within the events tells how fast the chances beyond them fall. The form
    that was driven has them too high where tails are normal, the narrow one has them too low where
    a tail is long; in the middle it is the other way round.
    """
    lows, highs = np.quantile(draws, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0], axis=1)
    return float(lows.min()), float(highs.max())


def summed(ads: str, controller: str, parts: Sequence[Part]) -> AdsRate:
    """One ADS over all scenarios.

    A scenario in which nothing was hit adds nothing to the sum. Where nothing was hit in any, the
    upper limit is that of the worst one: were all collisions there, none would have been missed
    with 95 %.
    """
    limit = max(part.limit for part in parts)
    rows = []
    for index, kind in ((0, "collisions"), (1, "loss")):
        value = sum(getattr(part, kind)[0] for part in parts)
        if value == 0.0:
            rows.append((0.0, 0.0, limit))
            continue
        draws = np.sum([part.draws[index] for part in parts], axis=0)
        low, high = _limits(draws)
        seen = [part for part in parts if getattr(part, kind)[0] > 0.0]
        if len(seen) == 1:
            low, high = getattr(seen[0], kind)[1:]
        rows.append((float(value), float(low), float(high)))
    return AdsRate(ads, controller, tuple(parts), rows[0], rows[1], limit)


def people(spaces: Sequence[Space]) -> list[tuple[str, float, float]]:
    """The people of the recordings: where, how many km, and the upper limit of their collisions per
    million km.

    Nobody collides in such recordings, or the event would have been dropped: 0 in so many km.
    """
    known = {(space.where, space.vehicle_km) for space in spaces if space.vehicle_km is not None}
    return [
        (where, km, MILLION * -math.log(1.0 - LEVEL) / km)
        for where, km in sorted(known)
        if km is not None
    ]
