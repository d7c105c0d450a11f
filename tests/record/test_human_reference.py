"""What is computed once a point: equal to each D_i alone; what a run's folder keeps of it is taken
over only while it is what computing it again would give.
"""

import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import pytest
from evaluations import small
from refusals import refusal

import sumo_eval
from sumo_eval.method.anthropomorphic import Pairing, anthropomorphic_index, indexes_by_group
from sumo_eval.record import fingerprint, human_reference
from sumo_eval.record.human_reference import PointJob, compute_points
from sumo_eval.record.kept_results import KEPT, KeptResults
from sumo_eval.record.store import open_store
from sumo_eval.scenario.catalogue import load
from sumo_eval.settings import AnthropomorphicSettings

SETTINGS = AnthropomorphicSettings(slice_spacing=5.0)
Job = tuple[Path, PointJob]


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bands") / "run"
    evaluation = small(("idm",), steps={"ego_speed": 100.0, "lead_speed": 100.0})
    sumo_eval.evaluate(evaluation, folder)
    with open_store(folder) as store:
        point = next(store.facts("human")).point
        (ads,) = (fact.case for fact in store.facts("ads") if fact.point == point)
        drivers = tuple(fact.case for fact in store.facts("human") if fact.point == point)
    return folder, PointJob(
        drivers, load("front_vehicle_low_speed").road, left_out=(ads,), band=True
    )


def computed(job, settings=SETTINGS):
    kept = KeptResults(job[0])
    try:
        return compute_points(job[0], [job[1]], settings, map, lambda done: None, kept)
    finally:
        kept.close()


@pytest.mark.parametrize("mode", ["gaussian", "mixture"])
def test_band_and_left_out_drivers_are_each_index_alone(job, mode):
    run, wanted = job
    (ads,) = wanted.left_out
    settings = replace(SETTINGS, slice_spacing=3.0, band_slice_spacing=4.0, mode=mode)
    found = computed((run, replace(wanted, ads=(ads,), exchanges=((0, 2), (3, 1)))), settings)
    coarse = replace(settings, slice_spacing=4.0)
    with open_store(run) as store:
        own, drivers = store.trajectory(ads), [store.trajectory(case) for case in wanted.drivers]
    others = [[*drivers[:place], *drivers[place + 1 :]] for place in range(len(drivers))]
    alone = anthropomorphic_index(own, drivers, wanted.road, settings)
    assert found.indexes[ads].value == pytest.approx(alone.value, rel=1e-9)
    assert found.indexes[ads].notes == alone.notes
    assert found.indexes[ads].share == alone.share
    expected = [
        anthropomorphic_index(own, fewer, wanted.road, coarse).value for fewer in (drivers, *others)
    ]
    left_out = found.left_out[ads].index
    assert [left_out.everyone, *left_out.without] == pytest.approx(expected, rel=1e-9)
    twice = [[drivers[place] for place in places] for places in ((1, 2, 2, 3), (0, 1, 1, 2))]
    pairing = Pairing(4, (0, 1, 2, 3), 4.0, likeness=True)
    exchanged = [
        indexes_by_group([*people, own], [[pairing]], wanted.road, coarse)[0][0] for people in twice
    ]
    assert left_out.exchanged == pytest.approx(fmean(index.value for index in exchanged), rel=1e-9)
    assert found.left_out[ads].likeness.exchanged == pytest.approx(
        fmean(one.likeness.value for one in exchanged), rel=1e-9
    )
    among = [
        anthropomorphic_index(one, fewer, wanted.road, coarse)
        for one, fewer in zip(drivers, others, strict=True)
    ]
    assert found.bands[wanted.drivers] == pytest.approx([index.value for index in among], rel=1e-9)


def test_with_two_drivers_none_can_be_left_out(job):
    run, wanted = job
    found = computed((run, replace(wanted, drivers=wanted.drivers[:2], band=False)))
    (left_out,) = found.left_out.values()
    index, likeness = left_out.index, left_out.likeness
    assert index.without == ()
    assert found.bands == {}
    assert index.exchanged == index.everyone
    assert likeness.exchanged == likeness.everyone
    assert 0.0 < index.everyone <= 1.0


