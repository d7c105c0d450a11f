"""The facts file: what goes in comes out, a case whole or not at all, foreign files refused."""

import resource
import sqlite3
import subprocess
import sys
from contextlib import closing, nullcontext
from dataclasses import replace

import numpy as np
import pytest
from loaded import ROOT
from record.edited_store import edit
from refusals import refusal
from road_scenes import at_values

from sumo_eval.errors import InputError
from sumo_eval.record.cases import Case, Outcome
from sumo_eval.record.facts_file import FORMAT_VERSION
from sumo_eval.record.kept import packed, unpack
from sumo_eval.record.store import open_store
from sumo_eval.trajectory import CHANNELS, Clip, Collision, Latency, Recording, Trajectory


def drive(n=40, seed=3):
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 0.1
    y, heading, speed, acceleration, angle = rng.normal(size=(5, n))
    angle[rng.random(n) < 0.3] = np.nan
    channels = (time, 20.0 * time, y, heading, 20 + speed, acceleration, angle)
    return Trajectory(*channels, length=4.3, width=1.9)


def driven(**actors):
    return Recording(drive(), actors, None, "road_end")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "facts.sqlite"


@pytest.fixture
def store(path):
    with open_store(path.parent, create=True) as store:
        yield store


def case(point=7, driver="idm"):
    concrete = at_values("front_vehicle_cut_out", ego_speed=20, obstacle_speed=5, gap=60)
    return Case(point, concrete, "ads", driver, driver)


def filled(path, order, log=""):
    path.parent.mkdir(exist_ok=True)
    with open_store(path.parent, create=True) as store:
        for point in order:
            took = Latency(0.1 * len(order), 0.2)
            recording = Recording(drive(seed=point), {}, None, "road_end", (), None, "", took, 0.3)
            store.add(Outcome(case(point), "ok", recording, None, log))
        return store.digest()


def test_a_packed_trajectory_comes_back_time_and_x_exact_the_rest_to_single_precision():
    before = drive()
    after = unpack(packed(before))
    assert np.array_equal(after.time, before.time)
    assert np.array_equal(after.x, before.x)
    for name in CHANNELS:
        np.testing.assert_allclose(
            getattr(after, name), getattr(before, name), rtol=1e-7, atol=0, equal_nan=True
        )
    assert after.length == 4.3
    assert after.width == 1.9


def test_packing_what_was_unpacked_changes_no_byte():
    data = packed(drive())
    assert packed(unpack(data)) == data


@pytest.mark.parametrize("kept", [slice(0, 10), slice(0, 40), slice(0, -1)])
def test_a_damaged_drive_is_refused_with_a_sentence(kept):
    with refusal("A recorded trajectory"):
        unpack(packed(drive())[kept])
    with refusal("is damaged: Error -3"):
        unpack(packed(drive())[:20] + b"no deflated bytes")


TOOK = Latency(1e-5, 2e-5, 9e-6, 1.9e-5, 8e-6)


def test_a_case_comes_back_as_it_was_recorded(store):
    clips = (Clip("friction", 3, 0.5, -12.0, -9.0),)
    poses = (1.0, 2.0, 0.1), (5.0, 2.0, 0.0)
    hit = Collision(1.25, "obstacle", (12.0, 0.5), (5.0, 0.0), 0.75, "front", *poses)
    actors = {"lead": drive(seed=4)}
    recording = Recording(drive(), actors, hit, "contact", clips, None, "", TOOK, 0.01)
    store.add(Outcome(case(), "collision", recording))
    (fact,) = store.facts("ads")
    assert set(store.trajectories(fact.case)) == {"ego", "lead"}
    assert fact.case == "front_vehicle_cut_out-0007-idm"
    assert fact.collision == hit
    assert fact.clips == clips
    assert fact.values == {"ego_speed": 20.0, "obstacle_speed": 5.0, "gap": 60.0}
    assert fact.status == "collision"
    assert fact.end_reason == "contact"
    assert fact.latency_max == 2e-5
    assert fact.latency_median == 9e-6
    assert fact.latency_p99 == 1.9e-5
    assert fact.latency_reference == 8e-6


def test_file_without_latencies_still_reads(path):
    """One that an older version wrote has no table of them; what is added to it later has them."""
    with open_store(path.parent, create=True) as store:
        store.add(Outcome(case(), "ok", replace(driven(), controller_latency=TOOK)))
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("DROP TABLE latencies")
    for create in (False, True):
        with open_store(path.parent, create=create) as store:
            (fact,) = store.facts("ads")
            assert fact.latency_max == 2e-5
            assert fact.latency_median is None


def test_a_case_without_a_recording_is_kept_with_its_sentence(store):
    store.add(Outcome(case(), "crashed", None, "The process died."))
    (fact,) = store.facts("ads")
    assert fact.error == "The process died."
    assert fact.status == "crashed"
    assert fact.end_reason is fact.collision is None


