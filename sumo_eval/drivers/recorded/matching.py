"""Recorded events that show a logical scenario on the road, and which of their columns are its
parameters.

A scenario file may state this itself ([recorded]); for shipped scenarios that do not it stands
here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

from sumo_eval.drivers.recorded.events import Events
from sumo_eval.errors import InputError, unknown
from sumo_eval.scenario.logical import Counterpart


class Match(NamedTuple):
    """Events that show a scenario.

    kind: of event.
    columns: column by parameter.
    tolerance: how far a parameter may be off, by parameter.
    start: the column with the time that is the scenario's t = 0.
    only: values that a column must have.
    """

    kind: str
    columns: Mapping[str, str]
    tolerance: Mapping[str, float]
    start: str = "start"
    only: Mapping[str, str] = {}


def _same(
    kind: str,
    tolerance: Mapping[str, float],
    start: str = "start",
    only: Mapping[str, str] = {},
) -> Match:
    """The match of a scenario whose parameters are called as the columns are."""
    return Match(kind, {name: name for name in tolerance}, tolerance, start, only)


MATCHES: Mapping[str, Match] = {
    # the gap passes through 3.5 s: the paper's initial gap
    "front_vehicle_low_speed": _same(
        "approach", {"ego_speed": 2.5, "lead_speed": 2.5}, "t", {"start_kind": "range_crossing"}
    ),
    "front_vehicle_cut_out": _same(
        "cut_out", {"ego_speed": 2.5, "obstacle_speed": 2.5, "gap": 15.0}
    ),
    "front_vehicle_braking": _same(
        "lead_braking", {"ego_speed": 2.5, "headway": 0.3, "lead_deceleration": 1.0}
    ),
    "cut_in": _same(
        "cut_in", {"ego_speed": 2.5, "cut_in_speed": 2.5, "gap": 10.0, "lateral_speed": 0.5}
    ),
}


def known_match(scenario: str, recorded: Counterpart | None = None) -> Match | None:
    """The match of a scenario, from its own `recorded`, else by its name; None where neither has
    one.
    """
    if recorded is None:
        return MATCHES.get(scenario)
    start = recorded.start or ("t" if recorded.event == "approach" else "start")
    return Match(
        recorded.event, dict(recorded.columns), dict(recorded.tolerance), start, dict(recorded.only)
    )


def match_of(scenario: str, recorded: Counterpart | None = None) -> Match:
    """The match of a scenario; refuses one that no recorded event corresponds to."""
    match = known_match(scenario, recorded)
    if match is None:
        raise InputError(
            f"There is no recorded event that corresponds to scenario `{scenario}`; recordings "
            f"serve {', '.join(MATCHES)}, and files that name their event in [recorded]."
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
    if recorded is not None and len(table):
        for column in (*match.columns.values(), match.start, *match.only):
            if column not in table:
                owner = f"column of `{match.kind}` events in [recorded] of scenario `{scenario}`:"
                raise unknown(owner, column, [str(name) for name in table])
    for column, value in match.only.items():
        table = table[table[column].astype(str) == value] if column in table else table
    columns = {"start": match.start, **match.columns}
    names = ["event", "recording", "ego"]
    chosen = table.reindex(columns=[*names, *columns.values()])
    chosen.columns = pd.Index([*names, *columns])
    try:
        return chosen.astype(dict.fromkeys(columns, float)).dropna().reset_index(drop=True)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"[recorded] of scenario `{scenario}` must name columns of numbers: {error}."
        ) from error
