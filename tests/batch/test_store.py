"""The facts file: what goes in comes out, a case whole or not at all, foreign files refused."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sumo_eval.batch.cases import Case, Outcome
from sumo_eval.batch.kept import pack, unpack
from sumo_eval.batch.store import FORMAT_VERSION, open_store
from sumo_eval.errors import InputError
from sumo_eval.scenario import catalogue
from sumo_eval.trajectory import CHANNELS, Clip, Collision, Recording, Trajectory


def drive(n: int = 40, seed: int = 3) -> Trajectory:
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 0.1
    return Trajectory(
        time, 20.0 * time, rng.normal(size=n), rng.normal(size=n), 20 + rng.normal(size=n), rng.normal(size=n),
        np.where(rng.random(n) < 0.3, np.nan, rng.normal(size=n)), length=4.3, width=1.9,
    )  # fmt: skip


def case(point: int = 7, driver: str = "idm") -> Case:
    concrete = catalogue.load("front_vehicle_cut_out").concrete(ego_speed=20, obstacle_speed=5, gap=60)
    return Case(point, concrete, "ads", driver, driver)


def collision() -> Collision:
    return Collision(1.25, "obstacle", (12.0, 0.5), (5.0, 0.0), 0.75, "front", (1.0, 2.0, 0.1), (5.0, 2.0, 0.0))


def test_a_packed_trajectory_comes_back_time_and_x_exact_the_rest_to_single_precision() -> None:
    before = drive()
    after = unpack(pack(before))
    assert np.array_equal(after.time, before.time)
    assert np.array_equal(after.x, before.x)
    for name in CHANNELS:
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), rtol=1e-7, atol=0, equal_nan=True)
    assert (after.length, after.width) == (4.3, 1.9)


def test_packing_what_was_unpacked_changes_no_byte() -> None:
    data = pack(drive())
    assert pack(unpack(data)) == data


def test_a_case_comes_back_as_it_was_recorded(tmp_path: Path) -> None:
    clips = (Clip("friction", 3, 0.5, -12.0, -9.0),)
    recording = Recording(drive(), {"lead": drive(seed=4)}, collision(), "contact", clips, None, "", (1e-5, 2e-5), 0.01)
    with open_store(tmp_path / "facts.sqlite", create=True) as store:
        store.add(Outcome(case(), "collision", recording))
        (fact,) = store.facts("ads")
        assert set(store.trajectories(fact.case)) == {"ego", "lead"}
    assert fact.case == "front_vehicle_cut_out-0007-idm"
    assert fact.collision == collision()
    assert fact.clips == clips
    assert fact.values == {"ego_speed": 20.0, "obstacle_speed": 5.0, "gap": 60.0}
    assert (fact.status, fact.end_reason, fact.latency_max) == ("collision", "contact", 2e-5)


def test_a_case_without_a_recording_is_kept_with_its_sentence(tmp_path: Path) -> None:
    with open_store(tmp_path / "facts.sqlite", create=True) as store:
        store.add(Outcome(case(), "crashed", None, "The process died."))
        (fact,) = store.facts("ads")
    assert (fact.status, fact.error, fact.end_reason, fact.collision) == ("crashed", "The process died.", None, None)


def test_a_case_that_cannot_be_stored_whole_leaves_nothing_behind(tmp_path: Path) -> None:
    recording = Recording(drive(), {}, None, "road_end")
    with open_store(tmp_path / "facts.sqlite", create=True) as store:
        store.add(Outcome(case(), "ok", recording))
        with pytest.raises(sqlite3.IntegrityError):
            store.add(Outcome(case(), "ok", recording))
        broken = Recording(drive(), {"ego2": None}, None, "road_end")  # type: ignore[dict-item]
        with pytest.raises(AttributeError):
            store.add(Outcome(case(point=8), "ok", broken))
        assert [fact.point for fact in store.facts("ads")] == [7]


def test_facts_are_selected_by_role_scenario_and_driver_in_the_order_of_points(tmp_path: Path) -> None:
    with open_store(tmp_path / "facts.sqlite", create=True) as store:
        for point in (9, 2, 5):
            for driver in ("b", "a"):
                store.add(Outcome(case(point, driver), "ok", Recording(drive(), {}, None, "road_end")))
        assert [(f.point, f.driver) for f in store.facts("ads")] == [
            (2, "a"), (2, "b"), (5, "a"), (5, "b"), (9, "a"), (9, "b"),
        ]  # fmt: skip
        assert [fact.point for fact in store.facts("ads", driver="a")] == [2, 5, 9]
        assert store.facts("human") == []
        assert store.facts("ads", "front_vehicle_low_speed") == []


def test_a_file_that_is_no_facts_file_is_refused_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no run folder"), open_store(tmp_path / "facts.sqlite"):
        pass
    (tmp_path / "facts.sqlite").write_text("not a database, but long enough to be mistaken for one " * 30)
    with pytest.raises(InputError, match="is no facts file"), open_store(tmp_path / "facts.sqlite"):
        pass


def test_a_newer_format_is_refused_with_both_versions(tmp_path: Path) -> None:
    path = tmp_path / "facts.sqlite"
    with open_store(path, create=True):
        pass
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 99")
    connection.commit()
    connection.close()
    with (
        pytest.raises(InputError, match=f"format version 99; this sumo_eval reads version {FORMAT_VERSION}"),
        open_store(path),
    ):
        pass


def test_a_finished_store_is_one_file_that_can_be_read_where_nothing_can_be_written(tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    folder.mkdir()
    with open_store(folder / "facts.sqlite", create=True) as store:
        store.add(Outcome(case(), "ok", Recording(drive(), {}, None, "road_end")))
    assert [path.name for path in folder.iterdir()] == ["facts.sqlite"]
    connection = sqlite3.connect(f"file:{folder / 'facts.sqlite'}?immutable=1", uri=True)
    assert connection.execute("SELECT count(*) FROM facts").fetchone() == (1,)
    connection.close()


def test_reading_a_store_cannot_change_it(tmp_path: Path) -> None:
    path = tmp_path / "facts.sqlite"
    with open_store(path, create=True):
        pass
    with open_store(path) as store, pytest.raises(InputError, match="readonly"):
        store.add(Outcome(case(), "crashed", None, "late"))


def filled(path: Path, order: list[int], log: str = "") -> str:
    with open_store(path, create=True) as store:
        for point in order:
            recording = Recording(drive(seed=point), {}, None, "road_end", (), None, "", (0.1 * len(order), 0.2), 0.3)
            store.add(Outcome(case(point), "ok", recording, None, log))
        return store.digest()


def test_the_digest_hangs_on_the_facts_alone_not_on_order_times_or_printed_text(tmp_path: Path) -> None:
    forth = filled(tmp_path / "a", [1, 2, 3])
    assert filled(tmp_path / "b", [3, 1, 2], "printed at 12:00") == forth
    assert filled(tmp_path / "c", [1, 2]) != forth
    assert filled(tmp_path / "d", [1, 2, 4]) != forth


def test_a_case_with_another_fingerprint_takes_the_place_of_the_old_one(tmp_path: Path) -> None:
    first, second = replace(case(), fingerprint="a"), replace(case(), fingerprint="b")
    with open_store(tmp_path / "facts.sqlite", create=True) as store:
        store.add(Outcome(first, "ok", Recording(drive(), {"lead": drive(seed=4)}, None, "road_end")))
        assert (store.holds(first), store.holds(second)) == (True, False)
        store.add(Outcome(second, "crashed", None, "The process died."))
        assert (store.holds(first), store.holds(second)) == (False, True)
        (fact,) = store.facts("ads")
        assert fact.status == "crashed"
        assert store.trajectories(fact.case) == {}


def test_a_full_disk_is_a_sentence_and_what_was_recorded_stays(tmp_path: Path) -> None:
    with open_store(tmp_path / "facts.sqlite", create=True) as store:
        store.add(Outcome(case(), "ok", Recording(drive(), {}, None, "road_end")))
        store._connection.execute("PRAGMA max_page_count = 12")
        big = {f"actor_{n}": drive(400, seed=n) for n in range(9)}
        with pytest.raises(InputError, match=r"cannot be written: database or disk is full"):
            store.add(Outcome(case(8), "ok", Recording(drive(), big, None, "road_end")))
        kept = len(store.facts("ads"))
    with open_store(tmp_path / "facts.sqlite") as store:
        assert len(store.facts("ads")) == kept == 1
