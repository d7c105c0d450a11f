"""A system without POSIX, simulated: its modules are not there and nothing forks.

Whether Windows itself runs the program cannot be seen here.
"""

import os

import pytest
from commands import cli_refuses, python
from laid import read_json

from sumo_eval.record.engines import refuse_engine
from sumo_eval.settings import RunSettings

IMPORT_ALL = """
import importlib, os, pkgutil, signal, sys, types


def everything():
    import sumo_eval.errors
    for module in pkgutil.walk_packages(sumo_eval.__path__, "sumo_eval.", onerror=lambda name: None):
        if module.name.endswith("__main__"):
            continue
        try:
            importlib.import_module(module.name)
        except sumo_eval.errors.InputError as error:
            assert "needs the extra" in str(error), error
"""
TAKE_AWAY = """
MISSING = {"fcntl", "resource", "termios", "pwd", "grp", "pty", "tty", "syslog"}


class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in MISSING:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


for name in MISSING:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Missing())
for owner, names in (
    (os, ("fork", "setsid", "killpg", "getuid", "geteuid", "getpgid", "getpgrp", "register_at_fork", "sysconf")),
    (signal, ("SIGKILL", "SIGHUP", "SIGCONT", "SIGCHLD", "SIGALRM", "pthread_sigmask", "setitimer")),
):
    for name in names:
        delattr(owner, name)
"""
BEFORE = """
import os, signal, sys, types
import asyncio, concurrent.futures, ctypes, multiprocessing.popen_spawn_posix, subprocess, tempfile
import click, libsumo, lxml.etree, numba, pandas, plotly.graph_objects, pydantic, rich.console, rich.table
import scipy.stats, sklearn.gaussian_process, threadpoolctl  # they ask what system it is
"""
ELSEWHERE = """
sys.platform = "win32"
sys.modules["msvcrt"] = types.SimpleNamespace(locking=lambda *_: None, LK_NBLCK=2, LK_UNLCK=0)
"""
EVALUATION = """
name = "elsewhere"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = 2
[[ads]]
name = "idm"
controller = "idm"
[drivers]
count = 2
"""


@pytest.mark.campaign
def test_every_module_can_be_imported_without_posix():
    python(f"{IMPORT_ALL}{TAKE_AWAY}everything()")


@pytest.mark.parametrize("how", [(), ("--dry-run",)])
def test_where_nothing_forks_the_engine_of_processes_is_refused_before_the_work(
    tmp_path, monkeypatch, how
):
    (tmp_path / "evaluation.toml").write_text(EVALUATION)
    monkeypatch.delattr(os, "fork")
    words = ["run", str(tmp_path / "evaluation.toml"), "--out", str(tmp_path / "run"), *how]
    result = cli_refuses("The engine `processes` needs a system whose processes can fork", *words)
    assert "--engine serial" in result.said
    refuse_engine(RunSettings(engine="serial"))


@pytest.mark.campaign
def test_a_whole_run_and_its_report_are_made_without_posix_by_the_serial_engine(tmp_path):
    (tmp_path / "evaluation.toml").write_text(EVALUATION)
    words = [
        "run",
        str(tmp_path / "evaluation.toml"),
        "--out",
        str(tmp_path / "run"),
        "--engine",
        "serial",
    ]
    script = f"{BEFORE}{TAKE_AWAY}{ELSEWHERE}from sumo_eval.cli import main\nmain({words!r})"
    python(script)
    (score,) = read_json(tmp_path / "run" / "scores.json")["scores"]
    assert score["not_evaluated"] == 0
    assert score["collisions"] == 0
    assert "In short" in (tmp_path / "run" / "report.html").read_text()
