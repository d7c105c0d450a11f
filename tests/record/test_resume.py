"""Nothing recorded is lost or simulated twice: kill -9, Ctrl-C, a full disk, a changed ADS, a
second writer, shards."""

import json
import os
import re
import resource
import signal
import subprocess
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pytest
from commands import ROOT, cli_refuses, in_a_process, in_a_shell, python
from evaluations import small
from laid import read_json
from record.edited_store import edit
from record.runs import MY_ADS, command, digest, rows, sumo_eval_cli, write_evaluation
from refusals import refusal
from tables import in_campaign

import sumo_eval
from sumo_eval.cli.run import _leave_shard
from sumo_eval.errors import InputError, StoppedError
from sumo_eval.input_file import MANIFEST
from sumo_eval.record import run_folder
from sumo_eval.record.facts import merge, parse_shard, record_facts, resolve, verify
from sumo_eval.record.run_folder import SHARD, only_writer, refuse_incomplete
from sumo_eval.record.sealed import sealed
from sumo_eval.record.store import open_store
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings import DriverSettings, RunSettings
from sumo_eval.settings.config import read_evaluation

CLUSTERS = ROOT / "docs" / "clusters.md"
HANGS = "def MyAds(traci, ego, time):\n    sum(range(10**18))\n"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An uninterrupted run: 6 points, 2 ADSs, 2 drivers, with one worker."""
    folder = tmp_path_factory.mktemp("whole")
    sumo_eval.evaluate(write_evaluation(folder), folder / "run", workers=1)
    return folder / "run"


@pytest.fixture
def path(tmp_path):
    return write_evaluation(tmp_path)


@pytest.fixture
def run(tmp_path):
    """The folder of the run."""
    return tmp_path / "run"


def started(run, path, *options, at_rows=1):
    process = subprocess.Popen(
        command("run", path, "--out", run, *options),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    until = time.monotonic() + 60.0
    while rows(run) < at_rows and process.poll() is None and time.monotonic() < until:
        time.sleep(0.005)
    return process


def assert_continues(path, whole):
    """What is left of the run beside its evaluation continues to the content of a whole one."""
    run = path.with_name("run")
    sumo_eval.evaluate(path, run, resume=True)
    assert digest(run) == digest(whole)


def test_a_killed_run_continues_to_the_same_content(whole, run, path):
    process = started(run, path, at_rows=4)
    process.kill()
    process.communicate()
    before = rows(run)
    sumo_eval_cli("score", run, status=2)  # a part of a run is not scored
    sumo_eval_cli("run", path, "--out", run, "--resume", "--workers", "1")
    assert before < rows(whole), "it was killed in the middle"
    assert digest(run) == digest(whole)
    assert len(read_json(run / "manifest.json")["resumed"]) == 1


def test_resuming_a_complete_run_simulates_nothing(whole, monkeypatch):
    before = digest(whole)
    simulated = []
    from sumo_eval.record import recording

    def run_batches(cases, setup, stopping):
        for case in cases:
            simulated.append(case.key)
            yield from ()

    monkeypatch.setattr(recording, "run_batches", run_batches)
    evaluation = sumo_eval.evaluate(None, whole, resume=True)
    assert simulated == []
    assert digest(whole) == before
    assert evaluation.name == "batch"


def test_resumed_run_names_the_versions_of_its_last_start(path, run, monkeypatch):
    """Drives of another libsumo are repeated, so all facts come from the last start."""
    began = sumo_eval.evaluate(path, run).manifest["versions"]
    monkeypatch.setattr(run_folder, "version", lambda package: "9.9")
    resumed = sumo_eval.evaluate(path, run, resume=True)
    assert resumed.manifest["versions"]["libsumo"] == "9.9"
    assert read_json(run / "manifest.json")["versions"] == began


def test_a_changed_ads_runs_again_and_an_unchanged_one_does_not(whole, tmp_path, run, path):
    sumo_eval.evaluate(path, run)
    assert digest(run) == digest(whole), "another folder is the same run"

    def walls():
        drives = sumo_eval.open_run(run).drives
        return dict(zip(drives["case"], drives["wall_time"], strict=True))

    before = walls()
    (tmp_path / "my_ads.py").write_text(MY_ADS.replace("-2.0", "-3.0"))
    sumo_eval.evaluate(path, run, resume=True)
    after = walls()
    again = {case for case in after if after[case] != before.get(case)}
    assert again == {case for case in after if case.endswith("-mine")}


def test_a_module_that_the_ads_imports_is_part_of_it(tmp_path):
    path = write_evaluation(tmp_path, "from gains import GAIN\n" + MY_ADS)
    (tmp_path / "gains.py").write_text("GAIN = 1.0\n")
    (tmp_path / "unrelated.py").write_text("x = 1\n")
    from sumo_eval.record.recording import planner

    settings = read_evaluation(path)
    first = planner(Resolved(settings, tmp_path, {})).identities
    (tmp_path / "unrelated.py").write_text("x = 2\n")
    assert planner(Resolved(settings, tmp_path, {})).identities == first
    (tmp_path / "gains.py").write_text("GAIN = 2.0\n")
    second = planner(Resolved(settings, tmp_path, {})).identities
    assert second["idm"] == first["idm"]
    assert second["my_ads.py:MyAds"] != first["my_ads.py:MyAds"]


def test_changed_drives_of_an_own_reference_are_taken(tmp_path, run):
    people = (
        "from pathlib import Path\n"
        "from sumo_eval.trajectory import Trajectory\n"
        "def drives(concrete):\n"
        "    speed = float(Path(__file__).with_suffix('.txt').read_text())\n"
        "    return [Trajectory([0.0, 9.0], [50.0, 50.0 + 9.0 * speed], [0.0, 0.0])]\n"
    )
    (tmp_path / "people.py").write_text(people)
    evaluation = replace(
        small(["idm"], steps={"ego_speed": 100.0, "lead_speed": 100.0}),
        drivers=DriverSettings(source=f"{tmp_path / 'people.py'}:drives"),
    )
    for speed in (10.0, 5.0):
        (tmp_path / "people.txt").write_text(str(speed))
        record_facts(Resolved.of(evaluation, tmp_path), run, resume=speed == 5.0)
    case = "front_vehicle_low_speed-0000-~driver_00"
    with open_store(run) as store:
        assert store.trajectory(case).x[-1] == 95.0


def test_resuming_with_fewer_cases_is_refused_and_loses_none(whole):
    before, written = digest(whole), whole / "evaluation.toml"
    run, text = Resolved.of(read_evaluation(written), whole.parent), written.read_text()
    settings = run.settings
    with open_store(whole) as store:
        every = tuple(case for case, *_ in store.names("ads"))
    fewer_points = tuple(case for case in every if "-0000-" in case)
    narrow = [
        replace(settings, run=replace(settings.run, only=it)) for it in (fewer_points, every[1:])
    ]
    for fewer in (replace(settings, ads=settings.ads[:1]), *narrow):
        with refusal("a run keeps its cases"):
            record_facts(replace(run, settings=fewer), whole, resume=True)
        with refusal("cannot continue as shard 1/2"):
            record_facts(replace(run, shard=(1, 2)), whole, resume=True)
        assert digest(whole) == before
        assert written.read_text() == text
    record_facts(run, whole, resume=True)
    assert digest(whole) == before


def test_a_second_writer_is_refused(run, path):
    with only_writer(run, resume=False):
        second = sumo_eval_cli("run", path, "--out", run, "--resume", status=2)
    assert f"is being written by another process (process {os.getpid()}" in second.stderr
    with only_writer(run, resume=False):
        pass


def test_ctrl_c_once_ends_the_cases_and_says_how_to_resume(whole, run, path):
    process = started(run, path, at_rows=2)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Ctrl-C once more stops at once" in errors
    # without --out the folder has a name of its own: the command must name it
    assert f"the same command with --out {run} --resume continues" in errors
    assert "Traceback" not in errors
    assert_continues(path, whole)


def test_ctrl_c_during_scoring_says_where_the_drives_are(whole, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("sumo_eval.cli.run.scored", stop)
    done = sumo_eval_cli("run", "--out", whole, "--resume", status=130)
    words = f"are recorded in {whole}; the same command with --out {whole} --resume continues."
    assert words in done.stderr


def children_of_fork_servers(root):
    """All living processes below `root`."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    found, grown = {root}, True
    while grown:
        more = {pid for pid, parent in parents.items() if parent in found} | found
        grown, found = more != found, more
    return found - {root}


