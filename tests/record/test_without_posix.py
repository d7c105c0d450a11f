"""A system without POSIX, simulated: its modules are not there and nothing forks.

Whether Windows itself runs the program cannot be seen here.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from sumo_eval.cli import main
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


def test_every_module_can_be_imported_without_posix() -> None:
    script = f"{IMPORT_ALL}{TAKE_AWAY}everything()"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("how", [(), ("--dry-run",)])
def test_where_nothing_forks_the_engine_of_processes_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: tuple[str, ...]
) -> None:
    (tmp_path / "evaluation.toml").write_text(EVALUATION)
    monkeypatch.delattr(os, "fork")
    words = ["run", str(tmp_path / "evaluation.toml"), "--out", str(tmp_path / "run"), *how]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 2
    assert "The engine `processes` needs a system whose processes can fork" in result.output
    assert "--engine serial" in result.output
    refuse_engine(RunSettings(engine="serial"))
