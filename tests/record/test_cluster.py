"""A real Dask scheduler and two workers in processes of their own; one of them is killed in the
middle."""

import random
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from laid import read_json
from record.runs import MY_ADS, command, digest, rows, sumo_eval_cli, write_evaluation
from refusals import refusal
from road_scenes import at_values

from sumo_eval.record.cases import Case, Setup
from sumo_eval.record.engines import run_cases
from sumo_eval.record.kept import packed
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings

pytest.importorskip("distributed")
HERE = Path(__file__).parent
quietly = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


class Cluster:
    """A scheduler and workers, started and ended by the test."""

    def __init__(self, folder, *options, env=None):
        self.folder, self.env = folder, env
        self.processes = []
        self.file = folder / "scheduler.json"
        self._start(
            "dask_scheduler", "--port", "0", "--no-dashboard", "--host", "127.0.0.1", *options
        )
        self.address = ""

    def worker(self, *options):
        return self._start("dask_worker", "--nthreads", "1", "--no-dashboard", *options)

    def _start(self, program, *options):
        line = [
            sys.executable,
            "-m",
            f"distributed.cli.{program}",
            "--scheduler-file",
            str(self.file),
            *options,
        ]
        with (self.folder / f"{program}_{len(self.processes)}.log").open("wb") as log:
            self.processes.append(
                subprocess.Popen(line, cwd=self.folder, env=self.env, stdout=log, stderr=log)
            )
        return self.processes[-1]

    def listen(self):
        """The scheduler's address, as soon as there is one."""
        until = time.monotonic() + 60.0
        while not self.file.is_file() and time.monotonic() < until:
            time.sleep(0.05)
        return read_json(self.file)["address"]

    def wait_for(self, workers):
        from distributed import Client

        self.address = self.listen()
        with Client(scheduler_file=str(self.file), timeout=60, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with started(tmp_path_factory.mktemp("cluster")) as cluster:
        yield cluster


@contextmanager
def started(folder, *options, env=None):
    """A cluster whose processes end with the block."""
    cluster = Cluster(folder, *options, env=env)
    try:
        yield cluster
    finally:
        for process in reversed(cluster.processes):
            process.terminate()
        for process in cluster.processes:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.mark.campaign
@quietly
def test_every_case_ends_once_when_a_worker_is_killed_in_the_middle(cluster):
    victim = cluster.worker("--no-nanny")
    cluster.worker("--nanny")
    cluster.wait_for(2)
    space = catalogue.load("front_vehicle_low_speed")
    concrete = space.concrete(ego_speed=20, lead_speed=10)
    names = ["idm", "faulty_ads.py:coast", "faulty_ads.py:raises", "faulty_ads.py:vanishes"]
    cases = [Case(n, concrete, "ads", names[n % 4], names[n % 4]) for n in range(160)]
    run = RunSettings(engine="dask", scheduler=cluster.address)
    found = []
    for outcome in run_cases(cases, Setup(SimulationSettings(), run, HERE)):
        if len(found) == 1:
            victim.kill()
            victim.wait()
        found.append(outcome)
    assert sorted(o.case.key for o in found) == sorted(case.key for case in cases)
    by_name = {name: [o for o in found if o.case.driver == name] for name in names}
    assert [{o.status for o in by_name[name]} for name in names] == [
        {"ok"},
        {"collision"},
        {"ads_error"},
        {"crashed"},
    ]
    (alone,) = run_cases([cases[0]], Setup(SimulationSettings(), RunSettings(workers=1), HERE))
    assert {packed(o.recording.ego) for o in by_name["idm"] if o.recording} == {
        packed(alone.recording.ego)
    }


@pytest.mark.campaign
@quietly
def test_the_command_line_runs_on_the_cluster_to_the_same_digest(cluster, tmp_path):
    import sumo_eval

    path = write_evaluation(tmp_path, levels=2)
    if not cluster.address:
        cluster.worker("--nanny")
        cluster.wait_for(1)
    sumo_eval_cli(
        "run", path, "--out", tmp_path / "far", "--engine", "dask", "--scheduler", cluster.address
    )
    sumo_eval.evaluate(path, tmp_path / "near", workers=1)
    assert (
        sumo_eval.open_run(tmp_path / "far").digest()
        == sumo_eval.open_run(tmp_path / "near").digest()
    )


@pytest.mark.campaign
@quietly
def test_workers_that_are_killed_at_random_moments_cost_no_case(tmp_path):
    """In the place of each worker that is killed another one is started."""
    with started(tmp_path) as cluster:
        workers = [cluster.worker("--no-nanny") for _ in range(2)]
        cluster.wait_for(2)
        concrete = at_values("front_vehicle_low_speed", ego_speed=20, lead_speed=10)
        cases = [Case(number, concrete, "ads", "idm", "idm") for number in range(3_000)]
        run = RunSettings(engine="dask", scheduler=cluster.address, cases_per_pack=8)
        moments, killed, found = random.Random(5), 0, []
        until = time.monotonic()
        for outcome in run_cases(cases, Setup(SimulationSettings(), run, HERE)):
            found.append(outcome)
            if time.monotonic() > until and killed < 4:
                until = time.monotonic() + moments.uniform(0.0, 1.0)
                victim = workers.pop(moments.randrange(len(workers)))
                victim.kill()
                victim.wait()
                workers.append(cluster.worker("--no-nanny"))
                killed += 1
        assert killed >= 3
        assert sorted(one.case.point for one in found) == list(range(3_000))
        assert {one.status for one in found} <= {"ok", "crashed"}
        lost = [one for one in found if one.status == "crashed"]
        assert all("Its worker was lost 3 times" in (one.error or "") for one in lost)
        assert len({packed(one.recording.ego) for one in found if one.recording}) == 1


SLOW_TO_BEGIN = MY_ADS.replace(
    "    def step", "    def __init__(self):\n        __import__('time').sleep(0.2)\n\n    def step"
)


@pytest.mark.campaign
def test_a_run_whose_scheduler_is_killed_continues_with_another(tmp_path):
    path, far = write_evaluation(tmp_path, SLOW_TO_BEGIN, levels=5), tmp_path / "far"
    (tmp_path / "first").mkdir()
    with started(tmp_path / "first") as cluster:
        cluster.worker("--no-nanny")
        cluster.wait_for(1)
        words = command(
            "run", path, "--out", far, "--engine", "dask", "--scheduler", cluster.address
        )
        process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        until = time.monotonic() + 240.0
        while not rows(far) and process.poll() is None and time.monotonic() < until:
            time.sleep(0.05)
        cluster.processes[0].kill()
        _, said = process.communicate(timeout=120)
    assert process.returncode == 2, said
    assert "Traceback" not in said
    assert said.count("sumo-eval: ") == 1
    assert f"The Dask scheduler at {cluster.address} does not answer any more" in said
    before = rows(far)
    assert before > 0
    (tmp_path / "second").mkdir()
    with started(tmp_path / "second") as cluster:
        cluster.worker("--no-nanny")
        cluster.wait_for(1)
        sumo_eval_cli(
            "run",
            path,
            "--out",
            far,
            "--resume",
            "--engine",
            "dask",
            "--scheduler",
            cluster.address,
        )
    assert rows(far) > before
    sumo_eval_cli("run", path, "--out", tmp_path / "near")
    assert digest(far) == digest(tmp_path / "near")


def test_without_a_scheduler_there_is_a_message():
    setup = Setup(SimulationSettings(), RunSettings(engine="dask"), HERE)
    with refusal("needs the address of a scheduler"):
        next(run_cases([], setup))


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setattr("sumo_eval.record.cluster._CONNECT_TIME", 0.5)
    setup = Setup(
        SimulationSettings(), RunSettings(engine="dask", scheduler="tcp://127.0.0.1:9"), HERE
    )
    with refusal(r"no Dask scheduler at tcp://127\.0\.0\.1:9"):
        next(run_cases([], setup))
