"""Cases that run together are what they are alone, whatever the size of the batches, and a fault
costs its own case."""

from dataclasses import replace
from pathlib import Path

import pytest
from evaluations import small
from tables import in_campaign, values_of

import sumo_eval
from sumo_eval.record.batches import LEAST, Batches
from sumo_eval.record.cases import ALONE, Case, Outcome, Setup
from sumo_eval.record.cluster import _counted
from sumo_eval.record.engines import once_each, run_batches, run_cases
from sumo_eval.record.identity import with_fingerprint
from sumo_eval.record.kept import KeptRecording
from sumo_eval.record.store import open_store
from sumo_eval.record.worker import run_case
from sumo_eval.report.notes import score_note
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings
from sumo_eval.trajectory import Alone

HERE = Path(__file__).parent
SPACE = catalogue.load("front_vehicle_low_speed")
CUT_IN = catalogue.load("cut_in")
SIMULATION = SimulationSettings(step=0.1, end_when_decided=True)
FAULTY = 5  # number of the case in which the ego starts at 20 m/s
LIMITS = {"case_timeout": 3.0, "step_timeout": 0.2, "memory_limit": 700.0}


def setup(**run):
    return Setup(SIMULATION, RunSettings(**run), HERE)


def cases(controller, count=9):
    """Drives at one ego speed each, 15, 16 ... m/s."""
    concretes = (SPACE.concrete(ego_speed=15.0 + number, lead_speed=5.0) for number in range(count))
    return [Case(number, it, "ads", "mine", controller) for number, it in enumerate(concretes)]


def alike(count):
    concrete = SPACE.concrete(ego_speed=20.0, lead_speed=10.0)
    return (Case(number, concrete, "ads", "a", "a") for number in range(count))


def facts(outcomes):
    """All that is no circumstance, by case."""
    found = {}
    for outcome in outcomes:
        recording = outcome.recording
        assert recording is None or isinstance(recording, KeptRecording)
        drives = recording and (recording.drives, recording.collision, recording.clips)
        found[outcome.case.key] = (outcome.status, outcome.error, drives)
    assert len(found) == len(outcomes), "each exactly once"
    return found


@pytest.mark.parametrize(
    "fault, status, breaks",
    [
        ("Exits", "crashed", True),
        ("Hangs", "ads_timeout", False),
        in_campaign("HangsInC", "timeout", True),
        *values_of("""
    "Raises", "ads_error", False
    "Interrupts", "ads_error", False
    "FillsMemory", "ads_error", False
    """),
    ],
)
def test_faulty_case_fails_alone_and_its_log_names_the_batch(fault, status, breaks):
    drives = cases(f"faulty_policies.py:{fault}")
    assert drives[FAULTY].concrete.ego.speed == 20.0
    # three times it takes all of it
    limits = {**LIMITS, "case_timeout": 1.0} if fault == "HangsInC" else LIMITS
    together = list(run_cases(drives, setup(workers=1, **limits)))
    alone = list(run_cases(drives, setup(workers=1, cases_per_pack=1, **limits)))
    assert facts(together) == facts(alone)
    statuses = {outcome.case.point: outcome.status for outcome in together}
    assert statuses.pop(FAULTY) == status
    assert set(statuses.values()) == {"collision"}
    innocent = [outcome for outcome in together if outcome.case.point != FAULTY]
    assert {outcome.log.startswith(ALONE) for outcome in innocent} == {breaks}
    late = {outcome.case.point for outcome in alone if outcome.log.startswith(ALONE)}
    assert late <= ({FAULTY} if "timeout" in status else set()), "once more, with no other case"


@pytest.mark.parametrize("ads", ["Gambles", "ImportsTraci", "Steps"])
def test_case_that_cannot_share_a_batch_drives_alone(ads):
    """Global random numbers have to come case by case; who asks SUMO needs its case alone, and so
    does TraCI code."""
    together, alone = (
        list(run_cases(cases(f"faulty_policies.py:{ads}"), setup(workers=1, **size)))
        for size in ({}, {"cases_per_pack": 1})
    )
    assert facts(together) == facts(alone)
    assert {outcome.status for outcome in together} == {"collision"}
    assert [outcome.case.point for outcome in together if outcome.log] == (
        [FAULTY] if ads == "ImportsTraci" else []
    )


