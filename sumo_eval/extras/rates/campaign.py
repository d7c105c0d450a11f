"""Crash rates: every ADS in every scenario of a campaign, per million kilometres, with intervals.

A scenario has encounters per kilometre ([met] of its file). In each round the ADS drives points
that were drawn by importance (`rates.importance`). The rate is the sum over the scenarios of
encounters times the probability of a collision. Its interval covers four uncertainties:

- few drives;
- few recorded events, from which the rate of encounters is counted;
- few recorded events, over which the points are distributed (both by resampling the events);
- how far the kernels of that distribution reach beyond the events.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Ge, Le, MinLen
from scipy.special import stdtrit

from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError
from sumo_eval.extras.rates.importance import (
    CollisionEstimate,
    Limits,
    Met,
    RareEvents,
    degrees_of_freedom,
    how_met,
    resampled,
)
from sumo_eval.extras.rates.intervals import LEVEL, rate_interval
from sumo_eval.extras.studies.boundary import outcomes_at
from sumo_eval.method.collision_avoidance import collision_loss, impact_severity
from sumo_eval.record.cases import Outcome, Setup
from sumo_eval.record.engines import identify
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.resolved import find_with
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
from sumo_eval.trajectory import BoolArray, FloatArray

MILLION = 1e6  # km
RESAMPLED = 60  # times that a scenario's events are resampled
DRAWS = 4000  # of each rate, for intervals of sums


@dataclass(frozen=True, slots=True)
class CampaignScenario(Checked):
    """A scenario of the campaign."""

    use: Annotated[str, About("a scenario file or a shipped name")]
    per_km: Annotated[
        float | None, Positive, About("how often it occurs; default: [met] of its file", "1/km")
    ] = None


@dataclass(frozen=True, slots=True)
class CampaignSettings(Checked):
    """A campaign file."""

    name: Annotated[str, MinLen(1), About("name")]
    scenario: Annotated[tuple[CampaignScenario, ...], About("where the ADSs drive")]
    ads: Annotated[tuple[AdsSettings, ...], About("the ADSs, and drivers to compare with them")]
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


class EncounterSpace(NamedTuple):
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


class ScenarioRate(NamedTuple):
    """One ADS in one scenario.

    collisions, loss: per million km, with limits.
    draws: of collisions and of loss, (2, 2, `DRAWS`); each by two forms of the points' distribution
        over the recorded events: the narrow form (`scenario.joint`), then the form that was driven.
    limit: upper limit of collisions per million km; it also holds where no drive was.
    stopped: why the drives ended, `width` or `budget`.
    """

    space: EncounterSpace
    estimate: CollisionEstimate
    collisions: Limits
    loss: Limits
    draws: FloatArray
    limit: float
    stopped: str
    not_evaluated: dict[str, int]


class AdsRate(NamedTuple):
    """One ADS over all scenarios: collisions and expected loss per million km, each with 95 %
    limits.

    limit: of collisions per million km where none was seen.
    """

    ads: str
    controller: str
    parts: tuple[ScenarioRate, ...]
    collisions: Limits
    loss: Limits
    limit: float

    @property
    def lost(self) -> Counter[str]:
        """Number of drives that could not be evaluated, by why."""
        return sum((Counter(part.not_evaluated) for part in self.parts), Counter())


class Campaign(NamedTuple):
    """Results of a campaign."""

    settings: CampaignSettings
    spaces: tuple[EncounterSpace, ...]
    rates: tuple[AdsRate, ...]


def read_campaign(path: Path) -> CampaignSettings:
    """The settings in a campaign file.

    Raises InputError naming every mistake in it.
    """
    settings = read_checked(path, CampaignSettings, "campaign file")
    for table, names in (
        ("scenario", [item.use for item in settings.scenario]),
        ("ads", [item.name for item in settings.ads]),
    ):
        if not names:
            raise InputError(f"{path} must have at least one [[{table}]].")
        for name in sorted(names):
            if names.count(name) > 1:
                raise InputError(f"Each [[{table}]] of {path} must differ, got {name!r} twice.")
    return settings


def spaces_of(settings: CampaignSettings, folder: Path) -> tuple[EncounterSpace, ...]:
    """The scenarios of a campaign.

    Raises InputError for one without a rate of encounters.
    """
    spaces = []
    for item in settings.scenario:
        logical = find_with(settings.simulation.vehicle, item.use, folder)
        met = logical.met
        if item.per_km is not None:
            rate: Any = item.per_km, None, None, "as given"
        elif met is not None and met.events:
            rate = met.events / met.vehicle_km, met.events, met.vehicle_km, met.where
        else:
            raise InputError(
                f"Scenario `{item.use}` needs an encounter rate: [met] with events in its file, "
                "or `per_km` in its [[scenario]]."
            )
        spaces.append(EncounterSpace(item.use, logical, how_met(logical), *rate))
    return tuple(spaces)


Watch = Callable[[str, int, int], None]


def run_campaign(
    settings: CampaignSettings, folder: Path, watch: Watch = lambda what, done, total: None
) -> Campaign:
    """Drive every ADS through every scenario.

    folder: where relative paths start.
    watch: receives what is driven, drives done and the budget.
    """
    setup = Setup(settings.simulation, settings.run, folder)
    identify([("ADS", item.locator) for item in settings.ads], setup)
    spaces = spaces_of(settings, folder)
    rates = []
    for item in settings.ads:
        parts = [_drive(space, item, settings, setup, watch) for space in spaces]
        rates.append(summed(item.name, item.controller, parts))
    return Campaign(settings, spaces, tuple(rates))


def _drive(
    space: EncounterSpace,
    item: AdsSettings,
    settings: CampaignSettings,
    setup: Setup,
    watch: Watch,
) -> ScenarioRate:
    search = RareEvents(space.met, settings.budget, settings.seed)
    lost: Counter[str] = Counter()
    stopped = "budget"
    while len((draw := search.ask()).points):
        outcomes = outcomes_at(
            draw.points, space.logical, item.locator, setup,
            first=search.drives - len(draw.points),  # `ask` has counted these points already
            ended=lambda done: watch(f"{space.logical.name}: {item.name}", done, settings.budget),
        )  # fmt: skip
        collided = np.array([outcome.status == "collision" for outcome in outcomes])
        lost.update(outcome.status for outcome in outcomes if outcome.status not in EVALUATED)
        search.tell(draw, collided, np.array([loss_of(outcome) for outcome in outcomes]))
        estimate = search.estimate()
        _, low, high = estimate.probability
        enough = low > 0.0 and high <= settings.width * low
        # a single hit has no spread that its interval could measure
        if not search.exploring and estimate.hits > 1 and enough:
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
    space: EncounterSpace, search: RareEvents, seed: int, stopped: str, lost: dict[str, int]
) -> ScenarioRate:
    """The rates of one ADS in one scenario, from the search's drives."""
    estimate = search.estimate()
    most = MILLION * space.interval[1]  # every encounter ends in a collision, and L is at most 1
    limit = most * estimate.upper_limit
    hits = search.in_estimate & search.collided
    if not hits.any():
        none, zero = (0.0, 0.0, limit), np.zeros((2, 2, DRAWS))
        return ScenarioRate(space, estimate, none, none, zero, limit, stopped, lost)
    draws = np.minimum(_drawn_rates(space, search, seed, hits, estimate.deviation), most)
    rates: list[Any] = []
    for row, own in zip(draws, (estimate.probability, estimate.loss), strict=True):
        # the drives' own interval is wider where few of them collided
        value, low, high = (MILLION * space.per_km * np.array(own)).tolist()
        lowest, highest = _limits(row)
        rates.append((value, min(lowest, low), min(max(highest, high), most)))
    collisions, loss = rates
    return ScenarioRate(space, estimate, collisions, loss, draws, limit, stopped, lost)


