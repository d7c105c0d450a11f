"""How often a KDE has what is rare among its events, over how often it is met in truth. Prints a table of
docs/campaign.md.

    python tools/kernel_tails.py

Events of one parameter are drawn from a known distribution, 100 times 100, 400 and 600 of them; a KDE with the
bandwidth that Scott's rule has for two parameters is fitted; what it has beyond the place that one in 33, 200 and 500
is beyond, is compared with that. Both forms of the KDE: as wide as its kernels make it, which is driven, and narrow.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from sumo_eval.scenario.joint import Joint

SHAPES = {
    "normal": stats.norm(),
    "Student's t, 5 degrees of freedom": stats.t(5),
    "exponential": stats.expon(),
    "gamma of shape 4, its long tail": stats.gamma(4),
    "log-normal of sigma 0.5, its long tail": stats.lognorm(0.5),
    "gamma of shape 4, its short tail": stats.gamma(4),
}
CASES = ((100, 3e-2), (400, 5e-3), (600, 2e-3))  # events, and how often a collision is met
REPETITIONS = 100
PLACES = 800  # at which the tail is integrated


def over_the_truth(shape: str, events: int, rare: float, narrow: bool) -> float:
    """The mean of what KDEs have beyond the place that a share `rare` is beyond, over that share."""
    known, sign = SHAPES[shape], -1.0 if "short" in shape else 1.0
    edge = float(known.ppf(1.0 - rare) if sign > 0.0 else -known.ppf(rare))
    found = []
    for seed in range(REPETITIONS):
        values = sign * known.rvs(events, random_state=np.random.default_rng([seed, events]))
        rows = tuple((float(value),) for value in values)
        end = max(float(values.max()), edge) + 6.0 * float(values.std())
        joint = Joint("kde", ("a",), rows, (-1e3,), (end,), events ** (-1.0 / 6.0), narrow=narrow)
        width = (end - edge) / PLACES
        middles = edge + width * (np.arange(PLACES) + 0.5)
        found.append(float(joint.density(middles[:, None]).sum()) * width)
    return float(np.mean(found)) / rare


if __name__ == "__main__":
    print("| events from | form | " + " | ".join(f"{rare:g}, {events} events" for events, rare in CASES) + " |")
    print("|---|---|" + "---|" * len(CASES))
    for shape in SHAPES:
        for narrow in (False, True):
            told = (f"{over_the_truth(shape, events, rare, narrow):.2f}" for events, rare in CASES)
            print(f"| {shape} | {'narrow' if narrow else 'as driven'} | " + " | ".join(told) + " |", flush=True)
