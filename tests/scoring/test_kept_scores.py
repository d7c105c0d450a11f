"""What was computed of a run is kept and taken over to the last digit, while all that it depends on
is what it was."""

import os
import shutil
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import python
from commands import sumo_eval as sumo_eval_cli
from evaluations import small
from record.edited_store import edit
from refusals import refusal

import sumo_eval
from sumo_eval.evaluation import discard_trajectories, zone_partitions
from sumo_eval.record import fingerprint, human_reference, points
from sumo_eval.record.facts import verify
from sumo_eval.record.fingerprint import space_key
from sumo_eval.record.kept_results import KEPT
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import open_store
from sumo_eval.report.assessed import write_assessed_report
from sumo_eval.report.explain import explain_case, known_case
from sumo_eval.report.replay import recorded
from sumo_eval.scenario import catalogue
from sumo_eval.scoring import critical, drive_results, likeness, steps
from sumo_eval.scoring.case_terms import case_terms
from sumo_eval.scoring.zones import zones_are_known
from sumo_eval.settings import RunSettings, SamplingSettings, ScenarioSettings

EVALUATION = small(("idm", "no_reaction"))


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    return sumo_eval.evaluate(EVALUATION, tmp_path_factory.mktemp("kept") / "run")


@pytest.fixture
def copy(done, tmp_path):
    return Path(shutil.copytree(done.folder, tmp_path / "run", copy_function=shutil.copy2))


def never(*_, **__):
    raise AssertionError("computed again")


def compute_nothing(monkeypatch):
    monkeypatch.setattr(human_reference, "indexes_by_group", never)
    monkeypatch.setattr(drive_results, "measures", never)
    monkeypatch.setattr(likeness, "collision_weight", never)


def same(one, other):
    return (one.scores, one.zones, one.ranking) == (other.scores, other.zones, other.ranking) and (
        list(one.cases) == list(other.cases)
    )


def test_a_scored_run_answers_from_what_is_kept(done, monkeypatch):
    monkeypatch.setattr(steps.Scoring, "scores", never)
    again = sumo_eval.score(done.folder)
    assert same(again, done)
    assert len(again.cases) == sum(score.cases for score in again.scores) == len(list(again.cases))
    row = again.cases[-1]
    assert again.case(row.case) == row == list(again.cases_of(row.ads, row.scenario))[-1]
    assert again.case("no such case") is None
    kept, held = (
        case_terms(cases, again.settings.method) for cases in (again.cases, list(again.cases))
    )
    for one in fields(kept):
        np.testing.assert_array_equal(getattr(kept, one.name), getattr(held, one.name))


def test_zones_that_this_process_knows_are_those_a_child_computes(done, tmp_path):
    settings, source = EVALUATION, Path(done.manifest["source_folder"])
    assert zones_are_known(settings, source)
    for name in ("known", "anew"):
        processes = replace(settings, run=RunSettings(engine="processes"))
        one = sumo_eval.evaluate(processes, tmp_path / name)
        points.ZONES.clear()
        assert one.scores == done.scores
        assert one.zones == done.zones
        assert one.ranking == done.ranking


def test_changing_k5_computes_no_field_and_reads_no_drive(done, monkeypatch):
    compute_nothing(monkeypatch)
    doubled = sumo_eval.score(done.folder, ["method.score.k5=0.5"])
    for before, after in zip(done.scores, doubled.scores, strict=True):
        assert after.c_points == pytest.approx(0.5 * before.c_points)
        assert after.d == before.d
        assert after.human_likeness == before.human_likeness
    with pytest.raises(AssertionError, match="computed again"):
        sumo_eval.score(done.folder, ["method.anthropomorphic.slice_spacing=7.0"])


@pytest.mark.parametrize("points", [1, 4])
def test_scores_do_not_depend_on_how_many_points_are_in_memory(done, copy, points, monkeypatch):
    (copy / KEPT).unlink()
    monkeypatch.setattr(steps, "POINTS_AT_ONCE", points)
    assert same(sumo_eval.score(copy), done)


def test_stopped_scoring_continues_where_it_was(done, copy, monkeypatch):
    (copy / KEPT).unlink()
    monkeypatch.setattr(steps, "POINTS_AT_ONCE", 2)
    computed = []
    compute = human_reference._compute_chunk

    def counting(part):
        computed.append(len(part[1]))
        return compute(part)

    def stopping(stage, points, of, failed=0):
        if "comparison" in stage and points >= of / 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(human_reference, "_compute_chunk", counting)
    with pytest.raises(KeyboardInterrupt):
        sumo_eval.score(copy, progress=stopping)
    before = sum(computed)
    monkeypatch.setattr(likeness, "collision_weight", never)
    assert same(sumo_eval.score(copy), done)
    # no point twice
    assert 0 < before < sum(computed) <= max(score.safe_cases for score in done.scores)