def test_a_case_that_cannot_be_stored_whole_leaves_nothing_behind(store):
    for point, recording, error in (
        (7, driven(), None),
        (7, driven(), sqlite3.IntegrityError),
        (8, driven(ego2=None), AttributeError),
    ):
        with pytest.raises(error) if error else nullcontext():
            store.add(Outcome(case(point), "ok", recording))
    assert [fact.point for fact in store.facts("ads")] == [7]


def test_facts_are_selected_by_role_scenario_and_driver_in_the_order_of_points(store):
    for point in (9, 2, 5):
        for driver in ("b", "a"):
            store.add(Outcome(case(point, driver), "ok", driven()))
    found = [(fact.point, fact.driver) for fact in store.facts("ads")]
    assert found == [(2, "a"), (2, "b"), (5, "a"), (5, "b"), (9, "a"), (9, "b")]
    assert list(store.facts("human")) == []
    assert list(store.facts("ads", "front_vehicle_low_speed")) == []


def test_a_file_that_is_not_a_facts_file_is_refused(path):
    with refusal("is not a run folder"), open_store(path.parent):
        pass
    path.write_text("not a database, but long enough to be mistaken for one " * 30)
    with refusal("is not a facts file"), open_store(path.parent):
        pass


def test_a_finished_store_is_one_file_that_can_be_read_where_nothing_can_be_written(tmp_path):
    folder = tmp_path / "archive"
    folder.mkdir()
    filled(folder / "facts.sqlite", [7])
    assert [path.name for path in folder.iterdir()] == ["facts.sqlite"]
    connection = sqlite3.connect(f"file:{folder / 'facts.sqlite'}?immutable=1", uri=True)
    assert connection.execute("SELECT count(*) FROM facts").fetchone() == (1,)
    connection.close()


def test_reading_a_store_cannot_change_it(path):
    filled(path, [])
    with open_store(path.parent) as store, refusal("readonly"):
        store.add(Outcome(case(), "crashed", None, "late"))


def test_the_digest_depends_on_the_facts_alone(tmp_path):
    forth = filled(tmp_path / "a/facts.sqlite", [1, 2, 3])
    assert filled(tmp_path / "b/facts.sqlite", [3, 1, 2], "printed at 12:00") == forth
    assert filled(tmp_path / "c/facts.sqlite", [1, 2]) != forth
    assert filled(tmp_path / "d/facts.sqlite", [1, 2, 4]) != forth


def test_a_case_with_another_fingerprint_takes_the_place_of_the_old_one(store):
    first, second = replace(case(), fingerprint="a"), replace(case(), fingerprint="b")
    store.add(Outcome(first, "ok", driven(lead=drive(seed=4))))
    assert (store.holds(first), store.holds(second)) == (True, False)
    store.add(Outcome(second, "crashed", None, "The process died."))
    assert (store.holds(first), store.holds(second)) == (False, True)
    (fact,) = store.facts("ads")
    assert fact.status == "crashed"
    assert store.trajectories(fact.case) == {}


def test_a_full_quota_is_reported(path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with open_store(path.parent, create=True) as store:
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size, limits[1]))
            with refusal("cannot be written: disk I/O error or full quota. Earlier"):
                store.add(Outcome(case(), "ok", driven(a=drive(4000))))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_full_disk_is_reported_and_what_was_recorded_stays(path):
    with open_store(path.parent, create=True) as store:
        store.add(Outcome(case(), "ok", driven()))
        store._connection.execute("PRAGMA max_page_count = 12")
        big = {f"actor_{n}": drive(400, seed=n) for n in range(9)}
        with refusal(r"cannot be written: database or disk is full"):
            store.add(Outcome(case(8), "ok", driven(**big)))
        kept = len(list(store.facts("ads")))
    with open_store(path.parent) as store:
        assert len(list(store.facts("ads"))) == kept == 1


# --- damage ---------------------------------------------------------------------------------------


def reads(path):
    """What reading the whole of a file says: nothing, or the sentence it is refused with."""
    try:
        with open_store(path.parent) as store:
            for fact in store.facts("ads"):
                store.trajectories(fact.case)
            return ""
    except InputError as error:
        return str(error)


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE facts SET simulated_time = 12.5 WHERE point = 2",
        "UPDATE facts SET status = 'collision' WHERE point = 2",
        "UPDATE facts SET exposure = exposure * 1.0000000000000002 WHERE point = 2",
        "UPDATE circumstances SET log = 'nothing' WHERE \"case\" LIKE '%-0002-%'",
        "UPDATE circumstances SET hash = x'00' WHERE \"case\" LIKE '%-0002-%'",
        "DELETE FROM circumstances WHERE \"case\" LIKE '%-0002-%'",
        "DELETE FROM facts WHERE point = 2",
        "UPDATE latencies SET latency_median = 'x' WHERE \"case\" LIKE '%-0002-%'",
        "DELETE FROM trajectories WHERE \"case\" LIKE '%-0002-%' AND vehicle = 'ego'",
        "UPDATE trajectories SET vehicle = 'lead' WHERE \"case\" LIKE '%-0002-%'",
        'UPDATE trajectories SET data = (SELECT data FROM trajectories WHERE "case" LIKE '
        "'%-0001-%') "
        "WHERE \"case\" LIKE '%-0002-%'",
    ],
)
def test_an_edited_row_is_reported_with_its_case(path, change):
    filled(path, [1, 2, 3])
    assert reads(path) == ""
    edit(path, change)
    assert "front_vehicle_cut_out-0002-idm" in reads(path)
    with refusal("0002"), open_store(path.parent, create=True):
        pass