@pytest.mark.parametrize("how", ["killed", in_campaign("twice")])
def test_hanging_children_are_gone_after_ctrl_c_twice_and_after_kill_9(how, tmp_path, run):
    path = write_evaluation(tmp_path, HANGS, case_timeout=300.0)
    process = started(run, path, at_rows=1)
    time.sleep(0.5)
    family = children_of_fork_servers(process.pid)
    assert len(family) >= 3, "fork server, resource tracker, hanging child"
    if how == "twice":
        process.send_signal(signal.SIGINT)
        time.sleep(0.5)
        assert process.poll() is None, "it waits for the case that hangs"
        process.send_signal(signal.SIGINT)
    else:
        process.kill()
    _, errors = process.communicate(timeout=30)
    assert process.returncode == (130 if how == "twice" else -9)
    assert "Traceback" not in errors
    until = time.monotonic() + 10.0
    while alive(family) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(family)
    assert rows(run) >= 1


def alive(pids):
    return {pid for pid in pids if Path(f"/proc/{pid}").exists()}


@pytest.mark.campaign
def test_a_run_whose_disk_fills_up_stops_and_continues_later(whole, run, path):

    def small_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (110_000, 110_000))

    done = in_a_process("run", path, "--out", run, preexec_fn=small_files)
    assert done.returncode == 2, done.stderr
    assert "cannot be written" in done.stderr
    assert "Traceback" not in done.stderr
    assert_continues(path, whole)


