"""A scenario whose probability of collision is known in closed form: three normal parameters and a
plane."""

import tomllib
from pathlib import Path

import numpy as np
from scipy.special import ndtr, ndtri

from sumo_eval.extras.rates.exposure import normalised_exposure
from sumo_eval.extras.rates.importance import RareEvents
from sumo_eval.scenario.file import scenario_from

SPREAD = {"ego_speed": (25.0, 1.5), "lead_speed": (15.0, 1.5), "headway": (2.5, 0.25)}
TOWARDS = np.array([1.0, -1.0, -1.0]) / np.sqrt(3.0)  # faster ego, slower lead, shorter gap


def logical(folder=Path(), **more):
    parameters = [
        {
            "name": name,
            "unit": "m/s",
            "low": mean - 7.0 * deviation,
            "high": mean + 7.0 * deviation,
            "step": deviation,
            "distribution": {"name": "norm", "loc": mean, "scale": deviation},
        }
        for name, (mean, deviation) in SPREAD.items()
    ]
    content = {
        **tomllib.loads("""
name = "rare"
ego = { speed = "ego_speed" }
vehicle = [{ name = "lead", speed = "lead_speed", gap = "headway * ego_speed" }]
zone = { obstacle = "lead" }
"""),
        "parameter": parameters,
        **more,
    }
    return scenario_from(content, "the rare scenario", folder)


def collides(points, probability):
    """Beyond a plane so far from the middle that it is crossed with this probability."""
    means, deviations = (np.array(item) for item in zip(*SPREAD.values(), strict=True))
    return ((points - means) / deviations) @ TOWARDS > -ndtri(probability)


def estimate(probability, budget, seed):
    search = RareEvents(normalised_exposure(logical()), budget, seed)
    while len((batch := search.ask()).points):
        hit = collides(batch.points, probability)
        search.tell(batch, hit, 0.5 * hit)
    return search.estimate()


assert abs(ndtr(ndtri(1e-6)) - 1e-6) < 1e-12
