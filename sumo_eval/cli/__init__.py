"""The command line, `sumo-eval`: its group of commands, its help, and its exit status of errors.

A command's file is imported when the command is named; `--help`, which lists all, imports them all.
"""

import atexit
import ctypes
import errno
import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NoReturn

import click

from sumo_eval.cli.exit_status import INPUT_WRONG, INTERRUPTED, NOT_READ
from sumo_eval.cli.sentences import WHOLE, tell
from sumo_eval.errors import InputError, StoppedError, SumoEvalError, did_you_mean, users_code
from sumo_eval.gone import refuse_command
from sumo_eval.input_file import NO_WORKING_FOLDER
from sumo_eval.text import clean, clean_log

_CORE = {
    "run": ("run", "score", "merge", "verify"),
    "look": ("report", "explain", "find", "replay", "export"),
    "compare": ("compare", "nightly", "accept", "trend"),
    "whatif": ("whatif",),
    "space": ("scenarios", "partition", "sample"),
    "tools": ("check", "schema"),
}
"""Files of this folder, and the commands that each defines."""

_FILE_OF = {name: file for file, names in _CORE.items() for name in names}

GROUP = "sumo_eval.commands"
"""Group of entry points by which packages add commands: a name and a click command.

The extras of this package use it too.
"""

TASKS = {
    "Evaluate": {
        "run": "evaluate simulate start execute go resume launch",
        "score": "rescore rank ranking recompute",
        "merge": "combine join gather shards",
        "verify": "reproduce repeat again rerun",
    },
    "Look at a run": {
        "report": "html page show open result results",
        "explain": "why case ledger arithmetic",
        "whatif": "counterfactual lever margin avoid change",
        "find": "parameters nearest locate lookup",
        "replay": "watch view animate animation gui video play",
        "plot": "figure figures chart svg pdf png picture",
        "export": "evidence csv parquet table tables dump xosc sumocfg",
    },
    "Compare runs": {
        "compare": "diff gate regression versus",
        "nightly": "night cron schedule ci",
        "accept": "approve pin baseline bless",
        "trend": "history nights",
    },
    "Look into a space": {
        "scenarios": "list catalogue catalog ls",
        "partition": "zones zone split hazard",
        "sample": "points draw grid sobol",
        "boundary": "search edge limit frontier",
    },
    "Drive yourself": {"drive": "wheel simulator steer keyboard gamepad study participants"},
    "From recordings to rates": {
        "learn": "fit rates distribution",
        "campaign": "rate crashes kilometre km risk importance",
    },
    "People and open constants": {
        "humans": "people drivers recordings events exposure opinion population",
        "calibrate": "k5 k6 tune scale",
        "sensitivity": "k1 k2 constants vary",
    },
    "Believe the tool": {"qualify": "credible credibility believe selftest trustworthy"},
    "Write an ADS or a scenario": {
        "import": "openscenario convert translate read",
        "check": "validate lint test contract",
        "schema": "json editor autocomplete",
        "bench": "benchmark speed performance profile",
    },
}
"""Sections of the help, with the commands of this package, extras included, and words that a user
may type instead.
"""

MEANT = {name: words for names in TASKS.values() for name, words in names.items()}
"""By command of this package: words that a user may type instead, separated by spaces."""

FURTHER = "From other packages"
"""Section of the help with the commands of other packages."""


class _Group(click.Group):
    """The commands: each loaded when it is named.

    A misspelt name gets the nearest one offered; an error becomes a message and an exit status.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:
        return commands()

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in _FILE_OF:
            command = getattr(import_module(f"sumo_eval.cli.{_FILE_OF[cmd_name]}"), cmd_name)
        elif cmd_name in _plugins():
            command = _loaded(_plugins()[cmd_name])
        else:
            return None
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        refuse_command(args)
        if args and not args[0].startswith("-") and args[0] not in commands():
            if (
                args[0] in MEANT
            ):  # of this package, but its entry point was added after installation
                raise click.UsageError(
                    f"Command `{args[0]}` is not installed: run `pip install -e .` again."
                )
            raise click.UsageError(f"There is no command `{clean(args[0])}`.{_nearest(args[0])}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands by task, each in one line that is not cut."""
        further = {name: "" for name in commands() if name not in MEANT}
        for task, names in {**TASKS, FURTHER: further}.items():
            installed = [name for name in names if name in commands()]
            if installed:
                with formatter.section(task):
                    formatter.write_dl([(name, self._line(ctx, name)) for name in installed])

    def _line(self, ctx: click.Context, name: str) -> str:
        """Line of a command in the help."""
        try:
            command = self.get_command(ctx, name)
        except InputError as error:  # a broken package must not hide the help of the rest
            return str(error)
        assert command is not None
        return command.get_short_help_str(limit=WHOLE)

    def main(self, args: Any = None, *rest: Any, **named: Any) -> Any:
        if args is None:  # called from a shell; callers in Python, such as tests, give arguments
            # SIGTERM acts as Ctrl-C, outside of drives as well
            signal.signal(signal.SIGTERM, signal.default_int_handler)
            _fill_closed_streams()
            _read_utf8()
            out: Any = sys.stdout
            if out.errors == "strict":  # print `?` for a character that its encoding lacks
                out.reconfigure(errors="replace")
        return super().main(args, *rest, **named)

    def invoke(self, ctx: click.Context) -> Any:
        # Limit linear algebra to one thread unless the user has set a number; this must be done
        # before numpy is loaded. The matrices are small, so threads would only wait for each other.
        # The last bits of sums depend on the number of threads.
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")
        _give_memory_back()
        # without this, Python searches all objects for garbage at exit, which takes 0.2 s
        atexit.register(gc.freeze)
        with _errors_reported():
            return super().invoke(ctx)

    def make_context(self, *args: Any, **named: Any) -> click.Context:
        with _errors_reported():  # `--help` and `--version` print here, which may fail
            return super().make_context(*args, **named)