@pytest.mark.parametrize(
    "change",
    ["UPDATE parts SET data = zeroblob(length(data))", "UPDATE parts SET place = 10000 + place"],
)
def test_a_damaged_or_lost_column_is_reported(copy, change):
    edit(copy / KEPT, f"{change} WHERE kind = 'rows' AND place % 7 = 3")
    with refusal(r"not as it was written.*may be deleted, unless `\[run\] keep` has discarded"):
        list(sumo_eval.score(copy).cases)


def test_facts_that_changed_without_a_trace_are_found_on_reading(done, copy):
    facts, case = copy / FACTS, done.cases[0].case
    state = facts.stat()
    change = "UPDATE facts SET simulated_time = simulated_time + 1.0"
    edit(facts, f"{change} WHERE \"case\" = '{case}'")
    os.utime(facts, ns=(state.st_atime_ns, state.st_mtime_ns))
    assert facts.stat().st_size == state.st_size
    with refusal(f"`{case}` .* is not as it was recorded"):
        recorded(copy, case)
    os.utime(facts)  # a changed time, and all of it is checked before anything is said
    with refusal(f"`{case}` .* is not as it was recorded"):
        sumo_eval.score(copy)


def test_a_report_that_is_there_is_not_made_again_and_an_edited_one_is(copy):
    path = write_assessed_report(sumo_eval.score(copy))
    first = path.stat().st_mtime_ns, path.read_text()
    write_assessed_report(sumo_eval.score(copy))
    assert path.stat().st_mtime_ns == first[0]
    path.write_text("edited")
    write_assessed_report(sumo_eval.score(copy))
    assert path.read_text() == first[1]


def discarded(scored):
    settings = replace(scored.settings, run=replace(scored.settings.run, keep="none"))
    return discard_trajectories(replace(scored, settings=settings))


def test_a_run_without_its_trajectories_keeps_its_scores(done, copy, monkeypatch):
    scored = sumo_eval.score(copy)
    size = (copy / FACTS).stat().st_size
    gone = discarded(scored)
    with open_store(copy, whole=True) as store:
        drives = sum(count.drives for count in store.counts())
        stays = {case for case, _, _ in store.names("ads") if store.trajectories(case)}
    assert (copy / FACTS).stat().st_size < size
    assert gone == drives
    assert stays == set()
    assert same(sumo_eval.score(copy), done)
    lost = next(case for case in done.cases if case.case not in stays and case.index is not None)
    for refused in (lambda: recorded(copy, lost.case),
        lambda: sumo_eval.open_run(copy).trajectories(lost.case),
        lambda: sumo_eval.score(copy, ["method.zones.restarts=1",
                    "method.anthropomorphic.slice_spacing=7.0"])):  # fmt: skip
        with refusal("were discarded after it was scored"):
            refused()
    told = sumo_eval_cli("export", copy, "--out", copy / "tables")
    assert "MB of trajectories that `[run] keep` has discarded" in told.stderr
    lines = explain_case(
        done_again := sumo_eval.score(copy),
        zone_partitions(done_again),
        known_case(copy, lost.case),
    )
    assert any("its trajectories were discarded" in line for line in lines)
    other = [replace(scored.settings.ads[0], name="other")]
    before = (copy / "evaluation.toml").read_text()
    with refusal("cannot take another drive of case .*-other: trajectories of drivers"):
        sumo_eval.evaluate(scored.settings, copy, resume=True, ads=[*scored.settings.ads, *other])
    assert (copy / "evaluation.toml").read_text() == before
    compute_nothing(monkeypatch)
    assert sumo_eval.score(copy, ["method.score.k5=0.5"]).scores[0].d == done.scores[0].d


def test_explain_computes_d_i_again_and_warns_of_another_in_the_score(done, monkeypatch):
    """What is kept would be compared with itself."""
    case = next(case for case in done.cases if case.index is not None)
    zones, fact = zone_partitions(done), known_case(done.folder, case.case)
    real, computed = human_reference.indexes_by_group, []

    def indexes_by_group(*arguments):
        computed.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(human_reference, "indexes_by_group", indexes_by_group)
    assert "WARNING" not in "".join(explain_case(done, zones, fact))
    assert len(computed) == 1
    other = [replace(it, index=0.1) if it.case == case.case else it for it in done.cases]
    lines = explain_case(replace(done, cases=other), zones, fact)
    assert any("the score has D_i = 0.100000, which this arithm" in line for line in lines)


