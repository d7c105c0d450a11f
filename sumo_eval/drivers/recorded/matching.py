"""Recorded events that show a logical scenario on the road, and which of their columns are its
parameters.

A scenario file may state this itself ([recorded]); for shipped scenarios that do not it stands
here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import pandas as pd

from sumo_eval.drivers.recorded.events import Events
from sumo_eval.errors import InputError, unknown
from sumo_eval.scenario.logical import Counterpart


@dataclass(frozen=True, slots=True)
class Match:
    """kind: of event.
    columns: column by parameter.
    tolerance: how far a parameter may be off, by parameter.
    start: the column with the time that is the scenario's t = 0.
    only: values that a column must have.
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
        # the gap passes through 3.5 s: the paper's initial gap
        only={"start_kind": "range_crossing"},
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
        {
            "ego_speed": "ego_speed",
            "cut_in_speed": "cut_in_speed",
            "gap": "gap",
            "lateral_speed": "lateral_speed",
        },
        {"ego_speed": 2.5, "cut_in_speed": 2.5, "gap": 10.0, "lateral_speed": 0.5},
    ),
}


STARTS: Final[Mapping[str, str]] = {"approach": "t"}
"""The column with the time at which a scenario begins, by kind of event; `start` of any other."""


def known_match(scenario: str, recorded: Counterpart | None = None) -> Match | None:
    """The match of a scenario, from its own `recorded`, else by its name; None where neither has
    one.
    """
    if recorded is None:
        return MATCHES.get(scenario)
    start = recorded.start or STARTS.get(recorded.event, "start")
    return Match(
        recorded.event, dict(recorded.columns), dict(recorded.tolerance), start, dict(recorded.only)
    )


def match_of(scenario: str, recorded: Counterpart | None = None) -> Match:
    """The match of a scenario; refuses one that no recorded event corresponds to."""
    match = known_match(scenario, recorded)
    if match is None:
        raise InputError(
            f"There is no recorded event that corresponds to scenario `{scenario}`; recordings "
            "serve "
            f"{', '.join(MATCHES)}, and files that name their event in [recorded]."
        )
    return match


def matching_events(
    events: Events, scenario: str, recorded: Counterpart | None = None
) -> pd.DataFrame:
    """The events that correspond to a scenario, its parameters as columns of that name, complete
    ones only.

    Raises InputError for a column that its events do not have.
    """
    match = match_of(scenario, recorded)
    table = events.tables[match.kind]
    named = [*match.columns.values(), match.start, *(match.only or {})]
    for column in named if recorded is not None and len(table) else ():
        if column not in table:
            owner = f"column of `{match.kind}` events in [recorded] of scenario `{scenario}`:"
            raise unknown(owner, column, [str(name) for name in table])
    for column, value in (match.only or {}).items():
        table = table[table[column].astype(str) == value] if column in table else table
    chosen = pd.DataFrame({name: table[name] for name in ("event", "recording", "ego")})
    chosen["start"] = table[match.start] if match.start in table else pd.Series(dtype=float)
    for parameter, column in match.columns.items():
        chosen[parameter] = (
            table[column].astype(float) if column in table else pd.Series(dtype=float)
        )
    return chosen.dropna().reset_index(drop=True)