@pytest.mark.campaign
def test_a_folder_that_was_half_made_is_made_again(whole, tmp_path, run, path):
    (run / "networks").mkdir(parents=True)
    (run / "evaluation.toml.half").write_text("nam")
    assert_continues(path, whole)
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "thesis.txt").write_text("three years of work")
    with refusal("is not a run folder"):
        sumo_eval.evaluate(path, tmp_path / "foreign", resume=True)


def sbatch(script, folder):
    """A stand-in for Slurm's: each job of the array that `#SBATCH` lines of a script ask for, one
    after the other."""
    asked = dict(re.findall(r"^#SBATCH --([\w-]+)=(\S+)", script, flags=re.MULTILINE))
    first, last = map(int, asked["array"].split("-"))
    (folder / "job.sh").write_text(script)
    return [in_a_shell("bash job.sh", folder, SLURM_ARRAY_TASK_ID=f"{job}",
        SLURM_CPUS_PER_TASK=asked["cpus-per-task"])
            for job in range(first, last + 1)]  # fmt: skip


@pytest.mark.campaign
def test_shards_make_the_whole_and_only_together(whole, tmp_path):
    """As docs/clusters.md has it for Slurm, with two jobs of one process in place of eight of
    sixteen."""
    write_evaluation(tmp_path)
    script, merging = re.findall(r"```sh\n(.*?)```", CLUSTERS.read_text(), flags=re.DOTALL)[:2]
    for there, here in (
        ("array=1-8", "array=1-2"),
        ("TASK_ID/8", "TASK_ID/2"),
        ("cpus-per-task=16", "cpus-per-task=1"),
    ):
        assert there in script
        script = script.replace(there, here)
    jobs = sbatch(script, tmp_path)
    for number, done in enumerate(jobs, start=1):
        assert done.returncode == 0, done.stderr
        assert f"Shard {number}/2" in done.stdout
    shards = tmp_path / "shards"
    cli_refuses(
        "is shard 1/2 of an evaluation; put the shards together first", "score", shards / "1"
    )
    for parts, sentence in (
        (("1",), "missing: 2/2"),
        (("1", "2", "2"), "are both shard 2/2"),
        (("1", "2", str(whole)), "is shard 1/1, among shards of 2"),
        (("1", str(whole)), "is shard 1/1, among shards of 2"),
    ):
        cli_refuses(
            sentence, "merge", *(shards / part for part in parts), "--out", tmp_path / "merged"
        )
    done = in_a_shell(merging, tmp_path)
    assert done.returncode == 0, done.stderr
    merged = tmp_path / "results" / "night"
    assert digest(merged) == digest(whole)
    assert (merged / "report.html").is_file()


