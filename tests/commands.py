"""The command line in this process: a process of its own costs seconds of imports each time.

What a command changes of the process is put back, so that tests pass in any order: the folder, the
environment, where modules are looked for, the user's modules, who hears signals, warnings, the
state of the random generators.
"""

import contextlib
import os
import random
import shlex
import signal
import subprocess
import sys
import sysconfig
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from click.testing import CliRunner
from loaded import ROOT

from sumo_eval.cli import main

INSTALLED = (
    *map(sysconfig.get_path, ("stdlib", "purelib", "platlib")),
    str(ROOT / "sumo_eval"),
    str(ROOT / "tests"),
)
"""Where modules stay loaded; a module from elsewhere is a user's."""
HEARD = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM, signal.SIGHUP)


@dataclass(frozen=True)
class Done:
    """What a command left behind."""

    returncode: int
    stdout: str
    stderr: str

    @property
    def said(self):
        return self.stdout + self.stderr


def sumo_eval(*arguments, cwd=None, status=0):
    """Run one command in this process as from that folder, and leave the process as it was.

    arguments: its words, or all of them in one line.
    status: its exit status; None: any.
    """
    words = shlex.split(*arguments) if len(arguments) == 1 else map(str, arguments)
    with as_it_was():
        os.chdir(cwd or Path.cwd())
        result = CliRunner().invoke(main, list(words))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception  # a traceback that a person would have seen
    done = Done(result.exit_code, result.stdout, result.stderr)
    assert status in (None, done.returncode), done.said
    assert "Traceback" not in (done.said if status == 2 else done.stderr)
    return done


def cli_refuses(words, *arguments, cwd=None):
    """Run a command, which must end with status 2 and these words on stderr, in any lines."""
    done = sumo_eval(*arguments, cwd=cwd, status=2)
    assert words in " ".join(done.stderr.split()), done.said
    return done


def typed(line, cwd=None):
    """Run one line as a shell takes it apart: quotes, spaces and comments; `> file` gets what was
    printed."""
    command, _, file = line.partition(" > ")
    program, *words = shlex.split(command, comments=True)
    assert program == "sumo-eval", line
    done = sumo_eval(*words, cwd=cwd, status=None)
    if file:
        ((cwd or Path.cwd()) / file.strip()).write_text(done.stdout)
    return done


def in_a_process(*arguments, cwd=None, **options):
    """Run one command in a process of its own: for signals, encodings, devices and exit
    statuses."""
    words = [sys.executable, "-m", "sumo_eval", *map(str, arguments)]
    # GNU readline, which pytest loads, tells children a width of which os.environ knows nothing.
    pipes = {
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "env": dict(os.environ),
        **options,
    }
    return subprocess.run(words, cwd=cwd, text=True, timeout=300, check=False, **pipes)


def program(*words, status=0, **options):
    """Run a program to its end, which must have that status; what it printed is text."""
    words = list(map(str, words))
    done = subprocess.run(words, capture_output=True, text=True, check=False, **options)
    assert done.returncode == status, done.stdout + done.stderr
    return done


def python(code, *arguments, **options):
    """Run code in a Python process of its own, which must end with status 0."""
    return program(sys.executable, "-c", code, *arguments, **options)


@contextlib.contextmanager
def as_it_was():
    """Put back what a command changes of this process."""
    folder, environment, places, modules = (
        Path.cwd(),
        dict(os.environ),
        list(sys.path),
        set(sys.modules),
    )
    handlers = {number: signal.getsignal(number) for number in HEARD}
    drawn, drawn_by_numpy = random.getstate(), np.random.get_state()  # noqa: NPY002 - the generator that users share
    try:
        with warnings.catch_warnings():
            yield
    finally:
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        sys.path[:] = places
        for name in set(sys.modules) - modules:
            if is_a_users(name):
                del sys.modules[name]
        for number, handler in handlers.items():
            signal.signal(number, handler)
        random.setstate(drawn)
        np.random.set_state(drawn_by_numpy)  # noqa: NPY002


def is_a_users(name):
    """Whether a loaded module comes from a file that is neither installed nor this repository's."""
    file = getattr(sys.modules.get(name), "__file__", None)
    return file is not None and not file.startswith(INSTALLED)


def in_a_shell(line, folder, **variables):
    """Have bash run a line, with this installation first on its path."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-c", line], cwd=folder, env={**os.environ, "PATH": path, **variables},
        capture_output=True,
        text=True, timeout=300, check=False,
    )  # fmt: skip
