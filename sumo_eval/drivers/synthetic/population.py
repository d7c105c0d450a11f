"""A population of skilled drivers, drawn from distributions fitted to recorded motorway driving.

Numbers: `population_summary.json` of the project's fits (2026), from the DLR Highway Traffic
dataset v1.1.0 (motorway near Braunschweig, 2024-10-07, 445 vehicles, 11.4 vehicle hours); the
reaction time is the literature value given below. The IDM parameters come from the same recording
(233 followers), because it is the only free-flowing motorway among the five sources: NGSIM I-80 is
stop-and-go at 6 m/s, and OpenACC is a test track behind a lead with ACC.

Every distribution is cut off at bounds, so that in a population of ten no driver is extreme; a
value outside is drawn again.

Users: `drivers/synthetic/driver.py`, `scoring/confidence/drivers.py`.
"""

from collections.abc import Callable
from math import exp, log
from typing import NamedTuple

import numpy as np

from sumo_eval.ads.car_following import IdmParameters
from sumo_eval.ads.lane_change import share_of_duration
from sumo_eval.ads.overtaking import OvertakingHabits
from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.settings import PopulationSettings
from sumo_eval.settings.random_streams import random_stream


class LogNormal(NamedTuple):
    """ln(value) ~ N(mu, sigma), kept within low..high."""

    mu: float
    sigma: float
    low: float
    high: float


IDM_FIT = {
    "headway": LogNormal(-0.139, 0.54, 0.4, 2.5),  # T, s
    "standstill_gap": LogNormal(0.64, 0.112, 1.4, 2.7),  # s0, m
    "acceleration": LogNormal(0.173, 0.435, 0.5, 3.0),  # a, m/s2
    "deceleration": LogNormal(0.809, 0.511, 0.8, 5.0),  # b, m/s2
}
IDM_CORRELATION = (
    (1.0, 0.81, -0.15, -0.28),
    (0.81, 1.0, -0.08, -0.1),
    (-0.15, -0.08, 1.0, 0.07),
    (-0.28, -0.1, 0.07, 1.0),
)  # of the logarithms, in the order of IDM_FIT

FREE_SPEED_MEAN = 33.79  # m/s, 190 cars
FREE_SPEED_DEVIATION = 6.5  # m/s
FREE_SPEED_BOUNDS = 20.8, 46.8  # m/s, two deviations

SPEED_SPREAD = 0.087
"""Deviation between drivers of (speed at the end / speed at the start) of an approach that ends
in overtaking; its mean is 0.994 (77 cars and vans that came up to a slower lead in the right
lane, DLR Highway Traffic).
"""

REACTION = LogNormal(log(1.2), 0.35, 0.6, 1.8)
"""Perception-reaction time in unexpected hazards, s.

The upper bound (88 % of the distribution) stands for skill.
"""

ALERTED_SHARE = 0.56
"""Ratio of the reaction times of an alerted driver and of one who is not: 0.7 s / 1.25 s (Green
2000)."""

LANE_OFFSET_DEVIATION = 0.19  # m, between drivers, of the mean position in the lane
LANE_OFFSET_BOUND = 0.45  # m

AS_RECORDED = PopulationSettings()
"""As the recorded drivers: 77.1 % of those who come up to a slower lead in the right lane
overtake it, and lane changes last 1.1 times as long as they are drawn below. Without that factor
lane changes in drives, measured like recorded ones, would be a tenth too quick. It was chosen on
each half of the recording and holds on the other (docs/explanation/drivers.md).
"""

ONSET_HEADWAY = LogNormal(0.866, 0.395, 1.0, 5.5)  # s, headway at which recorded lane changes begin
ONSET_TTC = LogNormal(2.345, 0.399, 4.5, 25.0)  # s, TTC at which these begin
HEADWAY_LIMIT = LogNormal(0.680, 0.317, 0.98, 3.88)  # s
TTC_LIMIT = LogNormal(2.366, 0.433, 4.27, 27.6)  # s
"""Limits of headway and TTC: a driver begins to pass once either is below its limit.

With these limits (those of maximum likelihood) drives begin to pass where recorded ones do. The
`ONSET` values are where recorded drivers begin; as limits they would make all begin too early.
"""
LANE_CHANGE_10_90 = LogNormal(1.628, 0.193, 3.3, 8.0)  # s, from 10 % to 90 % of the offset