def test_shards_of_other_cases_make_no_whole(tmp_path):
    evaluation = small({"idm": "idm"}, drivers=2, steps={"ego_speed": 100.0, "lead_speed": 100.0})
    folders = [tmp_path / "whole", tmp_path / "single"]
    for number, only in enumerate((None, ("front_vehicle_low_speed-0000-idm",))):
        run = resolve(evaluation, folders[number], resume=False, only=only)
        record_facts(replace(run, shard=(1 + number, 2)), folders[number])
    with refusal("is of another evaluation"):
        merge(folders, tmp_path / "merged")


def test_files_that_changed_between_shards_are_named(tmp_path):
    ads, scenario = tmp_path / "mine.py", tmp_path / "slow.toml"
    shipped = scenario_files()["front_vehicle_low_speed"].read_text()
    scenario.write_text(shipped)
    (tmp_path / "evaluation.toml").write_text(
        'name = "x"\n[[scenario]]\nuse = "slow.toml"\nsampling = { levels = 2 }\n[[ads]]\nname = "m"'
        '\ncontroller = "mine.py:acc"\n[drivers]\ncount = 2\n[run]\nengine = "serial"\n'
    )

    def shard(number, braking):
        folder = tmp_path / f"{number}{braking}"
        ads.write_text(f"def acc(seen):\n    return -{braking}.0\n")
        run = resolve(tmp_path / "evaluation.toml", folder, resume=False)
        record_facts(replace(run, shard=(number, 2)), folder)
        return folder

    first, second = shard(1, 0), shard(2, 3)
    recorded = run_folder.read_exposures(first)
    scenario.write_text(shipped.replace("speed of the ego", "its speed"))
    assert merge((first, second), tmp_path / "all").notes == (
        "ADS `mine.py:acc` may have driven with more than one version of mine.py: its scores would "
        "mix them.",
    )
    assert run_folder.read_exposures(tmp_path / "all") == recorded
    with refusal("other files of scenarios or recordings"):
        merge((first, shard(2, 0)), tmp_path / "other")


def test_shards_of_an_earlier_version_are_merged(tmp_path):
    """Their manifests have no hashes of files: exposures alone show a changed scenario."""
    shards = [tmp_path / "first", tmp_path / "second"]
    for number, folder in enumerate(shards, 1):
        run = resolve(small({"idm": "idm"}, drivers=2, levels=2), folder, resume=False)
        record_facts(replace(run, shard=(number, 2)), folder)
        manifest = dict(run_folder.read_manifest(folder))
        del manifest["files"], manifest["builds"]
        (folder / MANIFEST).write_text(sealed(manifest))
    merge(shards, tmp_path / "merged")
    assert run_folder.read_manifest(tmp_path / "merged")["files"] == {}
    run_folder.write_exposures(shards[1], {"front_vehicle_low_speed": {}})
    with refusal("other files of scenarios or recordings"):
        merge(shards, tmp_path / "other")


