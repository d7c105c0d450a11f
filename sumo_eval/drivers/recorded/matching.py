"""Which recorded events are a shipped logical scenario met on the road, and which of their columns are its
parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import pandas as pd

from sumo_eval.drivers.recorded.events import Events
from sumo_eval.errors import InputError


@dataclass(frozen=True, slots=True)
class Match:
    """kind: of event. columns: column by parameter. tolerance: how far a parameter may be off, by parameter. start: the
    column with the time that is the scenario's t = 0. only: values that a column must have.
    """

    kind: str
    columns: Mapping[str, str]
    tolerance: Mapping[str, float]
    start: str = "start"
    only: Mapping[str, str] | None = None


MATCHES: Final[Mapping[str, Match]] = {
    "front_vehicle_low_speed": Match(
        "approach",
        {"ego_speed": "ego_speed", "lead_speed": "lead_speed"},
        {"ego_speed": 2.5, "lead_speed": 2.5},
        start="t",
        only={"start_kind": "range_crossing"},  # the gap passes through 3.5 s: the paper's initial gap
    ),
    "front_vehicle_cut_out": Match(
        "cut_out",
        {"ego_speed": "ego_speed", "obstacle_speed": "obstacle_speed", "gap": "gap"},
        {"ego_speed": 2.5, "obstacle_speed": 2.5, "gap": 15.0},
    ),
    "front_vehicle_braking": Match(
        "lead_braking",
        {"ego_speed": "ego_speed", "headway": "headway", "lead_deceleration": "lead_deceleration"},
        {"ego_speed": 2.5, "headway": 0.3, "lead_deceleration": 1.0},
    ),
    "cut_in": Match(
        "cut_in",
        {"ego_speed": "ego_speed", "cut_in_speed": "cut_in_speed", "gap": "gap", "lateral_speed": "lateral_speed"},
        {"ego_speed": 2.5, "cut_in_speed": 2.5, "gap": 10.0, "lateral_speed": 0.5},
    ),
}


def match_of(scenario: str) -> Match:
    """The match of a scenario; refuses one that no recorded event corresponds to."""
    if scenario not in MATCHES:
        raise InputError(
            f"There is no recorded event that corresponds to scenario `{scenario}`; "
            f"recordings serve {', '.join(MATCHES)}."
        )
    return MATCHES[scenario]


def matching_events(events: Events, scenario: str) -> pd.DataFrame:
    """The events that correspond to a scenario, its parameters as columns of that name, complete ones only."""
    match = match_of(scenario)
    table = events.tables[match.kind]
    for column, value in (match.only or {}).items():
        table = table[table[column] == value] if column in table else table
    chosen = pd.DataFrame({name: table[name] for name in ("event", "recording", "ego")})
    chosen["start"] = table[match.start] if match.start in table else pd.Series(dtype=float)
    for parameter, column in match.columns.items():
        chosen[parameter] = table[column].astype(float) if column in table else pd.Series(dtype=float)
    return chosen.dropna().reset_index(drop=True)