def test_a_lost_column_is_named(path):
    filled(path, [1])
    edit(path, "ALTER TABLE trajectories DROP COLUMN data")
    assert "no such column: data" in reads(path)


def test_a_case_that_was_taken_out_of_a_complete_run_breaks_its_seal(path):
    filled(path, [1, 2, 3])
    with open_store(path.parent, create=True) as store:
        store.seal()
    assert reads(path) == ""
    with open_store(path.parent, create=True) as store:
        store.remove(["front_vehicle_cut_out-0002-idm"])
    assert "it was complete with 3 cases and holds 2 now" in reads(path)
    edit(path, "DELETE FROM about")
    assert reads(path) == ""


def test_every_flipped_bit_is_reported_or_changes_nothing(path, tmp_path):
    """Of 300 bits all over a file: each is either refused, or the file says the same to the last
    bit."""
    filled(path, list(range(12)))
    with open_store(path.parent, create=True) as store:
        store.seal()
    whole, rng = path.read_bytes(), np.random.default_rng(5)
    with open_store(path.parent) as store:
        before = (store.digest(), [fact.log for fact in store.facts("ads")])
    refused = 0
    for number, place in enumerate(rng.integers(0, len(whole), 300).tolist()):
        broken = bytearray(whole)
        broken[place] ^= 1 << int(rng.integers(8))
        copy = tmp_path / f"{number}/facts.sqlite"
        copy.parent.mkdir()
        copy.write_bytes(broken)
        try:
            with open_store(copy.parent) as store:
                assert (store.digest(), [fact.log for fact in store.facts("ads")]) == before, place
        except InputError as error:
            refused += str(copy) in str(error)
        copy.unlink()
    assert refused > 80  # most of so small a file is unused room in its pages


@pytest.mark.parametrize("share", [0.0, 0.001, 0.1, 0.5, 0.9, 0.999])
def test_a_file_that_was_cut_off_is_refused(path, share):
    filled(path, list(range(12)))
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert str(path) in reads(path)


@pytest.mark.parametrize(
    "version, more",
    [(99, ""), (2, "carry no hash.*run its evaluation again into a new folder")],
)
def test_a_file_of_another_format_is_refused_with_what_to_do(path, version, more):
    filled(path, [1])
    edit(path, f"PRAGMA user_version = {version}")
    both = f"format version {version}; this sumo_eval reads version {FORMAT_VERSION}.*{more}"
    with refusal(both), open_store(path.parent):
        pass


def test_a_locked_file_is_refused(path):
    filled(path, [1])
    other = sqlite3.connect(path)
    other.execute("BEGIN EXCLUSIVE")
    assert "database is locked" in reads(path)
    other.close()


def test_a_folder_in_place_of_the_file_is_refused(path):
    path.mkdir()
    assert "is not a run folder" in reads(path)
    with refusal("unable to open"), open_store(path.parent, create=True):
        pass


def test_an_interrupted_write_leaves_whole_cases_and_a_log_that_is_read(tmp_path):
    """A process that is killed leaves the write-ahead log; with the log cut off, what is left is
    whole cases."""
    path = tmp_path / "facts.sqlite"
    program = (
        "import os, sys; sys.path.insert(0, 'tests'); from pathlib import Path\n"
        "from record.test_store import case, drive\n"
        "from sumo_eval.record.cases import Outcome; from sumo_eval.record.store import "
        "open_store\n"
        "from sumo_eval.trajectory import Recording\n"
        f"with open_store(Path({str(tmp_path)!r}), create=True) as store:\n"
        "    for point in range(6):\n"
        "        store.add(Outcome(case(point), 'ok', Recording(drive(seed=point), {}, None, "
        "'road_end')))\n"
        "    os._exit(9)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False)
    log = path.with_name("facts.sqlite-wal")
    assert done.returncode == 9
    assert log.is_file()
    main, written = path.read_bytes(), log.read_bytes()
    for share in (1.0, 0.7, 0.4):
        path.write_bytes(main)
        log.write_bytes(written[: int(share * len(written))])
        path.with_name("facts.sqlite-shm").unlink(missing_ok=True)
        with open_store(path.parent) as store:
            found = [fact.point for fact in store.facts("ads")]
        assert found == list(range(len(found)))
        assert len(found) == 6 or share < 1.0


def test_what_no_number_or_its_sign_is_comes_back_with_a_hash_that_fits(tmp_path):
    recording = Recording(
        drive(), {"b": drive(), "a": drive()}, None, "road_end", (), None, "",
        Latency(float("nan"), np.float64(-0.0)),
        float("inf"),
    )  # fmt: skip
    with open_store(tmp_path, create=True) as store:
        store.add(Outcome(case(np.int64(3)), "ok", recording, None, "a\x00b"))
    assert reads(tmp_path / "facts.sqlite") == ""