def test_critical_points_are_collisions_flips_and_the_least_human(done, monkeypatch):
    monkeypatch.setattr(critical, "LEAST_HUMAN", 1)
    logical = catalogue.load("front_vehicle_low_speed")
    row = next(iter(done.cases_of("idm", logical.name)))
    # along one axis: a collision at 2, to which 1 is nearer than to 0; 6 is the least human-like of
    # the rest
    speeds, likeness = (
        (10.0, 13.5, 14.0, 20.0, 20.4, 26.0, 26.3),
        (0.9, 0.9, None, 0.9, 0.9, 0.9, 0.1),
    )
    cases = tuple(
        replace(row, case=f"{n}", values={"ego_speed": speed, "lead_speed": 5.0}, collided=n == 2,
            human_likeness=like,
                status="collision" if n == 2 else "ok")
        for n, (speed, like) in enumerate(zip(speeds, likeness, strict=True))
    )  # fmt: skip
    one = replace(done, scores=(done.score("idm", logical.name),), cases=cases)
    numbers = {case.case: int(case.case) for case in cases}
    found = critical.critical_points(one, numbers)
    assert {number for _, number in found} <= {1, 2, 3, 6}
    assert {number for _, number in found} == {1, 2, 6}
    gone = (*cases[:5], replace(cases[5], departure_time=2.0), cases[6])
    found = critical.critical_points(replace(one, cases=gone), numbers)
    assert {number for _, number in found} == {1, 2, 5, 6}


def test_the_version_of_a_package_that_reads_scenarios_is_part_of_the_key(monkeypatch):
    keys = []
    for number in ("1.0", "1.0", "1.1"):
        reader = SimpleNamespace(value="reader:read", dist=SimpleNamespace(version=number))
        monkeypatch.setattr(fingerprint, "entry_points", lambda group, reader=reader: [reader])
        fingerprint.sources.cache_clear()
        keys.append(fingerprint.sources("scenario"))
    fingerprint.sources.cache_clear()
    assert keys[0] == keys[1] != keys[2]


def test_a_scenario_file_and_what_it_names_are_part_of_the_key(tmp_path):
    (tmp_path / "own.toml").write_text('events = "events.csv"\n')
    (tmp_path / "events.csv").write_text("a\n1\n")
    entry = ScenarioSettings("own.toml?x=1", SamplingSettings(method="file", file="points.csv"))
    (tmp_path / "points.csv").write_text("a\n1\n")
    keys = [space_key(entry, tmp_path)]
    for name in ("own.toml", "events.csv", "points.csv"):
        with (tmp_path / name).open("a") as file:
            file.write("\n")
        keys.append(space_key(entry, tmp_path))
    assert len(set(keys)) == 4
    assert space_key(entry, tmp_path) == keys[-1]
    assert space_key(EVALUATION.scenario[0], tmp_path) == space_key(
        EVALUATION.scenario[0], tmp_path / "elsewhere"
    )


def test_answers_from_what_is_kept_import_neither_a_simulator_nor_scipy(done):
    write_assessed_report(done)
    looking = (
        "import sys\n"
        "from sumo_eval.cli import main\n"
        "looks = ['report', run], ['explain', run, 'no_such_case'], ['replay', run, case, "
        "'--out', out]\n"
        "for words in (*looks, ['export', run, case, '--out', folder]):\n"
        "    try:\n"
        "        main(words)\n"
        "    except SystemExit:\n"
        "        pass\n"
        "print(sorted({'libsumo', 'scipy', 'numba', 'pandas', 'sumo_eval.scoring.steps'} & "
        "set(sys.modules)))\n"
    )
    case = done.cases[0].case
    names = (
        f"run, case, out = {str(done.folder)!r}, {case!r}, {str(done.folder / 'looked.html')!r}\n"
    )
    names += f"folder = {str(done.folder / 'exported')!r}\n"
    told = python(names + looking)
    assert told.stdout.splitlines()[-1] == "[]"
    assert "Unknown case `no_such_case`" in told.stderr
    assert (done.folder / "looked.html").is_file()
    assert list((done.folder / "exported").glob("*.xosc"))


def test_released_trajectories_are_in_no_digest(done, copy, tmp_path):
    other = Path(shutil.copytree(done.folder, tmp_path / "other", copy_function=shutil.copy2))
    with open_store(done.folder) as store:
        digests = [store.digest()]
    for folder in (copy, other):
        assert discarded(sumo_eval.score(folder)) > 0
        with open_store(folder, whole=True) as store:
            digests.append(store.digest())
    assert digests[1] == digests[2] != digests[0]
    # by the rows alone: there is nothing else of them
    compared, differences = verify(copy, 0.2, workers=1)
    assert compared > 0
    assert differences == []
    case = done.cases[0].case
    edit(copy / FACTS, f"UPDATE facts SET status = 'off_road' WHERE \"case\" = '{case}'")
    with refusal(f"`{case}` .* is not as it was recorded"), open_store(copy, whole=True):
        pass
