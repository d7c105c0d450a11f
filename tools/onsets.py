"""Where recorded people begin to overtake, and by which limits the synthetic drivers begin there, too. Prints tables of
docs/humans.md.

    python tools/onsets.py EVENTS/approach.csv

EVENTS: the folder of `sumo-eval humans events TABLE --out EVENTS`. Counted are those in the right lane whose gap passes
through 3.5 s and who change lane. A driver turns the wheel where he comes below his own headway or his own TTC,
whichever is first; both are log-normal among drivers. Of each recording and of all:

- the limits that are most likely: with u the headway at which somebody turned the wheel, `SHOWS` before his onset, and
  s the closing speed over his own, both at the start, the density of u is f(u) G(u/s) + F(u) g(u/s)/s, over the
  probability F(w) G(w/s) that he is among the recorded at all: he has not left the lane where the gap is 3.5 s, so he
  turned the wheel at less than w = 3.5 s + (`SHOWS` + `LEAVES`) s. F, f are of headways, G, g of TTCs;
- how far drivers with these limits, and with either of `[drivers.population] onset`, are from each recording's people
  and from all: Kolmogorov distances of headway and TTC at the onset, without a simulator, at constant speeds and for
  drivers who are seen where these people were.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize, stats

from sumo_eval.drivers.recorded.events import RULES
from sumo_eval.drivers.synthetic.population import HEADWAY_LIMIT, ONSET_HEADWAY, ONSET_TTC, TTC_LIMIT, LogNormal
from sumo_eval.trajectory import FloatArray

SHOWS, SHOWS_DEVIATION = 1.4, 0.35  # s from the turn of the wheel until a lane change shows: 800 synthetic drivers
LEAVES, LEAVES_DEVIATION = 4.0, 0.95  # s from there until the lane is left: 129 people
DRAWN = 40_000


class Limits(NamedTuple):
    """Log-normal limits of a population: mean and deviation of the logarithms of headways and TTCs."""

    headway: float
    headway_deviation: float
    ttc: float
    ttc_deviation: float


def shares(people: pd.DataFrame) -> FloatArray:
    """Closing speed over the own one at the start, of each."""
    return (1.0 - people["lead_speed"] / people["ego_speed"]).to_numpy(dtype=np.float64)


def most_likely(people: pd.DataFrame) -> Limits:
    """The limits by which people most likely began where they did."""
    share = shares(people)
    turned = people["headway_at_onset"].to_numpy(dtype=np.float64) + SHOWS * share
    seen = RULES.approach_headway + (SHOWS + LEAVES) * share

    def against(values: FloatArray) -> float:
        headway = stats.lognorm(math.exp(values[1]), scale=math.exp(values[0]))
        ttc = stats.lognorm(math.exp(values[3]), scale=math.exp(values[2]))
        density = headway.pdf(turned) * ttc.cdf(turned / share) + headway.cdf(turned) * ttc.pdf(turned / share) / share
        return float(-np.log(density / (headway.cdf(seen) * ttc.cdf(seen / share))).sum())

    start = np.array([ONSET_HEADWAY.mu, math.log(ONSET_HEADWAY.sigma), ONSET_TTC.mu, math.log(ONSET_TTC.sigma)])
    found = optimize.minimize(
        against, start, method="Nelder-Mead", options={"maxiter": 4000, "maxfev": 4000, "xatol": 1e-5, "fatol": 1e-6}
    ).x
    return Limits(float(found[0]), math.exp(found[1]), float(found[2]), math.exp(found[3]))


def distances(limits: Limits, people: pd.DataFrame) -> tuple[float, float]:
    """Kolmogorov distances of headway and TTC at the onset, of drivers with these limits from these people."""
    stream = np.random.default_rng(1)
    share = stream.choice(shares(people), DRAWN)
    headway = np.exp(stream.normal(limits.headway, limits.headway_deviation, DRAWN))
    ttc = np.exp(stream.normal(limits.ttc, limits.ttc_deviation, DRAWN))
    shows, leaves = stream.normal(SHOWS, SHOWS_DEVIATION, DRAWN), stream.normal(LEAVES, LEAVES_DEVIATION, DRAWN)
    onset = np.maximum(headway, ttc * share) - shows * share
    seen = (onset - leaves * share < RULES.approach_headway) & (onset > 0.0)
    return (
        float(stats.ks_2samp(people["headway_at_onset"], onset[seen]).statistic),
        float(stats.ks_2samp(people["ttc_at_onset"], (onset / share)[seen]).statistic),
    )


def of(headway: LogNormal, ttc: LogNormal) -> Limits:
    """Limits that the package has."""
    return Limits(headway.mu, headway.sigma, ttc.mu, ttc.sigma)


if __name__ == "__main__":
    table = pd.read_csv(Path(sys.argv[1]))
    found = table[(table["start_kind"] == "range_crossing") & (table["lane"] == 0)]
    found = found[found["outcome"] == "lane_change"].dropna(subset=["headway_at_onset", "ttc_at_onset"])
    groups = {**{str(name): people for name, people in found.groupby("recording")}, "all": found}
    limits = {name: most_likely(people) for name, people in groups.items()}
    limits |= {"`limits`": of(HEADWAY_LIMIT, TTC_LIMIT), "`recorded`, as they ship": of(ONSET_HEADWAY, ONSET_TTC)}
    print("| limits of | headway, s | TTC, s | " + " | ".join(f"{n}, {len(p)}" for n, p in groups.items()) + " |")
    print("|---" * (3 + len(groups)) + "|")
    for name, one in limits.items():
        medians = f"{math.exp(one.headway):.2f} ({one.headway:.3f}, {one.headway_deviation:.3f})"
        medians += f" | {math.exp(one.ttc):.2f} ({one.ttc:.3f}, {one.ttc_deviation:.3f})"
        far = [distances(one, people) for people in groups.values()]
        print(f"| {name} | {medians} | " + " | ".join(f"{a:.2f}, {b:.2f}" for a, b in far) + " |")
