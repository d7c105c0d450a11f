"""How much of D the choice of ten synthetic drivers decides, and how well an evaluation can tell it from its own ten.
Prints figures of docs/trust.md.

    python tools/drivers_part.py SCENARIO ADS [SEEDS] [POINTS]

The ADS drives the same safe points under every seed; the seed draws the drivers alone. Of ten, two or three follow, by
the rounding of the recorded share. What one more of those that were rounded down would do to D, times the deviation of
that number, is told in four ways:

- one out: from leaving out each one of the others, drawn on to a whole exchange;
- three out: the same from leaving out three overtakers at once, where the followers were rounded down;
- counted twice: from leaving out one of the others and counting one of those that were rounded down twice, as an
  evaluation does (`exchanges`);
- in truth: from an eleventh driver in the place of one of the others, whom an evaluation does not have.

`hold` counts seeds whose interval (Student's t, eight degrees of freedom) holds the mean of D over the seeds.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from sumo_eval.cosim.simulation import simulate_many
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.drivers.synthetic.population import AS_RECORDED, draw_driver
from sumo_eval.method.anthropomorphic import Pairing, anthropomorphic_indexes
from sumo_eval.method.danger import danger
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.scoring.confidence.drivers import stratified_deviations
from sumo_eval.settings import AnthropomorphicSettings, ZoneSettings
from sumo_eval.trajectory import Recording

DRIVERS, FREEDOM = 10, 8
SAFE = 0.3  # danger below which a point is taken to be safe
SLICES = 2.5  # m
WAYS = ("one out", "three out", "counted twice", "in truth")
EVERYBODY = tuple(range(DRIVERS))


def safe_drives(scenario: str, ads: str, count: int) -> tuple[list[ConcreteScenario], list[Recording]]:
    """Safe concrete scenarios, at most `count`, and the ADS's drives in them; those with a contact are left out."""
    logical = catalogue.load(scenario)
    points = evenly(logical, 400, np.random.default_rng(1))
    points = points[logical.feasible(points)]
    cases = list(logical.concretes(points[danger(logical, points, ZoneSettings()) < SAFE][:count]))
    drives = list(simulate_many(cases, ads))
    kept = [place for place, drive in enumerate(drives) if drive.collision is None]
    return [cases[place] for place in kept], [drives[place] for place in kept]


def of_seed(
    cases: Sequence[ConcreteScenario], drives: Sequence[Recording], seed: int
) -> tuple[float, int, list[float]]:
    """D with the ten drivers of a seed, how many of them follow, and the errors of D: that within followers and within
    overtakers, and that of the rounding in each of the `WAYS`.
    """
    overtakes = [draw_driver(index, seed).overtakes for index in EVERYBODY]
    whole = DRIVERS * AS_RECORDED.overtake_share
    fraction, more = whole % 1.0, sum(overtakes) > whole  # more: the overtakers were rounded up
    leave = [index for index in EVERYBODY if overtakes[index] == more]
    stay = [index for index in EVERYBODY if overtakes[index] != more]
    eleventh = next(i for i in itertools.count(DRIVERS) if draw_driver(i, seed).overtakes != more)
    at_once = 3 if more else 1

    def without(*left: int) -> tuple[int, ...]:
        return tuple(index for index in EVERYBODY if index not in left)

    groups = [tuple(leave[(a + b) % len(leave)] for b in range(at_once)) for a in range(len(leave))]
    sets = [
        [EVERYBODY],
        [without(index) for index in EVERYBODY],
        [without(*group) for group in groups],
        [tuple(sorted((*without(index), stay[a % len(stay)]))) for a, index in enumerate(leave)],
        [(*without(index), DRIVERS) for index in leave],
    ]
    who = (*EVERYBODY, eleventh)
    people = [human_controller(index, eleventh + 1, seed, case) for case in cases for index in who]
    recorded = iter(list(simulate_many([case for case in cases for _ in who], people)))
    pairings = [Pairing(len(who), drivers, SLICES) for kind in sets for drivers in kind]
    values = np.zeros(len(pairings))
    for case, drive in zip(cases, drives, strict=True):
        all_drives = [*(next(recorded).ego for _ in who), drive.ego]
        found = anthropomorphic_indexes(all_drives, pairings, case.road, AnthropomorphicSettings())
        values += np.array([index.value for index in found]) / len(cases)
    index, one_out, three_out, twice, truth = np.split(values, np.cumsum([len(kind) for kind in sets])[:-1])
    errors = stratified_deviations(one_out, overtakes)
    alone = (DRIVERS - 1) / len(stay) * (one_out[leave].mean() - index[0])
    three = (DRIVERS - at_once) / (at_once * len(stay)) * (three_out.mean() - index[0])
    changes = [alone, three, twice.mean() - index[0], truth.mean() - index[0]]
    rounding = math.sqrt(fraction * (1.0 - fraction)) * np.abs(changes)
    return float(index[0]), overtakes.count(False), [float(np.hypot.reduce(errors)), *rounding.tolist()]


def main(scenario: str, ads: str, seeds: int, points: int) -> None:
    """Print what the seeds do to D, and what is told of it."""
    cases, drives = safe_drives(scenario, ads, points)
    found = [of_seed(cases, drives, seed) for seed in range(1, seeds + 1)]
    index, followers = np.array([row[0] for row in found]), np.array([row[1] for row in found])
    errors = np.array([row[2] for row in found])
    print(f"{ads} in {scenario}: {len(cases)} points, {seeds} seeds, D {index.mean():.3f} +- {index.std(ddof=1):.3f}")
    for count in np.unique(followers):
        print(f"  {count} followers: {np.sum(followers == count)} seeds, D {index[followers == count].mean():.3f}")
    reach = float(stdtrit(FREEDOM, 0.975))
    for number, way in enumerate(WAYS, 1):
        error = np.hypot(errors[:, 0], errors[:, number])
        held = int(np.sum(np.abs(index - index.mean()) <= reach * error))
        print(
            f"  {way}: rounding {errors[:, number].mean():.3f}, together {np.sqrt(np.mean(error**2)):.3f} "
            f"(root mean square), {held} of {seeds} hold"
        )


if __name__ == "__main__":
    given = [int(number) for number in sys.argv[3:5]]
    main(sys.argv[1], sys.argv[2], *given, *(12, 6)[len(given) :])