def test_what_is_kept_is_what_was_computed_to_the_last_digit(job, monkeypatch):
    run, wanted = job
    judged = run, replace(wanted, ads=wanted.left_out)
    first = computed(judged)

    def nothing_to_do(*_):
        raise AssertionError("computed again")

    monkeypatch.setattr(human_reference, "indexes_by_group", nothing_to_do)
    assert computed(judged) == first
    assert computed((run, replace(wanted, band=False))).left_out == first.left_out
    with pytest.raises(AssertionError, match="computed again"):
        computed(job, replace(SETTINGS, slice_spacing=10.0))


SOURCES = ["trajectory.py", "kernels.py", "coded.py", "scenario/road/lanes.py", "record/kept.py"]


@pytest.mark.parametrize("name", SOURCES)
def test_a_result_of_other_code_is_not_taken_over(job, monkeypatch, tmp_path, name):
    package = tmp_path / "sumo_eval"
    shutil.copytree(fingerprint._PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(fingerprint, "_PACKAGE", package)
    # the key does not depend on the package's folder
    keys = [human_reference._keys(job[0], [job[1]], SETTINGS)]
    for text in ("", "# changed"):
        with (package / name).open("a") as file:
            file.write(text)
        fingerprint.sources.cache_clear()
        keys.append(human_reference._keys(job[0], [job[1]], SETTINGS))
    fingerprint.sources.cache_clear()
    first, copied, changed = (set(it.values()) for it in keys)
    assert first == copied
    assert not first & changed


@pytest.mark.parametrize("spacing", [0.5, 2.5])
def test_an_index_is_the_same_to_the_last_bit_whether_or_not_the_band_is_kept(job, spacing):
    # At 2.5 m boxes pay for the band and not for the index alone; at 0.5 m they pay for both.
    run, whole = job
    wanted, settings = replace(whole, ads=whole.left_out), replace(SETTINGS, slice_spacing=spacing)
    apart = computed((run, replace(wanted, left_out=(), band=False)), settings)
    fresh, kept = computed((run, wanted), settings), computed((run, wanted), settings)
    assert kept.bands == fresh.bands
    (ads,) = whole.left_out
    found = [result.indexes[ads] for result in (apart, fresh, kept)]
    assert len({(index.value, index.similarity, index.likeness) for index in found}) == 1


def test_other_settings_and_drives_are_not_mistaken_for_the_same(job):
    run, whole = job
    assert computed(job) != computed(job, replace(SETTINGS, centre_deviation_floor=0.5))
    fewer = computed((run, replace(whole, drivers=whole.drivers[1:])))
    assert len(fewer.bands[whole.drivers[1:]]) == len(whole.drivers) - 1
    assert fewer.left_out != computed(job).left_out


@pytest.mark.parametrize(
    "damage",
    [b"no database at all, but long enough to be one" * 40, b"SQLite format 3\0" + 200 * b"x"],
)
def test_a_damaged_file_of_results_is_computed_again(job, damage):
    first = computed(job)
    kept = job[0] / KEPT
    kept.write_bytes(damage)
    with refusal(r"kept\.sqlite .*changed or damaged.* deleted"):
        computed(job)
    kept.unlink()
    assert computed(job) == first


@pytest.mark.parametrize("kind", ["index", "left_out", "band"])
def test_an_edited_number_in_a_file_of_results_is_found(job, kind):
    run, wanted = job
    judged = run, replace(wanted, ads=wanted.left_out)
    computed(judged)
    kept = run / KEPT
    with closing(sqlite3.connect(kept)) as connection, connection:
        changed = connection.execute(
            "UPDATE parts SET data = CAST(replace(CAST(data AS TEXT), '0.', '0.1') AS BLOB) WHERE "
            "kind = ?",
            (kind,),
        )
        assert changed.rowcount > 0
    with refusal("not as it was written"):
        computed(judged)
    kept.unlink()
    assert computed(judged).bands


def test_a_file_of_another_version_is_computed_again(job):
    first = computed(job)
    kept = job[0] / KEPT
    with closing(sqlite3.connect(kept)) as connection:
        connection.execute("PRAGMA user_version = 99")
    assert computed(job) == first


def test_a_read_only_folder_loses_the_saving_and_no_score(tmp_path):
    kept = KeptResults(tmp_path / "gone")  # no file can be made there
    try:
        assert kept.get("band", b"key") is None
        kept.put([("band", b"key", 0, b"what")])
        assert kept.get("band", b"key") == b"what"
    finally:
        kept.close()
    assert not (tmp_path / "gone").exists()
