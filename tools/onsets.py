"""Where recorded people begin to overtake, and how much of it a scenario can show that begins at a gap of 3.5 s. Prints
a table of docs/humans.md.

    python tools/onsets.py EVENTS/approach.csv

EVENTS: the folder of `sumo-eval humans events TABLE --out EVENTS`. Counted are those in the right lane whose gap passes
through 3.5 s and who change lane. For each recording and for all:

- how many had begun before;
- the Kolmogorov distance of their headway and TTC at the onset from the same people's as the scenario would show them:
  at constant speeds, and with no onset before each time of `LATE`;
- by least squares, how the logarithm of the headway at which they turn the wheel goes with that of the closing speed
  over their own at the start: slope (0 of somebody who minds the headway alone, 1 of one who minds the TTC alone) and
  deviation of the rest, and the factor on the synthetic drivers' own headways and TTCs that gives the same mean.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from sumo_eval.drivers.recorded.events import RULES
from sumo_eval.drivers.synthetic.population import ONSET_HEADWAY, ONSET_TTC

SHOWS = 1.4  # s from the turn of the wheel until a lane change shows: median of 800 synthetic drivers
LATE = (0.0, 1.2, 2.2, 2.9)
"""s. Nobody; the first, the median and the last of 95 % of the synthetic drivers who want to begin at once."""


def line(name: str, people: pd.DataFrame) -> str:
    """A row: who, how many, begun before, distances of headway and TTC for each time, slope, deviation, factor."""
    share = 1.0 - people["lead_speed"] / people["ego_speed"]
    headway, ttc = people["headway_at_onset"], people["ttc_at_onset"]
    turned = np.log(headway + SHOWS * share)
    weight, mean = np.polyfit(np.log(share), turned, 1)
    rest = turned - np.polyval((weight, mean), np.log(share))
    factor = math.exp(mean - (1.0 - weight) * ONSET_HEADWAY.mu - weight * ONSET_TTC.mu)
    shown = [np.minimum(headway, RULES.approach_headway - late * share) for late in LATE]
    far = [(stats.ks_2samp(headway, it).statistic, stats.ks_2samp(ttc, it / share).statistic) for it in shown]
    return (
        f"| {name} | {len(people)} | {(people['change_onset'] < 0.0).sum()} | "
        + " | ".join(f"{a:.2f}, {b:.2f}" for a, b in far)
        + f" | {weight:.2f} | {rest.std():.2f} | {factor:.2f} |"
    )


if __name__ == "__main__":
    found = pd.read_csv(Path(sys.argv[1]))
    found = found[(found["start_kind"] == "range_crossing") & (found["lane"] == 0)]
    found = found[found["outcome"] == "lane_change"].dropna(subset=["headway_at_onset", "ttc_at_onset"])
    for recording, people in found.groupby("recording"):
        print(line(str(recording), people))
    print(line("all", found))