@contextmanager
def _errors_reported() -> Iterator[None]:
    """Turn errors into a message and an exit status."""
    try:
        yield
    except (StoppedError, KeyboardInterrupt) as stop:
        tell(f"sumo-eval: {str(stop) or 'Stopped.'}", err=True)
        sys.exit(INTERRUPTED)
    except SumoEvalError as error:
        # without this, the fork server continues to load the simulator for seconds
        if "sumo_eval.record.children" in sys.modules:
            import_module("sumo_eval.record.children").cool_down()
        _refuse(str(error))
    except OSError as error:
        _stdout_to_nowhere()
        if error.errno == errno.EPIPE:
            sys.exit(NOT_READ)
        if error.errno == errno.ENOENT and not error.filename:  # of `os.getcwd`
            _refuse(NO_WORKING_FOLDER)
        place = f" ({clean(str(error.filename), 200)})" if error.filename else ""
        _refuse(f"{error.strerror or error}{place}. What was finished before is kept.")


def _nearest(name: str) -> str:
    """Last sentence of an error: offers the command that has the name among its words in `MEANT`,
    else the command with the most similar name.
    """
    word = name.lower()
    for command, words in MEANT.items():
        if word in words.split():
            return f" Did you mean `{command}`?"
    return did_you_mean(word, commands())


def commands() -> list[str]:
    """The names of all installed commands: those of this package in the order of the help, then
    those of other packages.
    """
    installed = {*_FILE_OF, *_plugins()}
    own = [name for names in TASKS.values() for name in names if name in installed]
    return [*own, *sorted(installed - set(own))]


@cache
def _plugins() -> dict[str, EntryPoint]:
    """Entry points of commands, by name: the first of each name, and none with the name of a
    command in `_CORE`.
    """
    plugins: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        if point.name not in _FILE_OF:
            plugins.setdefault(point.name, point)
    return plugins


def _loaded(point: EntryPoint) -> click.Command:
    """The command of an entry point. Raises InputError if it cannot be loaded."""
    what = f"Command `{point.name}`, `{point.value}`,"
    with users_code(f"{what} cannot be loaded"):
        command = point.load()
    if not isinstance(command, click.Command):
        raise InputError(f"{what} must be a click command, got {type(command).__name__}.")
    with users_code(f"{what} must have a text as its help"):
        command.get_short_help_str()
    return command


def _read_utf8() -> None:
    """Restart Python in UTF-8 mode if it uses another encoding for names of files: some paths have
    characters that this encoding lacks.
    """
    if sys.getfilesystemencoding().lower() != "utf-8" and not sys.flags.utf8_mode:
        arguments = [sys.executable, "-X", "utf8", *sys.orig_argv[1:]]
        os.execve(sys.executable, arguments, {**os.environ, "PYTHONUTF8": "1"})  # noqa: S606


def _give_memory_back() -> None:
    """Return the memory of arrays of more than 2 MiB to the system when they are released.

    The GNU C library would keep released memory that lies between objects in use: 100 MB while a
    page of a million cases is written. Other C libraries have no such setting.
    """
    mmap_threshold = -3  # M_MMAP_THRESHOLD of malloc.h
    # Windows raises TypeError for CDLL(None)
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(mmap_threshold, 2 << 20)


def _refuse(sentence: str) -> NoReturn:
    """Print an error message and exit with the status of wrong input."""
    with suppress(OSError):  # stderr cannot be written: the exit status is all that is left
        tell(f"sumo-eval: {clean_log(sentence)}", err=True)
    sys.exit(INPUT_WRONG)


def _fill_closed_streams() -> None:
    """Replace standard streams that are closed (`>&-` in a shell) by the null device, for child
    processes too. Otherwise the next file that is opened would get the number of such a stream, and
    printed text would go into that file.
    """
    # each `open` takes the lowest free number, so first those of closed streams (0, 1, 2)
    while (number := os.open(os.devnull, os.O_RDWR)) < 3:
        os.set_inheritable(number, True)
    if sys.stdout and sys.stderr:
        os.close(number)
        return
    nowhere = os.fdopen(number, "w", encoding="utf-8")
    sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere


def _stdout_to_nowhere() -> None:
    """Redirect an unwritable stdout to the null device: Python flushes it at exit, which would
    fail.
    """
    with suppress(OSError, ValueError):  # stdout is closed, or has no file number
        try:
            sys.stdout.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            os.close(nowhere)


@click.group(
    cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.version_option(package_name="sumo_eval", message="%(version)s")
def main() -> None:
    """Score automated driving systems over the whole parameter space of logical scenarios, in
    simulation with SUMO.

    Exit status: 0 done, 1 a gate failed, 2 the input is wrong, 3 some cases could not be evaluated,
    130 stopped, 141 stdout was closed.
    """
