"""Crash rates of ADSs per million kilometres, with intervals, for `sumo-eval campaign`.

A scenario has a rate of encounters per kilometre, from the table [met] of its file. `importance`
estimates the probability that an encounter ends in a collision. The crash rate is the sum, over the
scenarios, of rate times probability. Its interval covers that the drives are few. Where rate and
distribution of the points come from recorded events, it covers three uncertainties more:

- The rate of encounters is counted from few recorded events.
- The distribution of the points is fitted to the same events. Rate and fit are resampled together.
- The kernels of this distribution may reach too far beyond the events, or not far enough.

Users: `extras/rates/campaign_page.py`, `extras/rates/command.py`.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Le
from scipy.special import stdtrit

from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError, doubled
from sumo_eval.extras.rates import BUDGET
from sumo_eval.extras.rates.exposure import Exposure, normalised_exposure, resampled
from sumo_eval.extras.rates.importance import (
    LARGEST_EXPONENT,
    CollisionEstimate,
    RareEvents,
    degrees_of_freedom,
)
from sumo_eval.extras.rates.intervals import LEVEL, Limits, rate_interval
from sumo_eval.extras.studies.trials import Trials
from sumo_eval.frozen import frozen, required
from sumo_eval.method.collision_avoidance import collision_loss, impact_severity
from sumo_eval.record.case_rows import Fact
from sumo_eval.scenario.logical import LogicalScenario, Occurrence
from sumo_eval.scenario.resolved import find_with, refuse_doubles
from sumo_eval.settings import AdsSettings, RunSettings, SimulationSettings
from sumo_eval.settings.checked import (
    Checked,
    FilledText,
    Natural,
    PositiveFloat,
    PositiveOrNone,
    optional,
    setting,
)
from sumo_eval.settings.config import read_checked
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

MILLION = 1e6  # km, the unit of rates
RESAMPLED = 60  # resamples of a scenario's events
DRAWS = 4000  # of each rate: intervals of sums come from summed draws


@frozen
class CampaignScenario(Checked):
    """A [[scenario]] of the campaign file."""

    use: str = required("a scenario file or a shipped name")
    per_km: PositiveOrNone = optional("how often it occurs; default: [met] of its file", "1/km")


@frozen
class CampaignSettings(Checked):
    """A campaign file."""

    name: FilledText = required("name")
    scenario: tuple[CampaignScenario, ...] = required("where the ADSs drive")
    ads: tuple[AdsSettings, ...] = required("the ADSs, and drivers to compare with them")
    seed: Natural = setting(1, "source of randomness")
    budget: Annotated[int, Ge(BUDGET[0]), Le(BUDGET[1])] = setting(
        400, "drives of an ADS in a scenario, at most"
    )
    width: PositiveFloat = setting(
        1.5, "stop where the interval's upper end is at most that many times its lower end"
    )
    simulation: SimulationSettings = SimulationSettings(end_when_decided=True)
    run: RunSettings = RunSettings()


class EncounterSpace(NamedTuple):
    """A scenario of the campaign, the exposure of its points and its rate of encounters.

    use: its name or file in the campaign file.
    exposure: of its points.
    per_km: rate of encounters, 1/km.
    counted: events and kilometres from which the rate was counted; None: the campaign file gives
        the rate.
    """

    use: str
    logical: LogicalScenario
    exposure: Exposure
    per_km: float
    counted: Occurrence | None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % limits of `per_km`; a rate of the campaign file has no uncertainty."""
        if self.counted is None:
            return self.per_km, self.per_km
        return rate_interval(self.counted.events, self.counted.vehicle_km)