def test_what_a_batch_prints_and_how_it_ended_stands_in_the_logs():
    (first, *others) = run_cases(cases("faulty_policies.py:Chatters"), setup(workers=1))
    assert first.log.startswith("Printed by its batch of 9 cases:\na word from the faulty point\n")
    assert not any(outcome.log for outcome in others)
    (first, *others) = run_cases(cases("faulty_policies.py:Exits"), setup(workers=1))
    why = f"{ALONE}Its batch was lost. The process that ran it died with exit code 7.\n"
    assert first.log == f"{why}Printed by its batch of 9 cases:\nlast words before leaving\n"
    assert {outcome.log for outcome in others if outcome.case.point != FAULTY} == {why}


def test_an_ads_that_cannot_be_loaded_is_rejected_case_by_case():
    outcomes = list(run_cases(cases("faulty_policies.py:Missing"), setup(workers=1)))
    assert [outcome.status for outcome in outcomes] == ["rejected"] * 9


def kinds():
    """ADSs, the ideal vehicle; two scenarios; mixed."""
    found = []
    for number, (gap, speed) in enumerate(
        [(20.0, 8.0), (40.0, 12.5), (60.0, 16.0), (30.0, 6.0), (50.0, 10.0)]
    ):
        concrete = CUT_IN.concrete(ego_speed=20.0, cut_in_speed=speed, gap=gap, lateral_speed=0.9)
        found += [
            Case(number, concrete, "ads", name, name) for name in ("careful_driver", "no_reaction")
        ]
        found.append(Case(number, concrete, "ideal", "ideal", "ideal_braking"))
        low = SPACE.concrete(ego_speed=15.0 + number, lead_speed=speed)
        found += [Case(number, low, "ads", name, name) for name in ("careful_driver", "rss")]
    return [with_fingerprint(case, SIMULATION, "", "") for case in found]


def stored(folder, run):
    folder.mkdir()
    with open_store(folder, create=True) as store:
        for outcomes in run_batches(kinds(), run):
            store.add(*outcomes)
        return store.digest()


def test_batch_size_workers_and_engine_change_no_byte(tmp_path):
    alone = stored(tmp_path / "alone", setup(workers=1, cases_per_pack=1))
    for number, run in enumerate(
        [
            setup(workers=1),
            setup(workers=2),
            setup(workers=3, cases_per_pack=2),
            setup(workers=2, cases_per_child=3),
            setup(engine="serial"),
            setup(engine="serial", cases_per_pack=3),
        ]
    ):
        assert stored(tmp_path / str(number), run) == alone


def test_conditions_keep_an_ads_out_of_batches(tmp_path):
    noisy = replace(SIMULATION, conditions=replace(SIMULATION.conditions, reveal_scenario=True))
    found = [
        stored(
            tmp_path / str(size), Setup(noisy, RunSettings(workers=1, cases_per_pack=size), HERE)
        )
        for size in (1, 9)
    ]
    assert found[0] == found[1]


# --- which cases go together ----------------------------------------------------------------------


def taken(batches):
    sizes = []
    batches.look_ahead()
    while batch := batches.take():
        sizes.append(len(batch))
        batches.look_ahead()
    return sizes


def idle_at_the_end(sizes, lengths, workers):
    """How long workers have nothing to do: each takes the next batch when it is free; a batch costs
    8, and its cases."""
    free_at, first = [0] * workers, 0
    for size in sizes:
        soonest = free_at.index(min(free_at))
        free_at[soonest] += 8 + sum(lengths[first : first + size])
        first += size
    return sum(max(free_at) - time for time in free_at)