def test_a_run_without_trajectories_is_not_merged(tmp_path):
    folder, merged = tmp_path / "whole", tmp_path / "merged"
    sumo_eval.evaluate(
        small({"idm": "idm"}, drivers=2, levels=2, run=RunSettings(engine="serial", keep="none")),
        folder,
    )
    with refusal("must have all trajectories; some were discarded"):
        merge([folder], merged)
    assert not merged.exists()


def test_a_merged_run_names_files_and_builds_of_its_shards(tmp_path, monkeypatch):
    monkeypatch.setattr(run_folder, "commit_of", lambda _: "driven")
    (tmp_path / "mine.py").write_text("def acc(seen):\n    return 0.0\n")
    checks = {
        "created": "2026", "versions": {}, "machine": {}, "checks": [{"name": "a", "passed": True}]
    }  # fmt: skip
    qualification = tmp_path / "qualification.json"
    qualification.write_text(json.dumps(checks))
    settings = small(
        {"mine": f"{tmp_path}/mine.py:acc"}, drivers=2, levels=2,
        run=RunSettings(engine="serial", qualification=str(qualification)),
    )  # fmt: skip
    shards = [tmp_path / "first", tmp_path / "second"]
    for number, folder in enumerate(shards, 1):
        record_facts(replace(resolve(settings, folder, resume=False), shard=(number, 2)), folder)

    monkeypatch.setattr(run_folder, "commit_of", lambda _: "later")
    qualification.unlink()
    merge(shards[::-1], tmp_path / "merged")
    driven, merged = map(run_folder.read_manifest, (shards[0], tmp_path / "merged"))
    assert merged == driven


@pytest.mark.parametrize("text", ["0/4", "5/4", "1", "a/b", "1/", "-1/4", "1/" + "9" * 5000])
def test_a_shard_that_is_none_is_refused(text):
    with refusal("must have the form i/n"):
        parse_shard(text)


def test_a_shard_with_one_failed_drive_counts_it(tmp_path, capsys):
    with pytest.raises(SystemExit):
        _leave_shard("1/2", tmp_path, 30, 1)
    assert ", 1 drive of ADSs not evaluated." in capsys.readouterr().out


def test_a_share_that_is_none_is_refused(tmp_path):
    with refusal("`share` of `verify` must be above 0"):
        verify(tmp_path, float("nan"))


def test_verify_passes_on_the_same_and_fails_on_a_bit(tmp_path, run):
    sumo_eval.evaluate(write_evaluation(tmp_path), run)
    done = sumo_eval_cli("verify", run, "--share", "1")
    assert f"{rows(tmp_path / 'run')} drives" in done.stdout
    change = (
        "UPDATE facts SET simulated_time = simulated_time + 1e-9 WHERE \"case\" LIKE '%-0002-idm'"
    )
    edit(run / "facts.sqlite", change, hashes=True)
    done = sumo_eval_cli("verify", run, "--share", "1", status=1)
    assert "-0002-idm: it is not the same again: simulated_time" in done.stdout
    (tmp_path / "my_ads.py").write_text(MY_ADS.replace("-2.0", "-3.0"))
    done = sumo_eval_cli("verify", run, "--share", "1", status=1)
    assert done.stdout.count("it depends on what has changed since") == 1


def test_a_dry_run_counts_the_drives_and_makes_no_folder(run, path):
    done = sumo_eval_cli("run", path, "--dry-run", "--out", run)
    assert "12 drives of the ADSs, 12 of human drivers and 18 of the references" in done.stdout
    assert "with 2 workers" in done.stdout
    assert not run.exists()


@pytest.mark.campaign
def test_the_hash_seed_of_the_interpreter_changes_nothing(whole, tmp_path, run, path):
    environment = {**os.environ, "PYTHONHASHSEED": "77"}
    code = (
        f"import sumo_eval; sumo_eval.evaluate({str(path)!r}, {str(tmp_path / 'run')!r}, workers=8)"
    )
    python(code, env=environment, timeout=120)
    assert digest(run) == digest(whole)