def _drawn_rates(
    space: EncounterSpace, search: RareEvents, seed: int, hits: BoolArray, deviation: float
) -> FloatArray:
    """Draws of collisions and of loss per million km, (2, 2, `DRAWS`), as in `ScenarioRate`.

    hits: which drives of the search collided, (n,).
    deviation: relative one of the estimated probability.
    """
    stream = random_stream(seed, "rates", space.logical.name)
    summed_rates = _summed_rates(space, search.points[hits], seed, stream)
    terms = np.stack([search.weights[hits], search.weights[hits] * search.loss[hits]])
    # of the log-normal distribution with this relative deviation
    sigma = math.sqrt(math.log1p(deviation**2))
    # Student's, as in the drives' own interval: else a sum would be narrower than its largest part.
    # The permutation makes its shares evenly spaced: with few degrees of freedom, the limits of
    # random ones would be random.
    errors = [
        stdtrit(degrees_of_freedom(row), (stream.permutation(DRAWS) + 0.5) / DRAWS) for row in terms
    ]
    # at most 50, so that exp stays finite; the caller limits such draws
    noise = np.exp(np.minimum(sigma * np.stack(errors), 50.0))[:, None]
    drawn = MILLION * np.stack([summed_rates(row) for row in terms]) * noise / search.drawn
    return np.asarray(drawn)


