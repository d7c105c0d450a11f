"""The synthetic population beside recorded people: the same quantities of both, and where they differ.

Both sides are measured with the same rules on the same kind of situation: an approach to a slower leader in the right
lane whose gap passes through 3.5 s. The synthetic drivers approach at the recorded events' own speeds, in SUMO, from so
far behind that none of them has a reason yet to begin a lane change, as people do: begun at the gap of 3.5 s itself, a
drive shows no onset before it, and the first that it shows are late.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import stats

from sumo_eval.drivers.recorded.events import Events, extract_events
from sumo_eval.drivers.recorded.recordings import Recordings
from sumo_eval.drivers.synthetic.driver import synthetic_reference
from sumo_eval.drivers.synthetic.population import (
    AS_RECORDED,
    HEADWAY_LIMIT,
    ONSET_HEADWAY,
    ONSET_TTC,
    TTC_LIMIT,
    draw_driver,
)
from sumo_eval.errors import InputError
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import PopulationSettings, SimulationSettings
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

NOBODY = max(ONSET_HEADWAY.high, HEADWAY_LIMIT.high), max(ONSET_TTC.high, TTC_LIMIT.high)
"""s, headway and TTC above which no driver begins a lane change, whatever `[drivers.population] onset` says."""

FURTHER = 2_500.0
"""m that are driven after the gap of 3.5 s, as of half the people of DLR Highway Traffic: of their lane changes every
tenth begins later than 600 m after it, where the scenario's road ends."""


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
    events: Events,
    *,
    drivers: int,
    seed: int,
    population: PopulationSettings = AS_RECORDED,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Comparison]:
    """Every quantity of the recorded people and of `drivers` synthetic ones who approach as they did.

    Recorded: every motor vehicle in the right lane. Synthetic: driver i at the speeds of an event drawn at random
    (seeded). population: how the synthetic drivers are told to differ from the ones that ship. Raises InputError where
    nobody approaches.
    """
    approaches = events.tables["approach"]
    theirs = through_the_gap(approaches)
    recorded = _measured(theirs, events.lane_changes)

    shipped = catalogue.load("front_vehicle_low_speed")
    wide = tuple(replace(item, low=1.0, high=60.0) for item in shipped.parameters)
    logical = replace(shipped, parameters=wide)  # the recorded events' own speeds, also where they leave the space
    stream = np.random.default_rng(seed)
    rows = theirs.sort_values(["recording", "ego", "t"]).reset_index(drop=True)
    if rows.empty:
        raise InputError("The recordings must hold at least one approach in the right lane through 3.5 s, got none.")
    made, changes = [], []
    for index in range(drivers):
        event = rows.iloc[int(stream.integers(len(rows)))]
        here = logical.concrete(ego_speed=float(event["ego_speed"]), lead_speed=float(event["lead_speed"]))
        concrete = _from_further_back(here)
        recording = synthetic_reference(
            concrete, [draw_driver(index, seed, population)], SimulationSettings(), seed=seed
        )[0]
        approach, change = _approach(recording, concrete.road.lane_width)
        made.append(approach)
        changes.append(change)
        progress(index + 1, drivers)
    approaches = through_the_gap(pd.concat(made, ignore_index=True))
    return _table(recorded, _measured(approaches, pd.concat(changes, ignore_index=True)), theirs, approaches)


def through_the_gap(approaches: pd.DataFrame) -> pd.DataFrame:
    """Those in the right lane whose gap passes through 3.5 s."""
    return approaches[(approaches["start_kind"] == "range_crossing") & (approaches["lane"] == 0)]


def _measured(approaches: pd.DataFrame, changes: pd.DataFrame) -> dict[str, FloatArray]:
    to_left = changes[changes["complete"].astype(bool) & (changes["to"] > changes["origin"])]
    changed = approaches[approaches["outcome"] == "lane_change"]
    followed = approaches[approaches["outcome"] == "follow"]
    return {
        "headway": (followed["min_gap"] / followed["ego_speed"]).to_numpy(dtype=np.float64),
        "onset_headway": changed["headway_at_onset"].to_numpy(dtype=np.float64),
        "onset_ttc": changed["ttc_at_onset"].to_numpy(dtype=np.float64),
        "min_acceleration": approaches["min_acceleration"].to_numpy(dtype=np.float64),
        "duration": to_left["duration"].to_numpy(dtype=np.float64),
        "middle": to_left["middle"].to_numpy(dtype=np.float64),
    }


def _from_further_back(concrete: ConcreteScenario) -> ConcreteScenario:
    """An approach begun where nobody has a reason to overtake, with `FURTHER` of road after the gap that it had."""
    lead = concrete.actors[0]
    closing = concrete.ego.speed - lead.start.speed
    body = concrete.ego_vehicle(SimulationSettings().vehicle)
    gap = lead.start.x - concrete.ego.x - 0.5 * (lead.length + body.length)
    headway, ttc = NOBODY
    more = max(headway * concrete.ego.speed, ttc * closing, gap) - gap
    until = concrete.ego.speed * more / closing
    return replace(
        concrete,
        actors=(replace(lead, start=replace(lead.start, x=lead.start.x + more)), *concrete.actors[1:]),
        road=replace(concrete.road, length=concrete.ego.x + until + FURTHER),
    )


def _approach(recording: Recording, lane_width: float) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The approach and the first lane change of one synthetic drive, found by the rules for recorded ones."""
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
    events = extract_events(Recordings(pd.concat(tracks, ignore_index=True).assign(recording="synthetic")))
    mine = events.tables["approach"]
    return mine[mine["ego"] == "ego"].head(1), events.lane_changes[events.lane_changes["vehicle"] == "ego"].head(1)


def _table(
    recorded: dict[str, FloatArray], synthetic: dict[str, FloatArray], theirs: pd.DataFrame, made: pd.DataFrame
) -> list[Comparison]:
    rows = []
    for name, about in QUANTITIES.items():
        real, fake = (_finite(values) for values in (recorded[name], synthetic[name]))
        enough = len(real) >= 5 and len(fake) >= 5
        test = stats.ks_2samp(real, fake) if enough else None
        rows.append(
            Comparison(
                name,
                about,
                _quantiles(real),
                _quantiles(fake),
                len(real),
                len(fake),
                float(test.statistic) if test else float("nan"),
                float(test.pvalue) if test else float("nan"),
            )
        )
    shares = [_share_overtaking(approaches) for approaches in (theirs, made)]
    (real_share, real_n), (made_share, made_n) = shares
    table = np.array([[share * n, (1.0 - share) * n] for share, n in shares]).round().astype(int)
    rows.append(
        Comparison(
            "overtakes",
            "share of approaches that end in a lane change rather than in following",
            (real_share,),
            (made_share,),
            real_n,
            made_n,
            abs(real_share - made_share),
            float(stats.fisher_exact(table).pvalue),
        )
    )
    return rows


def _share_overtaking(approaches: pd.DataFrame) -> tuple[float, int]:
    """Share of decided approaches that end in a lane change, and how many were decided."""
    decided = approaches[approaches["outcome"].isin(["lane_change", "follow"])]
    return float((decided["outcome"] == "lane_change").mean()) if len(decided) else float("nan"), len(decided)


def _finite(values: FloatArray) -> FloatArray:
    finite: FloatArray = values[np.isfinite(values)]
    return finite


def _quantiles(values: Sequence[float] | FloatArray) -> tuple[float, ...]:
    if len(values) == 0:
        return (float("nan"),) * 3
    return tuple(float(value) for value in np.quantile(values, (0.1, 0.5, 0.9)))