@frozen
class Driver:
    """One driver's own parameters.

    idm: car following.
    free_speed: m/s, alone on the motorway.
    reaction_time: s, without a warning.
    lane_offset: m to the left of the lane's centre on average.
    overtakes: whether the driver passes a slower lead or follows it.
    onset_headway, onset_ttc: s, at which the driver begins to pass.
    lane_change_10_90: s, from 10 % to 90 % of a lane change without hurry.
    """

    index: int
    idm: IdmParameters
    free_speed: float
    reaction_time: float
    lane_offset: float
    overtakes: bool
    onset_headway: float
    onset_ttc: float
    lane_change_10_90: float

    @property
    def lane_change_duration(self) -> float:
        """Whole duration of the driver's smooth step, s: its 10-90 % part is 0.506 of it."""
        return self.lane_change_10_90 / (1.0 - 2.0 * share_of_duration(0.1))

    @property
    def habits(self) -> OvertakingHabits:
        """Conditions under which the driver overtakes."""
        return OvertakingHabits(
            self.overtakes, self.onset_headway, self.onset_ttc, self.lane_change_duration
        )

    @property
    def alerted_reaction_time(self) -> float:
        """Reaction time once something ahead has called for attention, s."""
        return ALERTED_SHARE * self.reaction_time

    @property
    def gain(self) -> float:
        """Ratio of the settled speed to the speed at which a case begins: faster drivers gain,
        slower ones lose.
        """
        return 1.0 + SPEED_SPREAD * (self.free_speed - FREE_SPEED_MEAN) / FREE_SPEED_DEVIATION


def draw_driver(index: int, seed: int, settings: PopulationSettings = AS_RECORDED) -> Driver:
    """Driver number `index` (from 0) of the population `seed`.

    A setting changes what it names and nothing else.
    """
    if isinstance(index, bool) or not isinstance(index, int) or index < 0:
        raise must_be("`index`", "a driver", "a whole number of at least 0", index)
    stream = random_stream(seed, "population", index)
    return Driver(
        index=index,
        idm=_draw_idm(stream, settings.headway_scale),
        free_speed=_within(
            lambda: stream.normal(FREE_SPEED_MEAN, FREE_SPEED_DEVIATION), *FREE_SPEED_BOUNDS
        ),
        reaction_time=settings.reaction_scale * _draw(stream, REACTION),
        lane_offset=_within(
            lambda: stream.normal(0.0, LANE_OFFSET_DEVIATION), -LANE_OFFSET_BOUND, LANE_OFFSET_BOUND
        ),
        overtakes=_overtakes(index, seed, settings.overtake_share),
        onset_headway=_limit(_draw(stream, ONSET_HEADWAY), ONSET_HEADWAY, HEADWAY_LIMIT, settings),
        onset_ttc=_limit(_draw(stream, ONSET_TTC), ONSET_TTC, TTC_LIMIT, settings),
        lane_change_10_90=settings.lane_change_scale * _draw(stream, LANE_CHANGE_10_90),
    )


def _overtakes(index: int, seed: int, share: float) -> bool:
    """Whether a driver is one of those who overtake, drawn by systematic sampling.

    Over all seeds each driver overtakes with probability `share`. Of any n drivers in a row of one
    population n * share overtake, rounded down or up: of ten, two or three follow. Drawn one by
    one, every third population of ten would have no follower, one, five or more, and that would
    change what counts as human: a single follower among ten drivers lies 2.8 deviations from
    their mean line, beyond what D tolerates (2), and each of two followers 1.9.
    """
    phase = random_stream(seed, "inclination").uniform()
    return (phase + index * share) % 1.0 < share


def _limit(
    drawn: float, recorded: LogNormal, limit: LogNormal, settings: PopulationSettings
) -> float:
    """A headway or TTC at which a driver passes: `drawn`, or the limit of the same quantile.

    drawn: from the distribution `recorded` in both cases, so that no setting changes later draws.
    """
    if settings.onset == "recorded":
        return drawn
    return exp(limit.mu + limit.sigma * (log(drawn) - recorded.mu) / recorded.sigma)


def _draw_idm(stream: np.random.Generator, headway_scale: float) -> IdmParameters:
    factor = np.linalg.cholesky(IDM_CORRELATION)
    while True:
        deviates = (factor @ stream.standard_normal(len(IDM_FIT))).tolist()
        values = {
            name: exp(fit.mu + fit.sigma * deviate)
            for (name, fit), deviate in zip(IDM_FIT.items(), deviates, strict=True)
        }
        if all(fit.low <= values[name] <= fit.high for name, fit in IDM_FIT.items()):
            return IdmParameters(**values | {"headway": headway_scale * values["headway"]})


def _draw(stream: np.random.Generator, fit: LogNormal) -> float:
    return _within(lambda: exp(stream.normal(fit.mu, fit.sigma)), fit.low, fit.high)


def _within(draw: Callable[[], float], low: float, high: float) -> float:
    while not low <= (value := draw()) <= high:
        pass
    return value