def _summed_rates(
    space: EncounterSpace, points: FloatArray, seed: int, stream: np.random.Generator
) -> Callable[[FloatArray], FloatArray]:
    """A function from terms (h,), one a hit, to draws (2, `DRAWS`) of the rate of encounters times
    the sum of the terms.

    points: of the hits, (h, k).

    The two rows are the narrow form of the points' distribution and the form that was driven. Both
    rows are equal where that distribution has no events, or the rate was given by hand.
    """
    if space.events is None or space.vehicle_km is None:  # nothing was counted: the rate is given
        return lambda terms: np.full((2, DRAWS), space.per_km * terms.sum())

    resamples = resampled(space.met, RESAMPLED, seed)
    if not resamples:  # only the rate comes from events
        rates = stream.gamma(space.events + 0.5, size=DRAWS) / space.vehicle_km
        return lambda terms: np.stack([rates, rates]) * terms.sum()

    driven = np.maximum(space.met.base_density(points), 1e-300)
    ratios = np.empty((2, len(resamples), len(points)))  # by form, resample and hit
    for place, (joint, _) in enumerate(resamples):
        for row, form in enumerate((replace(joint, narrow=True), joint)):
            ratios[row, place] = form.density(points) / form.mass() / driven
    # a resample with twice the events has twice the rate of encounters
    factors = np.array([factor for _, factor in resamples])
    chosen = stream.integers(len(resamples), size=DRAWS)
    return lambda terms: space.per_km * (factors * (ratios @ terms))[:, chosen]


def _limits(draws: FloatArray) -> tuple[float, float]:
    """The lower of the two rows' lower limits, and the higher of their upper ones, of draws (2,
    `DRAWS`).

    Where tails are normal, the form that was driven is too dense beyond the events and too thin
    among them. Where a tail is long, the narrow form is too thin beyond the events and too dense
    among them.
    """
    lows, highs = np.quantile(draws, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0], axis=1)
    return lows.min(), highs.max()


def summed(ads: str, controller: str, parts: Sequence[ScenarioRate]) -> AdsRate:
    """One ADS over all scenarios.

    A scenario without a collision adds nothing to the sum. Without a collision in any scenario,
    the upper limit is the largest of the scenarios' limits: were the rate of one scenario higher,
    its drives would have shown a collision with 95 %.
    """
    limit = max(part.limit for part in parts)
    rates = []
    for index, kind in enumerate(("collisions", "loss")):
        each = [getattr(part, kind) for part in parts]
        seen = [rate for rate in each if rate[0] > 0.0]
        rate = 0.0, 0.0, limit
        if len(seen) == 1:
            rate = seen[0]
        elif seen:
            low, high = _limits(np.sum([part.draws[index] for part in parts], axis=0))
            rate = sum(value for value, _, _ in each), low, high
        rates.append(rate)
    collisions, loss = rates
    return AdsRate(ads, controller, tuple(parts), collisions, loss, limit)


def recorded_drivers(spaces: Sequence[EncounterSpace]) -> list[tuple[str, float, float]]:
    """The drivers of the recordings: where, km, and the upper limit of their collisions per million
    km, from none seen.

    An event with a collision is dropped at import: its gap makes it a ghost of the tracker
    (`drivers.recorded.events`).
    """
    roads = {(space.where, space.vehicle_km) for space in spaces if space.vehicle_km is not None}
    return [(where, km, MILLION * -math.log(1.0 - LEVEL) / km) for where, km in sorted(roads)]
