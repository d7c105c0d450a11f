"""A policy over arrays is shown its cases in blocks that the evaluation fixes: the same bytes,
however a run goes."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from evaluations import small
from record.batch_policies import SIZE

import sumo_eval
from sumo_eval.errors import StoppedError
from sumo_eval.record.cases import ALONE, IN_BLOCK, Block, Case, Setup
from sumo_eval.record.engines import identify, run_cases
from sumo_eval.record.facts import merge, record_facts, verify
from sumo_eval.record.identity import is_over_arrays
from sumo_eval.record.store import open_store
from sumo_eval.report.notes import score_note
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.score_notes import DrivenInBlocks
from sumo_eval.settings import RunSettings, SimulationSettings

LOGICAL = catalogue.load("front_vehicle_low_speed")
SIMULATION = SimulationSettings(step=0.1, end_when_decided=True)
HERE = Path(__file__).parent


def evaluation(name="OfTheMean", **run):
    run = RunSettings(**{"cases_per_pack": SIZE, "workers": 1, **run})
    ads = {"mine": f"batch_policies.py:{name}"}
    settings = small(ads, drivers=2, seed=5, simulation=SIMULATION, run=run)
    return Resolved(settings, HERE, {LOGICAL.name: LOGICAL})


def recorded(run, out, **more):
    record_facts(run, out, **more)
    return digest(out)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An uninterrupted run of six points, in blocks of four and two, with one worker."""
    folder = tmp_path_factory.mktemp("whole")
    record_facts(evaluation(), folder / "run")
    return folder / "run"


def digest(run):
    return sumo_eval.open_run(run).digest()


@pytest.mark.campaign
def test_the_same_bytes_whatever_the_workers_and_the_engine_and_after_a_loss(whole, tmp_path):
    one = digest(whole)
    shutil.copytree(whole, tmp_path / "one")
    for number, run in enumerate([{"workers": 2}, {"workers": 8}, {"engine": "serial"}]):
        assert recorded(evaluation(**run), tmp_path / f"other{number}") == one
    assert recorded(evaluation(cases_per_pack=3), tmp_path / "three") != one, (
        "the composition is in the bits"
    )

    # one of each block is missing
    with open_store(tmp_path / "one", create=True) as store:
        facts = list(store.facts("ads", LOGICAL.name))
        clips = {
            fact.point: [clip.requested for clip in fact.clips if clip.what == IN_BLOCK]
            for fact in facts
        }
        assert clips == {0: [4.0], 1: [4.0], 2: [4.0], 3: [4.0], 4: [2.0], 5: [2.0]}
        store.note("complete", "")
        store.unseal()
        store.remove([fact.case for fact in facts if fact.point in (1, 5)])
    assert recorded(evaluation(workers=2), tmp_path / "one", resume=True) == one
    assert verify(tmp_path / "one", 0.3)[1] == []


def test_verify_finds_it_when_the_answers_of_a_block_change(tmp_path):
    record_facts(evaluation("OfTheProcess"), tmp_path / "run")
    assert verify(tmp_path / "run", 0.1)[1]


def test_a_stopped_run_continues_in_the_same_blocks(whole, tmp_path):
    asked = iter([False])
    with pytest.raises(StoppedError):
        record_facts(evaluation(), tmp_path / "two", stopping=lambda: next(asked, True))
    assert recorded(evaluation(workers=2), tmp_path / "two", resume=True) == digest(whole)


def test_a_shard_drives_the_blocks_of_the_whole(whole, tmp_path):
    shards = [tmp_path / "first", tmp_path / "second"]
    for number, shard in enumerate(shards, start=1):
        record_facts(replace(evaluation(), shard=(number, 2)), shard)
    merge(shards, tmp_path / "merged")
    assert digest(tmp_path / "merged") == digest(whole)


def block_of(name, wanted):
    """Some cases of a block of four."""
    concretes = [
        LOGICAL.concrete(ego_speed=15.0 + number, lead_speed=5.0) for number in range(SIZE)
    ]
    block = Block.of(0, concretes)
    return [
        Case(number, concretes[number], "ads", "mine", f"batch_policies.py:{name}", block=block)
        for number in wanted
    ]


def driven(name, wanted, **run):
    outcomes = run_cases(
        block_of(name, wanted), Setup(SIMULATION, RunSettings(workers=1, **run), HERE)
    )
    return sorted(outcomes, key=lambda outcome: outcome.case.point)


def test_some_cases_of_a_block_are_what_they_are_when_all_are_wanted():
    every = driven("OfTheMean", [0, 1, 2, 3])
    for wanted in ([2], [0, 3]):
        for outcome in driven("OfTheMean", wanted, engine="serial"):
            assert outcome.recording.drives == every[outcome.case.point].recording.drives


def test_an_exception_in_a_call_belongs_to_all_cases_of_the_block():
    for outcome in driven("Raises", [0, 1, 2, 3]):
        assert outcome.status == "ads_error"
        assert outcome.error == (
            "The ADS raised at 0.40 s, in one call for 4 cases, which fails them all: ValueError: "
            "no path found."
        )
        assert outcome.error_place == "batch_policies.py:33 in act"
        assert not outcome.log.startswith(ALONE)


def test_a_lost_block_is_driven_case_by_case_and_logged():
    for outcome in driven("Exits", [0, 1, 2, 3]):
        assert outcome.status == "collision"
        assert outcome.log.startswith(
            f"{ALONE}The block of cases that its policy over arrays drives together was lost"
        )
        assert "died with exit code 7" in outcome.log


def test_a_policy_says_by_batch_that_it_takes_arrays_as_a_class_and_as_an_object():
    locators = [f"batch_policies.py:{name}" for name in ("OfTheMean", "the_object", "ByCase")]
    found = identify(
        [("ADS", locator) for locator in locators], Setup(SIMULATION, RunSettings(), HERE)
    )
    assert [is_over_arrays(found[locator]) for locator in locators] == [True, True, False]


def test_the_note_beside_the_score_says_that_cases_were_shown_in_blocks():
    assert score_note(DrivenInBlocks(6, (2, 4))) == (
        "Its policy over arrays received cases in fixed batches of 2 and 4 (6 drives). "
        "The last bits of its answers may depend on the batch."
    )