class ScenarioRate(NamedTuple):
    """Rates of one ADS in one scenario.

    collisions, loss: per million km, with limits.
    draws: possible values of both rates, (2, 2, `DRAWS`). The first axis has collisions and loss.
        The second has two forms of the points' distribution (`scenario.joint`): the narrow form,
        and the wide form, with which `importance` weighs the drives.
    limit: upper limit of collisions per million km, valid wherever in the space they lie.
    stopped: why the drives ended, `width` or `budget`.
    not_evaluated: number of drives that could not be evaluated, by status.
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
    """Rates of one ADS over all scenarios.

    parts: rates in each scenario.
    collisions, loss: per million km, with 95 % limits.
    limit: upper limit of collisions per million km where no drive that counts collided.
    """

    ads: str
    controller: str
    parts: tuple[ScenarioRate, ...]
    collisions: Limits
    loss: Limits
    limit: float

    @property
    def lost(self) -> Counter[str]:
        """Number of drives that could not be evaluated, by status."""
        return sum((Counter(part.not_evaluated) for part in self.parts), Counter())


class Campaign(NamedTuple):
    """Results of a campaign."""

    settings: CampaignSettings
    spaces: tuple[EncounterSpace, ...]
    rates: tuple[AdsRate, ...]


def read_campaign(path: Path) -> CampaignSettings:
    """The settings in a campaign file.

    Raises InputError for a file with mistakes.
    """
    settings = read_checked(path, CampaignSettings, "campaign file")
    for table, names in (
        ("scenario", [item.use for item in settings.scenario]),
        ("ads", [item.name for item in settings.ads]),
    ):
        if not names:
            raise InputError(f"{path} must have at least one [[{table}]].")
        if repeated := doubled(names):
            raise InputError(f"Each [[{table}]] of {path} must differ, got {repeated[0]!r} twice.")
    return settings


def spaces_of(settings: CampaignSettings, folder: Path) -> tuple[EncounterSpace, ...]:
    """The scenarios of a campaign.

    folder: where relative paths start.
    Raises InputError for a scenario without a rate of encounters, and for two of one name.
    """
    spaces = []
    for item in settings.scenario:
        logical = find_with(settings.simulation.vehicle, item.use, folder)
        per_km, counted = item.per_km, logical.met
        if per_km is not None:
            counted = None
        elif counted and counted.events:
            per_km = counted.events / counted.vehicle_km
        else:
            raise InputError(
                f"Scenario `{item.use}` needs an encounter rate: [met] with events in its file, "
                "or `per_km` in its [[scenario]]."
            )
        exposure = normalised_exposure(logical)
        spaces.append(EncounterSpace(item.use, logical, exposure, per_km, counted))
    # two of one name would have the same random numbers, and take each other's kept drives
    refuse_doubles([space.logical.name for space in spaces])
    return tuple(spaces)


Watch = Callable[[str, int, int], None]
"""Receives scenario and ADS in words, the number of drives that ended, and the budget."""


def run_campaign(
    settings: CampaignSettings, folder: Path, trials: Trials, watch: Watch
) -> Campaign:
    """Drive every ADS through every scenario.

    folder: where relative paths start.
    """
    spaces = spaces_of(settings, folder)
    rates = []
    for item in settings.ads:
        parts = [_drive(space, item, settings, trials, watch) for space in spaces]
        rates.append(summed(item.name, item.controller, parts))
    return Campaign(settings, spaces, tuple(rates))


def _drive(
    space: EncounterSpace,
    item: AdsSettings,
    settings: CampaignSettings,
    trials: Trials,
    watch: Watch,
) -> ScenarioRate:
    """Drive one ADS through one scenario until its interval is narrow or the budget is spent."""
    search = RareEvents(space.exposure, settings.budget, settings.seed)
    not_evaluated: Counter[str] = Counter()
    stopped = "budget"
    while len((draw := search.ask()).points):
        outcomes = trials.at(
            draw.points, space.logical, (item.name, item.locator),
            first=search.drives,
            ended=lambda done: watch(f"{space.logical.name}: {item.name}", done, settings.budget),
        )  # fmt: skip
        statuses = [outcome.status for outcome in outcomes]
        not_evaluated.update(status for status in statuses if status not in EVALUATED)
        collided = np.array([status == "collision" for status in statuses])
        search.tell(draw, collided, np.array([loss_of(outcome) for outcome in outcomes]))
        estimate = search.estimate()
        _, low, high = estimate.probability
        narrow = low > 0.0 and high <= settings.width * low
        # of a single hit no spread can be estimated: its interval is narrow, but means nothing
        if narrow and estimate.hits > 1 and not search.exploring:
            stopped = "width"
            break
    return part_of(space, search, settings.seed, stopped, dict(sorted(not_evaluated.items())))


def loss_of(trial: Fact) -> float:
    """Eq. 14: L of a drive, 0 without a collision."""
    hit = trial.collision
    if trial.status != "collision" or hit is None:
        return 0.0
    return float(collision_loss(impact_severity(hit.ego_velocity, hit.other_velocity, hit.overlap)))


def part_of(
    space: EncounterSpace,
    search: RareEvents,
    seed: int,
    stopped: str,
    not_evaluated: dict[str, int],
) -> ScenarioRate:
    """The rates of one ADS in one scenario, from the drives of its search.

    stopped, not_evaluated: as in `ScenarioRate`.
    """
    estimate = search.estimate()
    # as if every encounter ended in a collision with L = 1
    most = MILLION * space.interval[1]
    limit = most * estimate.upper_limit
    collisions = loss = 0.0, 0.0, limit
    draws = np.zeros((2, 2, DRAWS))
    if estimate.hits:
        draws = np.minimum(_drawn_rates(space, search, seed, estimate.deviation), most)
        collisions, loss = (
            _rate(MILLION * space.per_km * np.array(limits), drawn, most)
            for limits, drawn in zip((estimate.probability, estimate.loss), draws, strict=True)
        )
    return ScenarioRate(space, estimate, collisions, loss, draws, limit, stopped, not_evaluated)


def _rate(own: FloatArray, draws: FloatArray, most: float) -> Limits:
    """A rate per million km with an interval that covers two: by the drives alone, and by `draws`.

    own: the rate and its limits by the drives alone, (3,); these are wider where few collided.
    draws: of the rate, (2, `DRAWS`).
    most: largest possible rate.
    """
    value, low, high = own.tolist()
    drawn_low, drawn_high = _limits(draws)
    return value, min(drawn_low, low), min(max(drawn_high, high), most)


def _drawn_rates(
    space: EncounterSpace, search: RareEvents, seed: int, deviation: float
) -> FloatArray:
    """Draws of collisions and of loss per million km, (2, 2, `DRAWS`), as in `ScenarioRate`.

    deviation: standard error of the estimated probability over its value.
    """
    stream = random_stream(seed, "rates", space.logical.name)
    hits = search.in_estimate & search.collided
    weights = search.weights[hits]
    terms = np.stack([weights, weights * search.loss[hits]])
    rates = _summed_rates(space, search.points[hits], terms, seed, stream)

    # The error's logarithm has Student's t distribution, as in the drives' own interval. With a
    # normal one, a sum's interval would be narrower than that of its largest part.
    sigma = math.sqrt(math.log1p(deviation**2))
    # The quantiles are evenly spaced, in random order. With few degrees of freedom, limits of
    # random quantiles would vary from seed to seed.
    errors = [
        stdtrit(degrees_of_freedom(row), (stream.permutation(DRAWS) + 0.5) / DRAWS) for row in terms
    ]
    # factors (2, 1, `DRAWS`), the same for both forms; `part_of` limits the largest rates
    noise = np.exp(np.minimum(sigma * np.stack(errors), LARGEST_EXPONENT))[:, None]
    return np.broadcast_to(MILLION * rates * noise / search.drawn, (2, 2, DRAWS))


def _summed_rates(
    space: EncounterSpace,
    points: FloatArray,
    terms: FloatArray,
    seed: int,
    stream: np.random.Generator,
) -> FloatArray:
    """Rate of encounters, 1/km, times the sum over the hits of each row of terms.

    points: of the hits, (h, k).
    terms: weight of each hit, and its weight times L, (2, h).

    The result broadcasts to (2, 2, `DRAWS`), the axes of `ScenarioRate.draws`. The second axis has
    length 1 where the points' distribution has no events. The second and the third axis have
    length 1 where the campaign file gives the rate.
    """
    sums: FloatArray = terms.sum(axis=1)[:, None, None]  # (2, 1, 1)
    counted = space.counted
    if counted is None:
        return space.per_km * sums

    resamples = resampled(space.exposure, RESAMPLED, seed)
    if not resamples:  # Only the rate comes from events: draws of a Poisson rate, by Jeffreys.
        return stream.gamma(counted.events + 0.5, size=DRAWS) / counted.vehicle_km * sums

    # ratios (form, resample, hit): density of a hit over its density by the wide form
    wide = np.maximum(space.exposure.base_density(points), 1e-300)
    ratios = np.empty((2, len(resamples), len(points)))
    for number, (joint, _) in enumerate(resamples):
        for k, form in enumerate((replace(joint, narrow=True), joint)):
            ratios[k, number] = form.density(points) / form.mass() / wide
    # a resample with twice the events has twice the rate of encounters
    factors = np.array([factor for _, factor in resamples])  # (resample,)
    chosen = stream.integers(len(resamples), size=DRAWS)  # resample of each draw
    return space.per_km * np.stack([(factors * (ratios @ row))[:, chosen] for row in terms])


def _limits(draws: FloatArray) -> tuple[float, float]:
    """95 % limits of draws (2, `DRAWS`) that hold for both forms of the points' distribution.

    Beyond the events, the wide form has too high a density where the true tail is Gaussian, and the
    narrow form too low a one where it is longer. Among the events it is the other way round: the
    wide form is too low, the narrow form too high.
    """
    lows, highs = np.quantile(draws, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0], axis=1)
    return lows.min(), highs.max()


def summed(ads: str, controller: str, parts: Sequence[ScenarioRate]) -> AdsRate:
    """Rates of one ADS over all scenarios.

    parts: rates in each scenario. One without a collision adds nothing to the sum.

    Where no drive that counts collided in any scenario, the upper limit of the sum is the largest
    of the scenarios' limits. In the worst case one scenario has the whole rate; were it higher, the
    drives of this scenario would have shown a collision with 95 %.
    """
    limit = max(part.limit for part in parts)
    sums = np.sum([part.draws for part in parts], axis=0)
    collisions = _total([part.collisions for part in parts], sums[0], limit)
    loss = _total([part.loss for part in parts], sums[1], limit)
    return AdsRate(ads, controller, tuple(parts), collisions, loss, limit)


def _total(rates: Sequence[Limits], draws: FloatArray, limit: float) -> Limits:
    """Sum of one kind of rate over all scenarios.

    draws: of the sum, (2, `DRAWS`).
    limit: its upper limit where all rates are 0.
    """
    above_zero = [rate for rate in rates if rate[0] > 0.0]
    if not above_zero:
        return 0.0, 0.0, limit
    if len(above_zero) == 1:  # its own interval may be wider than that of the draws
        return above_zero[0]
    return sum(value for value, _, _ in above_zero), *_limits(draws)