def test_a_caller_can_stop_a_run_and_continue(whole, run, path):
    seen = []

    def count(stage, done, total, failed=0):
        seen.append(done)

    with pytest.raises(StoppedError, match="continues"):
        sumo_eval.evaluate(path, run, progress=count, stopping=lambda: len(seen) > 3)
    with refusal("is not complete; continue with"):
        verify(run, 1.0)
    with open_store(run, create=True) as store:
        refuse = partial(refuse_incomplete, store, run)
        with refusal("--resume[.]$"):
            refuse()
        store.note(SHARD, "2/3")
        with refusal("--resume --shard 2/3[.]$"):
            refuse()
        store.note(SHARD, "1/1")
    for command_line in (("export",), ("whatif", "--all-collisions")):
        cli_refuses("is not complete; continue with", *command_line, run)
    assert_continues(path, whole)


# --- what another process does while cases are driven ---------------------------------------------

SLOW_ADS = "import time as clock\n\n\ndef MyAds(traci, ego, time):\n    clock.sleep(0.02)\n"


NARROW = """
name = "narrow"
[[parameter]]
name = "v"
low = 10.0
high = 30.0
step = 5.0
unit = "m/s"
about = "speed of the ego at the start"
[[parameter]]
name = "w"
low = 1.0
high = 9.3
step = 1.0
unit = "m/s"
about = "speed of the vehicle ahead"
[[constraint]]
require = "abs(w - 6.717) < 0.0001"
about = "one in which the lead drives at 6.717 m/s"
[ego]
speed = "v"
[[vehicle]]
name = "lead"
speed = "w"
gap = "60.0"
[zone]
obstacle = "lead"
"""


def refuse():
    raise InputError("The zones of `mine` cannot be found.")


@dataclass(frozen=True)
class LostElsewhere:
    """Work during which every process but one dies."""

    here: int

    def __call__(self):
        if os.getpid() != self.here:
            os._exit(9)


def test_what_fails_beside_the_driving_ends_it_with_its_own_sentence(whole, tmp_path):
    run = Resolved.of(read_evaluation(write_evaluation(tmp_path, SLOW_ADS)), tmp_path)
    with refusal("zones of `mine`"):
        record_facts(run, tmp_path / "run", meanwhile=refuse)
    assert rows(tmp_path / "run") < rows(whole), "not after an hour of driving"


def test_driving_continues_when_another_process_was_lost(whole, tmp_path):
    run = Resolved.of(read_evaluation(write_evaluation(tmp_path)), tmp_path)
    record_facts(run, tmp_path / "run", meanwhile=LostElsewhere(os.getpid()))
    assert digest(tmp_path / "run") == digest(whole)


def test_missing_zones_are_reported_by_runs_and_by_a_check(tmp_path, run):
    """The point lies where the constraint allows it, and of the even grid by which zones are found
    none does."""
    (tmp_path / "narrow.toml").write_text(NARROW)
    (tmp_path / "points.csv").write_text("v,w\n20.1,6.717\n")
    path = tmp_path / "batch.toml"
    path.write_text(
        'name = "narrow"\n[[scenario]]\nuse = "narrow.toml"\n[scenario.sampling]\nmethod = "file"\n'
        'file = "points.csv"\n[[ads]]\nname = "idm"\ncontroller = "idm"\n'
    )
    sentence = "must have points that satisfy its constraints"
    a_shard = ("run", path, "--out", tmp_path / "shard", "--shard", "1/2")
    for order in (
        ("run", path, "--out", run),
        a_shard,
        ("run", path, "--dry-run"),
        ("check", path),
    ):
        done = sumo_eval_cli(*order, status=None)
        assert done.returncode != 0
        assert sentence in done.stderr + done.stdout