@pytest.mark.parametrize(
    "count, workers",
    values_of("""
    2125, 2
    1500, 2
    300, 2
    10_000, 8
    40, 2
    1, 2
    """),
)
def test_batches_are_few_and_leave_all_workers_work_to_the_end(count, workers):
    sizes = taken(Batches(alike(count), workers, 256))
    assert sum(sizes) == count
    assert max(sizes) <= 256
    assert sizes == sorted(sizes, reverse=True)
    assert len(sizes) <= -(-count // 256) + 7 * workers, "each costs something of its own"
    for lengths in (
        [1] * count,
        [1 + (number * 7919) % 5 for number in range(count)],
        [3] * (count // 2) + [1] * count,
    ):
        # of a batch; no worker waits longer than the last of them takes
        least = 8 + LEAST * max(lengths)
        assert idle_at_the_end(sizes, lengths, workers) <= (workers - 1) * least


def test_a_batch_holds_one_kind_and_never_more_than_allowed():
    batches = Batches(kinds(), 1, 3)
    seen = 0
    while batch := batches.take():
        assert len({(case.role, case.controller, case.concrete.scenario) for case in batch}) == 1
        assert len(batch) <= 3
        seen += len(batch)
    assert seen == len(kinds())


def test_longest_cases_of_a_kind_go_first():
    slow, quick = (SPACE.concrete(ego_speed=20.0, lead_speed=speed) for speed in (5.0, 15.0))
    drives = [Case(number, quick if number % 2 else slow, "ads", "a", "a") for number in range(8)]
    drives += [Case(number, slow, "human", "driver_00", "synthetic") for number in range(4)]
    batches = Batches(drives, 1, 4)
    batches.look_ahead()
    found = []
    while batch := batches.take():
        found.append((batch[0].role, {case.concrete.label for case in batch}))
    assert found == [("ads", {slow.label}), ("ads", {quick.label}), ("human", {slow.label})]


def test_all_roles_of_all_scenarios_are_one_piece_of_work_with_a_progress_of_each(tmp_path):
    names = ("front_vehicle_low_speed", "front_vehicle_cut_out")
    settings = small(scenarios=names, levels=2, drivers=2, simulation=SimulationSettings(step=0.1))
    shown = {}

    def progress(stage, done, total, failed=0):
        assert done >= shown.get(stage, (0, 0))[0]
        shown[stage] = done, total

    sumo_eval.evaluate(settings, tmp_path / "run", progress=progress)
    kinds = ["ADSs", "ideal vehicle", "no reaction", "drivers"]
    found = [kind for stage in shown if (kind := stage.rpartition(": ")[2]) in kinds]
    assert found == [kind for kind in kinds for _ in settings.scenario]
    assert all(done == total for done, total in shown.values())


@pytest.mark.parametrize(
    "too_slow, expected", [(False, [16, 32, 64, 64]), (True, [16, 16, 16, 16])]
)
def test_batches_shrink_when_lost_and_grow_again(too_slow, expected):
    batches = Batches(alike(4000), 1, 64)
    batch = batches.take()
    assert len(batch) == 64
    batches.record_failure(batch, [Alone("pack_lost", "it broke")] * 64, "", too_slow=too_slow)
    batches.look_ahead()
    alone = [batches.take() for _ in range(64)]
    assert [case for one in alone if one is not None for case in one] == list(batch)
    sizes = []
    for _ in range(4):
        batch = batches.take()
        sizes.append(len(batch))
        batches.record_success(batch)
        batches.look_ahead()
    assert sizes == expected


def test_an_evaluation_with_millions_of_cases_is_not_planned_before_it_begins():
    many = alike(10**6)
    Batches(many, 2, 256).take()
    assert next(many).point <= 2 * 4 * 256


def test_options_that_reject_a_case_reject_it_in_a_batch():
    for ads in ("careful_driver?period=0.2", "idm?period=0.23"):
        found = [list(run_cases(cases(ads, 3), setup(cases_per_pack=size))) for size in (1, 3)]
        assert facts(found[0]) == facts(found[1])
        assert {outcome.status for outcome in found[1]} == {"rejected"}


def test_friction_of_a_run_limits_the_ideal_vehicle():
    concrete = CUT_IN.concrete(ego_speed=20.0, cut_in_speed=6.0, gap=20.0, lateral_speed=0.9)
    icy = replace(SIMULATION, vehicle=replace(SIMULATION.vehicle, friction=0.3))
    iced = replace(concrete, changes=(("vehicle.friction", 0.3),))
    dry, *ice = (
        run_case(
            Case(0, case, "ideal", "ideal", "ideal_braking"), Setup(simulation, RunSettings(), HERE)
        ).recording
        for case, simulation in ((concrete, SIMULATION), (concrete, icy), (iced, SIMULATION))
    )
    assert ice[0].drives == ice[1].drives
    braking = [it.ego.acceleration.min() for it in (dry, ice[0])]
    assert braking == pytest.approx([-9.0, -0.3 * 9.81], rel=1e-6)


def test_score_says_which_drives_left_their_batch(tmp_path):
    settings = small(
        {"mine": f"{HERE / 'faulty_policies.py'}:Exits", "idm": "idm"},
        drivers=2,
        steps={"ego_speed": 5.0, "lead_speed": 10.0},
        simulation=SIMULATION,
        run=RunSettings(),
    )
    mine, idm = sumo_eval.evaluate(settings, tmp_path / "run").scores
    (note,) = (text for note in mine.notes if "could not share" in (text := score_note(note)))
    lost = "Its batch was lost. The process that ran it died with exit code 7."
    assert (
        note == f"{mine.cases} drives could not share one simulation with others and ran alone, "
        f"which changes results of policies over arrays only. {mine.cases} x: {lost}"
    )
    assert mine.not_evaluated >= 1
    assert not any("could not share" in score_note(note) for note in idm.notes)


def test_finished_batches_run_again_alone_once_state_shows(tmp_path, monkeypatch):
    monkeypatch.setattr("sumo_eval.record.batches._LOOSE", 3)
    (tmp_path / "mine.py").write_text(
        "SLOW = []\n"
        "def step(traci, ego, time):\n"
        "    if traci.vehicle.getSpeed(ego) < 16.5:\n"
        "        SLOW.append(time)\n"
        "    traci.vehicle.setSpeed(ego, traci.vehicle.getSpeed(ego) + 0.1)\n"
    )
    run = RunSettings(engine="serial", cases_per_pack=4)
    batches = list(run_batches(cases("mine.py:step", 8), Setup(SIMULATION, run, tmp_path)))
    found = [one for batch in batches for one in batch]
    assert {one.case.point for one in found if one.batched} == {4, 5, 6, 7}
    last = {one.case.point: one.alone and one.alone.why for one in found}
    assert (len(found), last) == (12, dict.fromkeys(range(8), "keeps_state"))
    once = list(once_each(batch for batch in batches))
    assert sorted(one.case.point for one in once) == list(range(8))
    assert not any(one.batched for one in once)


def test_each_case_of_an_ads_with_state_has_the_reason(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from sumo_eval import Command\n"
        "CALLS = []\n"
        "class Mine:\n"
        "    def act(self, seen):\n"
        "        CALLS.append(1)\n"
        "        return Command(-0.0001 * len(CALLS))\n"
    )
    run = RunSettings(engine="serial", cases_per_pack=4)
    found = run_cases(cases("mine.py:Mine", 9), Setup(SIMULATION, run, tmp_path))
    assert [one.alone and one.alone.why for one in found] == ["keeps_state"] * 9


def test_state_found_on_one_worker_of_a_cluster_counts_on_all():
    plan, state = Batches(cases("hook"), workers=2, largest=9), Alone("keeps_state", "Mine.seen")
    batch = plan.take()
    together = [Outcome(case, "ok", None, batched="batched") for case in batch]
    assert list(_counted(together[:4], plan)) == together[:4]
    alone = replace(together[4], batched="", alone=state)
    assert list(_counted([alone, together[5]], plan)) == [alone]
    assert [plan.take() for _ in range(5)] == [(case,) for case in (*batch[:4], batch[5])]
    (rerun,) = _counted([replace(together[0], batched="")], plan)
    assert rerun.alone == state
