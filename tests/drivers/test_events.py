"""Events: rules on traffic worked by hand, and against the tables of real events."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from drivers.real_data import needs_recordings, recording
from scipy.integrate import cumulative_trapezoid

from sumo_eval.drivers.recorded.events import extract_events
from sumo_eval.drivers.recorded.importing import import_recordings
from sumo_eval.drivers.recorded.recordings import Recordings, read_csv
from sumo_eval.scenario.concrete import smooth_step


def track(name, x0, speed, *, y0=0.0, move=None, seconds=30.0, kind="car"):
    """A vehicle at `speed` (a number or a function of time);

    move: (begin, duration, offset) of a lane change.
    """
    time = np.round(np.arange(0.0, seconds, 0.1), 3)
    v = np.array([speed(t) for t in time]) if callable(speed) else np.full(time.size, float(speed))
    x = x0 + cumulative_trapezoid(v, dx=0.1, initial=0.0)
    y = np.full(time.size, y0)
    if move is not None:
        y = y0 + move[2] * smooth_step((time - move[0]) / move[1])
    return pd.DataFrame(
        {
            "recording": "r", "vehicle": name, "driver": "", "t": time, "x": x, "y": y,
            "heading": 0.0, "speed": v,
            "acceleration": np.gradient(v, 0.1), "length": 5.0, "width": 2.0, "class": kind,
            "lane": np.round(y / 3.5).astype(int), "steering": np.nan,
        }
    )  # fmt: skip


def events_of(*tracks):
    return extract_events(Recordings(pd.concat(tracks, ignore_index=True)))


def test_an_approach_begins_where_the_gap_passes_three_and_a_half_seconds():
    # Closing at 10 m/s from a gap of 200 - 5 = 195 m: 3.5 s * 30 m/s = 105 m is reached at 9.0 s;
    # lane change at 12 s, middle of a move of 4 s from 10 s on.
    found = events_of(track("ego", 0.0, 30.0, move=(10.0, 4.0, 3.5)), track("lead", 200.0, 20.0))
    (event,) = found.tables["approach"].itertuples()
    assert event.ego == "ego"
    assert event.lead == "lead"
    assert event.start_kind == "range_crossing"
    assert event.outcome == "lane_change"
    assert event.t == pytest.approx(9.0, abs=0.11)
    assert event.gap == pytest.approx(105.0, abs=1.1)
    assert event.t_outcome == pytest.approx(3.0, abs=0.2)
    # 10 s, and what it takes to move at 0.12 m/s
    assert event.change_onset == pytest.approx(1.5, abs=0.6)
    (change,) = found.lane_changes.itertuples()
    assert (change.vehicle, change.origin, change.to, change.complete) == ("ego", 0, 1, True)
    assert change.middle == pytest.approx(0.506 * 4.0, abs=0.35)


def test_slowing_down_behind_the_lead_is_following():
    ego = track("ego", 0.0, lambda t: max(30.0 - 1.0 * max(t - 10.0, 0.0), 20.0))
    (event,) = events_of(ego, track("lead", 200.0, 20.0)).tables["approach"].itertuples()
    assert event.outcome == "follow"
    assert event.min_acceleration == pytest.approx(-1.0, abs=0.05)
    # closing under 0.5 m/s: 30 - (t - 10) = 20.5
    assert event.t + event.t_outcome == pytest.approx(19.6, abs=0.3)


def test_no_approach_where_no_vehicle_comes_near():
    assert events_of(track("ego", 0.0, 20.5), track("lead", 60.0, 20.0)).tables["approach"].empty


def test_a_cut_out_begins_where_the_lead_begins_to_move():
    found = events_of(
        track("ego", 0.0, 25.0),
        track("lead", 45.0, 25.0, move=(5.0, 4.0, 3.5)),
        track("slow", 250.0, 20.0),
    )
    (event,) = found.tables["cut_out"].itertuples()
    assert (event.ego, event.cut_out, event.revealed, event.to_left) == (
        "ego",
        "lead",
        "slow",
        True,
    )
    assert event.t == pytest.approx(7.0, abs=0.15)
    assert event.gap_to_cut_out == pytest.approx(40.0)
    # At the start of the move the revealed one is 250 - 5 t - 5 m away.
    assert event.gap == pytest.approx(245.0 - 5.0 * event.start, abs=0.1)
    assert 5.0 <= event.start < 6.0
    assert event.ego_speed == 25.0
    assert event.obstacle_speed == 20.0


def test_a_cut_in_counts_only_near_and_a_violent_one_is_a_ghost():
    ego = track("ego", 0.0, 25.0)
    near = events_of(ego, track("other", 40.0, 24.0, y0=3.5, move=(5.0, 5.0, -3.5)))
    (event,) = near.tables["cut_in"].itertuples()
    assert (event.ego, event.cut_in, event.to_left) == ("ego", "other", False)
    # a scenario's t = 0: closing at 1 m/s for 5 s, and what it takes to move at 0.12 m/s
    assert event.start == pytest.approx(5.5, abs=0.2)
    assert event.gap == pytest.approx(35.0 - event.start)
    assert event.t == pytest.approx(7.5, abs=0.2)
    far = events_of(ego, track("other", 120.0, 25.0, y0=3.5, move=(5.0, 5.0, -3.5)))
    assert far.tables["cut_in"].empty  # beyond 3 s * 25 m/s
    wild = events_of(ego, track("other", 40.0, 24.0, y0=3.5, move=(5.0, 1.5, -3.5)))
    assert wild.tables["cut_in"].empty
    assert wild.ghosts["cut_in"] == 1


@pytest.mark.parametrize("kind, y0, to", [("cut_in", 7.0, 3.5), ("cut_out", 3.5, 7.0)])
@pytest.mark.parametrize("late", [True, False])
def test_no_scenario_begins_before_the_ego_is_in_its_lane(kind, y0, to, late):
    other = track("other", 40.0, 24.0, y0=y0, move=(5.0, 5.0, to - y0))
    ego = track("ego", 0.0, 25.0, move=(4.0, 4.0, 3.5))
    if late:
        ego = track("ego", 0.0, 25.0, y0=3.5).query("t > 6.9")
    assert events_of(ego, other).tables[kind]["start"].isna().tolist() == [True]


def test_a_braking_lead():
    lead = track("lead", 40.0, lambda t: 25.0 - 2.0 * min(max(t - 5.0, 0.0), 3.0))
    (event,) = events_of(track("ego", 0.0, 24.0), lead).tables["lead_braking"].itertuples()
    assert event.lead_deceleration == pytest.approx(2.0, abs=0.05)
    assert event.lead_speed_drop == pytest.approx(6.0, abs=0.3)
    assert event.t == pytest.approx(5.0, abs=0.15)
    gentle = track("lead", 40.0, lambda t: 25.0 - 0.8 * min(max(t - 5.0, 0.0), 5.0))
    assert events_of(track("ego", 0.0, 24.0), gentle).tables["lead_braking"].empty


def test_a_track_of_one_sample_is_left_out(tmp_path):
    one = track("other", 50.0, 15.0).head(1)
    pd.concat([track("ego", 0.0, 20.0), one]).to_csv(tmp_path / "table.csv", index=False)
    read = read_csv(tmp_path / "table.csv")
    assert extract_events(read).vehicles == 1
    assert read.notes[0].startswith("1 tracks of less than two samples")


def test_a_lane_that_is_kept_for_less_than_a_second_does_not_count():
    ego = track("ego", 0.0, 25.0)
    ego.loc[ego["t"].between(5.0, 5.6), "lane"] = 1
    assert events_of(ego, track("lead", 100.0, 24.0)).lane_changes.empty


def test_vehicles_and_ghosts_are_counted_and_pedestrians_are_not_traffic():
    found = events_of(
        track("ego", 0.0, 30.0),
        track("lead", 200.0, 20.0),
        track("walker", 50.0, 1.0, kind="pedestrian"),
    )
    assert found.vehicles == 2
    assert found.tables["approach"].empty  # the ego drives through the leader: a ghost
    assert found.ghosts["approach"] == 1
    assert "0 of 2 motor vehicles" in found.sentences()[0]
    assert events_of(track("walker", 50.0, 1.0, kind="pedestrian")).vehicles == 0


@pytest.mark.campaign
@needs_recordings
def test_real_approaches_have_the_parameters_and_outcomes_of_their_table():
    """The series begin up to 2 s before the event, so the way in which it began is not in them; the
    rest is."""
    duckdb = pytest.importorskip("duckdb")
    table = pd.read_csv(recording("dlr_ht", "approach_events.csv"))
    table = (
        table[(table["start_kind"] == "range_crossing") & ~table["suspect"]]
        .head(70)
        .set_index("event_id")
    )
    series = duckdb.sql(f"select * from '{recording('dlr_ht', 'approach_series.parquet')}'").df()
    parts = []
    for name, rows in series[series["event_id"].isin(table.index)].groupby("event_id"):
        event = table.loc[name]
        for who, length in (("ego", event["ego_L"]), ("lead", event["lead_L"])):
            rows = rows.dropna(subset=[f"{who}_x", f"{who}_dlane"])
            parts.append(
                pd.DataFrame(
                    {
                        "recording": name, "vehicle": who, "driver": "",
                        "t": rows["t"].round(1) + 100.0,
                        "x": rows[f"{who}_x"], "y": rows[f"{who}_y"], "heading": 0.0,
                        "speed": rows[f"{who}_v"],
                        "acceleration": rows[f"{who}_a"].fillna(0.0), "length": length,
                        "width": 2.0, "class": "car",
                        "lane": rows[f"{who}_dlane"].astype(int), "steering": np.nan,
                    }
                )
            )  # fmt: skip
    found = extract_events(Recordings(pd.concat(parts, ignore_index=True))).tables["approach"]
    first = found[(found["ego"] == "ego") & ((found["t"] - 100.0).abs() < 0.25)].set_index(
        "recording"
    )
    assert len(first) >= 0.97 * len(table)
    both = first.join(table.rename(columns=lambda name: name + "_table"))
    assert (both["ego_speed"] - both["v_ego0_table"]).abs().quantile(0.95) < 0.1
    assert (both["lead_speed"] - both["v_lead0_table"]).abs().quantile(0.95) < 0.1
    assert (both["gap"] - both["gap0_table"]).abs().quantile(0.95) < 1.0
    changed = both[both["outcome_table"] == "lane_change"]
    assert (changed["outcome"] == "lane_change").mean() > 0.95
    assert (changed["t_outcome"] - changed["t_outcome_s_table"]).abs().quantile(0.9) < 0.3
    assert (both[both["outcome_table"] == "follow"]["outcome"] == "follow").mean() > 0.9


@pytest.mark.campaign
@needs_recordings
def test_the_whole_recording_gives_the_events_of_the_tables():
    """Needs the raw file of the DLR Highway Traffic dataset v1.1.0; its path is in
    SUMO_EVAL_DLR_HIGHWAY."""
    path = os.environ.get("SUMO_EVAL_DLR_HIGHWAY")
    if not path:
        pytest.skip("SUMO_EVAL_DLR_HIGHWAY names no trajectories_*.csv")
    imported = import_recordings("dlr_highway", [Path(path)])
    assert imported.vehicles == 442
    found = extract_events(imported)
    table = pd.read_csv(recording("dlr_ht", "approach_events.csv"))
    table = table[~table["suspect"]].assign(
        ego=lambda rows: rows["ego"].astype(str), lead=lambda r: r["lead"].astype(str)
    )
    both = found.tables["approach"].merge(table, on=["ego", "lead"], suffixes=("", "_table"))
    both = both[(both["t"] - both["t0_abs_s"]).abs() < 1.5]
    assert len(both) >= 0.99 * len(table)
    assert (both["gap"] - both["gap0"]).abs().quantile(0.9) < 1.0
    assert len(found.lane_changes) == pytest.approx(603, rel=0.02)
