"""The fit of the limits at which drivers begin to overtake: it finds those by which planted people did."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

PLANTED = (0.7, 0.3, 2.3, 0.4)  # means and deviations of the logarithms: headways of 2.0 s, TTCs of 10 s


@pytest.fixture(scope="module")
def tool():
    path = Path(__file__).resolve().parents[2] / "tools" / "onsets.py"
    spec = importlib.util.spec_from_file_location("onsets", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def people(tool):
    """Who turns the wheel below his headway or his TTC, whichever is first, and is still in his lane at 3.5 s."""
    stream = np.random.default_rng(5)
    headway, headway_deviation, ttc, ttc_deviation = PLANTED
    share = stream.uniform(0.07, 0.4, 3_000)
    turned = np.maximum(
        np.exp(stream.normal(headway, headway_deviation, 3_000)),
        np.exp(stream.normal(ttc, ttc_deviation, 3_000)) * share,
    )
    onset = turned - tool.SHOWS * share
    seen = (onset - tool.LEAVES * share < 3.5) & (onset > 0.0)
    assert seen.mean() < 0.97  # some left before, and nobody knows of them
    return pd.DataFrame(
        {
            "ego_speed": 30.0,
            "lead_speed": 30.0 * (1.0 - share),
            "headway_at_onset": onset,
            "ttc_at_onset": onset / share,
        }
    )[seen]


def test_the_planted_limits_are_found_though_the_earliest_are_not_among_the_recorded(tool, people):
    found = tool.most_likely(people)
    # Half of some 2,800 people begin by their headway: its mean is known to 0.3 / sqrt(1,400) = 0.008.
    assert found == pytest.approx(PLANTED, abs=0.04)
    assert max(tool.distances(found, people)) < 0.03


def test_peoples_own_onsets_taken_for_limits_would_begin_too_early(tool, people):
    logs = [np.log(people[name]) for name in ("headway_at_onset", "ttc_at_onset")]
    taken = tool.Limits(logs[0].mean(), logs[0].std(), logs[1].mean(), logs[1].std())
    assert min(tool.distances(taken, people)) > 2.0 * max(tool.distances(tool.most_likely(people), people))
