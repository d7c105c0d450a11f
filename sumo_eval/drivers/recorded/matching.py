"""Recorded events that show a logical scenario on the road."""

from __future__ import annotations

import pandas as pd

from sumo_eval.drivers.recorded.events import Events
from sumo_eval.errors import InputError, check_known
from sumo_eval.scenario.logical import Counterpart


def matching_events(events: Events, scenario: str, recorded: Counterpart) -> pd.DataFrame:
    """The complete events that correspond to a scenario, with a column for each parameter, under
    its name.

    scenario: its name, for errors.

    Raises InputError for a column that its events do not have, or that holds no numbers.
    """
    table, columns = events.tables[recorded.event], dict(recorded.columns)
    if len(table):  # without events it has none of these columns
        owner = f"column of `{recorded.event}` events in [recorded] of scenario `{scenario}`:"
        check_known(
            owner, list(map(str, table)), *columns.values(), recorded.start, *dict(recorded.only)
        )
        for column, value in recorded.only:
            table = table[table[column].astype(str) == value]
    columns = {"start": recorded.start, **columns}
    names = ["event", "recording", "ego"]
    chosen = table.reindex(columns=[*names, *columns.values()])
    chosen.columns = pd.Index([*names, *columns])
    try:
        return chosen.astype(dict.fromkeys(columns, float)).dropna().reset_index(drop=True)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"[recorded] of scenario `{scenario}` must name columns of numbers: {error}."
        ) from error
