"""Work out MOTORWAY_PEOPLE of `sumo_eval/method/plausibility.py` from the tables of recorded
people, and print it.

    python tools/motorway_people.py ../shared/data/human

Reads `dlr_ht/{approach,cutin,cutout}_{events.csv,series.parquet}` (DLR Highway Traffic v1.1.0). A
drive is one event's whole series, if it is 10 s or longer. Left out, and counted: rows marked
suspect, and drives with a lateral speed over 2 m/s, which are ghosts of the tracker by the rule of
`sumo_eval/drivers/recorded/events.py`. Needs the
`parquet` extra (duckdb).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd

from sumo_eval.drivers.recorded.events import GHOST_LATERAL_SPEED
from sumo_eval.method.measures import course_of
from sumo_eval.method.plausibility import Quantiles, extremes_of, quantiles_of
from sumo_eval.scenario.concrete import Road
from sumo_eval.trajectory import Trajectory

ROAD = Road("motorway", 600.0, 2, 3.75, 0.0)  # straight
LEAST_DURATION = 10.0  # s
LENGTH = 4.5  # m, of a body whose length is not in the table: gaps are, and they decide
OTHERS = {
    "approach": {"lead": "gap0"},
    "cutin": {"cut": "gap"},
    "cutout": {"cut": "gap_ego_cutout", "rev": "gap_ego_revealed"},
}
"""By kind of event: the other vehicles in its series, and the column with the bumper gap to each at
t = 0."""


def motorway_drives(folder: Path) -> Iterator[tuple[str, str, Trajectory, dict[str, Trajectory]]]:
    """Kind of event, person, the person's drive and the other vehicles, of every recorded
    encounter.
    """
    for kind, others in OTHERS.items():
        events = pd.read_csv(folder / "dlr_ht" / f"{kind}_events.csv")
        events = events[~events["suspect"]].set_index("event_id")
        path = folder / "dlr_ht" / f"{kind}_series.parquet"
        series = duckdb.read_parquet(str(path)).order("event_id, t").df()
        for name, rows in series.groupby("event_id", sort=False):
            if name not in events.index or np.ptp(rows["t"]) < LEAST_DURATION - 1e-3:
                continue
            event = events.loc[name]
            actors = {other: _track(rows, other, rows, event[gap]) for other, gap in others.items()}
            seen = {other: actor for other, actor in actors.items() if actor is not None}
            ego = _track(rows, "ego", None, 0.0)
            assert ego is not None
            yield kind, str(event["ego"]), ego, seen


def _track(
    rows: pd.DataFrame, prefix: str, ego: pd.DataFrame | None, gap: float
) -> Trajectory | None:
    """One vehicle of a series.

    Its length is what makes the bumper gap at t = 0 the table's, where that is known.
    """
    there = rows[rows[f"{prefix}_x"].notna()]
    if len(there) < 2:
        return None
    length = LENGTH
    at_zero = there[there["t"].abs() < 0.05]
    if ego is not None and len(at_zero) and np.isfinite(gap):
        apart = float(at_zero[f"{prefix}_x"].iloc[0] - at_zero["ego_x"].iloc[0])
        length = max(2.0 * (apart - gap) - LENGTH, 0.1)
    time = np.round(there["t"].to_numpy(dtype=np.float64), 3)
    x, y, speed, acceleration = (there[f"{prefix}_{name}"] for name in ("x", "y", "v", "a"))
    return Trajectory(time, x, y, np.zeros(len(there)), speed, acceleration, length=length)


def motorway_people(folder: Path) -> tuple[Quantiles, int]:
    """The table, rounded to three digits after the point, and how many drives were left out as
    ghosts.
    """
    drives = [
        (who, extremes_of(course_of(ego, actors, None, ROAD)))
        for _, who, ego, actors in motorway_drives(folder)
    ]
    kept = [one for one in drives if not one[1]["max_lateral_speed"] > GHOST_LATERAL_SPEED]
    exact = quantiles_of([found for _, found in kept], [who for who, _ in kept])
    rounded = Quantiles(
        {name: tuple(round(value, 3) for value in values) for name, values in exact.values.items()},
        {name: tuple(round(share, 5) for share in shares) for name, shares in exact.shares.items()},
        exact.people,
        exact.drives,
        "DLR Highway Traffic v1.1.0, motorway near Braunschweig, 2024-10-07",
    )
    return rounded, len(drives) - len(kept)


if __name__ == "__main__":
    table, ghosts = motorway_people(Path(sys.argv[1]))
    print(f"{table.people} people, {table.drives} drives; {ghosts} left out as ghosts\nvalues={{")
    for rows in (table.values, table.shares):
        for name, numbers in rows.items():
            print(f'    "{name}": {numbers},')
        print("}\nshares={" if rows is table.values else "}")
