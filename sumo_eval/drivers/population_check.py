"""The synthetic population beside recorded people: the same quantities of both, and where they differ.

Both sides are measured with the same rules on the same kind of situation: an approach to a slower leader in the right
lane whose gap passes through 3.5 s. The synthetic drivers approach at the recorded events' own speeds, in SUMO.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

from sumo_eval.drivers.events import Events, RecordedLaneChange, Traffic, find_lane_changes
from sumo_eval.drivers.population import draw_driver
from sumo_eval.drivers.synthetic import synthetic_reference
from sumo_eval.scenario import catalogue
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import FloatArray, Recording

QUANTITIES = {
    "headway": "time headway while following, s (least of each approach that ends in following)",
    "onset_headway": "time headway where a lane change begins, s",
    "onset_ttc": "TTC where a lane change begins, s",
    "duration": "duration of a lane change (lateral speed over 0.12 m/s), s",
    "middle": "time from 10 to 90 % of a lane change, s",
    "min_acceleration": "strongest braking of an approach, m/s2 (negative)",
}
"""What is compared: name -> words."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One quantity of both. Quantiles at 10, 50 and 90 %; distance: Kolmogorov-Smirnov, 0..1; p_value: that both are
    drawn from one distribution. A share has its value in `middle` and no quantiles.
    """

    name: str
    about: str
    recorded: tuple[float, ...]
    synthetic: tuple[float, ...]
    recorded_count: int
    synthetic_count: int
    distance: float
    p_value: float

    @property
    def words(self) -> str:
        """Whether they differ, in plain words."""
        if not np.isfinite(self.distance):
            return "too few to compare"
        if self.p_value >= 0.05:
            return "no difference shown"
        low = "lower" if self.synthetic[len(self.synthetic) // 2] < self.recorded[len(self.recorded) // 2] else "higher"
        return f"differs: the synthetic drivers' values are {low} (p = {self.p_value:.2g})"


def compare_population(
    events: Events, *, drivers: int, seed: int, progress: Callable[[int, int], None] = lambda done, total: None
) -> list[Comparison]:
    """Every quantity of the recorded people and of `drivers` synthetic ones who approach as they did.

    Recorded: cars and vans in the right lane. Synthetic: driver i in an event drawn at random (seeded), speeds held
    within the range of `front_vehicle_low_speed`.
    """
    approaches = events.tables["approach"]
    theirs = approaches[(approaches["start_kind"] == "range_crossing") & (approaches["lane"] == 0)]
    recorded = _measured(theirs)
    changes = events.lane_changes[events.lane_changes["complete"].astype(bool) & (events.lane_changes["to"] > 0)]
    recorded["duration"] = changes["duration"].to_numpy(dtype=np.float64)
    recorded["middle"] = changes["middle"].to_numpy(dtype=np.float64)

    logical = catalogue.load("front_vehicle_low_speed")
    stream = np.random.default_rng(seed)
    rows = theirs.sort_values(["recording", "ego", "t"]).reset_index(drop=True)
    drives: list[dict[str, float]] = []
    for index in range(drivers):
        event = rows.iloc[int(stream.integers(len(rows)))]
        values = {
            name: float(np.clip(event[name], item.low, item.high))
            for name, item in zip(("ego_speed", "lead_speed"), logical.parameters, strict=True)
        }
        if values["ego_speed"] - values["lead_speed"] < 2.0:
            continue
        concrete = logical.concrete(**values)
        recording = synthetic_reference(concrete, [draw_driver(index, seed)], SimulationSettings(), seed=seed)[0]
        drives.append(_approach(recording, concrete.road.lane_width))
        progress(index + 1, drivers)
    return _table(recorded, pd.DataFrame(drives), theirs, len(drives))


def _measured(approaches: pd.DataFrame) -> dict[str, FloatArray]:
    changed = approaches[approaches["outcome"] == "lane_change"]
    followed = approaches[approaches["outcome"] == "follow"]
    return {
        "headway": (followed["min_gap"] / followed["ego_speed"]).to_numpy(dtype=np.float64),
        "onset_headway": changed["headway_at_onset"].to_numpy(dtype=np.float64),
        "onset_ttc": changed["ttc_at_onset"].to_numpy(dtype=np.float64),
        "min_acceleration": approaches["min_acceleration"].to_numpy(dtype=np.float64),
    }


def _approach(recording: Recording, lane_width: float) -> dict[str, float]:
    """What one synthetic drive shows, by the rules for recorded ones. nan: does not apply."""
    ego, lead = recording.ego, recording.actors["lead"]
    n = min(len(ego), len(lead))
    tracks = []
    for name, vehicle in (("ego", ego), ("lead", lead)):
        table = pd.DataFrame(
            {name_: getattr(vehicle, name_)[:n] for name_ in ("x", "y", "heading", "speed", "acceleration")}
        )
        table["t"] = np.round(vehicle.time[:n], 3)
        tracks.append(
            table.assign(
                vehicle=name,
                length=vehicle.length,
                width=vehicle.width,
                lane=np.round(vehicle.y[:n] / lane_width).astype(int),
                **{"class": "car"},
            )
        )
    traffic = Traffic(pd.concat(tracks, ignore_index=True))
    change: RecordedLaneChange | None = next(
        (item for item in find_lane_changes(traffic) if item.vehicle == "ego" and item.to == 1), None
    )
    part = traffic.slices["ego"]
    end = part.stop if change is None else change.row
    gap, closing = traffic.gap[part.start : end], traffic.closing[part.start : end]
    speed = traffic.rows["speed"].to_numpy()[part.start : end]
    acceleration = traffic.rows["acceleration"].to_numpy()[part.start : end]
    found = dict.fromkeys(QUANTITIES, np.nan) | {
        "overtakes": float(change is not None),
        "min_acceleration": float(acceleration.min()),
    }
    if change is None:
        found["headway"] = float(gap.min() / speed[0])
        return found
    at = max(round(change.onset / 0.1), 0)
    found["onset_headway"] = float(gap[at] / max(speed[at], 0.1))
    found["onset_ttc"] = float(gap[at] / closing[at]) if closing[at] > 0 else np.nan
    found["duration"] = change.duration if change.complete else np.nan
    found["middle"] = change.middle if change.complete and change.middle is not None else np.nan
    return found


def _table(
    recorded: dict[str, FloatArray], synthetic: pd.DataFrame, approaches: pd.DataFrame, drives: int
) -> list[Comparison]:
    rows = []
    for name, about in QUANTITIES.items():
        real, made = (_finite(values) for values in (recorded[name], synthetic[name].to_numpy(dtype=np.float64)))
        enough = len(real) >= 5 and len(made) >= 5
        test = stats.ks_2samp(real, made) if enough else None
        rows.append(
            Comparison(
                name,
                about,
                _quantiles(real),
                _quantiles(made),
                len(real),
                len(made),
                float(test.statistic) if test else float("nan"),
                float(test.pvalue) if test else float("nan"),
            )
        )
    decided = approaches[approaches["outcome"].isin(["lane_change", "follow"])]
    overtook = int((decided["outcome"] == "lane_change").sum())
    made_overtake = int(synthetic["overtakes"].sum())
    table = [[overtook, len(decided) - overtook], [made_overtake, drives - made_overtake]]
    rows.append(
        Comparison(
            "overtakes",
            "share of approaches that end in a lane change rather than in following",
            (overtook / max(len(decided), 1),),
            (made_overtake / max(drives, 1),),
            len(decided),
            drives,
            abs(overtook / max(len(decided), 1) - made_overtake / max(drives, 1)),
            float(stats.fisher_exact(np.array(table)).pvalue),
        )
    )
    return rows


def _finite(values: FloatArray) -> FloatArray:
    finite: FloatArray = values[np.isfinite(values)]
    return finite


def _quantiles(values: Sequence[float] | FloatArray) -> tuple[float, ...]:
    if len(values) == 0:
        return (float("nan"),) * 3
    return tuple(float(value) for value in np.quantile(values, (0.1, 0.5, 0.9)))
