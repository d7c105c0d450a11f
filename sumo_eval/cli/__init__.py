"""The command line.

A command's file is imported when the command is named; the list of all commands imports them all.
"""

from __future__ import annotations

import atexit
import ctypes
import errno
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final, NoReturn

import click

from sumo_eval.cli.exit_status import INPUT_WRONG, INTERRUPTED, NOT_READ
from sumo_eval.cli.sentences import WHOLE, tell
from sumo_eval.errors import InputError, StoppedError, SumoEvalError, did_you_mean, said
from sumo_eval.gone import refuse_command
from sumo_eval.text import clean, clean_log

_CORE: Final = {
    "run": ("run", "score", "merge", "verify"),
    "look": ("report", "explain", "find", "replay", "export"),
    "compare": ("compare", "nightly", "accept", "trend"),
    "whatif": ("whatif",),
    "space": ("scenarios", "partition", "sample"),
    "tools": ("check", "schema"),
}
"""The files of this folder, and the commands that each defines."""

_FILE_OF: Final = {name: file for file, names in _CORE.items() for name in names}

GROUP: Final = "sumo_eval.commands"
"""Entry points of packages that bring further commands: a name and a click command.

Our `extras` use them, too.
"""

TASKS: Final = {
    "Evaluate": ("run", "score", "merge", "verify"),
    "Look at a run": ("report", "explain", "whatif", "find", "replay", "plot", "export"),
    "Compare runs": ("compare", "nightly", "accept", "trend"),
    "Look into a space": ("scenarios", "partition", "sample", "boundary"),
    "Drive yourself": ("drive",),
    "From recordings to rates": ("learn", "campaign"),
    "People and open constants": ("humans", "calibrate", "sensitivity"),
    "Believe the tool": ("qualify",),
    "Write an ADS or a scenario": ("import", "check", "schema", "bench"),
}
"""Sections of the help and their commands, extras included; any other is under `FURTHER`."""

FURTHER: Final = "From other packages"

MEANT: Final = {
    "run": "evaluate simulate start execute go resume launch",
    "score": "rescore rank ranking recompute",
    "merge": "combine join gather shards",
    "verify": "reproduce repeat again rerun",
    "report": "html page show open result results",
    "explain": "why case ledger arithmetic",
    "whatif": "counterfactual lever margin avoid change",
    "find": "parameters nearest locate lookup",
    "replay": "watch view animate animation gui video play",
    "plot": "figure figures chart svg pdf png picture",
    "export": "evidence csv parquet table tables dump xosc sumocfg",
    "compare": "diff gate regression versus",
    "nightly": "night cron schedule ci",
    "accept": "approve pin baseline bless",
    "trend": "history nights",
    "scenarios": "list catalogue catalog ls",
    "partition": "zones zone split hazard",
    "sample": "points draw grid sobol",
    "boundary": "search edge limit frontier",
    "drive": "wheel simulator steer keyboard gamepad study participants",
    "campaign": "rate crashes kilometre km risk importance",
    "learn": "fit rates distribution",
    "humans": "people drivers recordings events exposure opinion population",
    "calibrate": "k5 k6 tune scale",
    "sensitivity": "k1 k2 constants vary",
    "qualify": "credible credibility believe selftest trustworthy",
    "import": "openscenario convert translate read",
    "check": "validate lint test contract",
    "schema": "json editor autocomplete",
    "bench": "benchmark speed performance profile",
}
"""Our commands, and words that users type for each."""


class _Group(click.Group):
    """Loads a command when it is named, offers the nearest name for a misspelt one, turns errors
    into sentences.
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
            if args[0] in MEANT:  # ours, whose entry point is not installed yet
                raise click.UsageError(
                    f"Command `{args[0]}` is not installed: run `pip install -e .` again."
                )
            raise click.UsageError(f"There is no command `{clean(args[0])}`.{_nearest(args[0])}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands by task, each in one line that is not cut."""
        further = tuple(name for name in commands() if name not in MEANT)
        for task, names in {**TASKS, FURTHER: further}.items():
            installed = [name for name in names if name in commands()]
            if installed:
                with formatter.section(task):
                    formatter.write_dl([(name, self._line(ctx, name)) for name in installed])

    def _line(self, ctx: click.Context, name: str) -> str:
        try:
            command = self.get_command(ctx, name)
        except InputError as error:  # of a package that is broken: the help of others still shows
            return str(error)
        assert command is not None
        return command.get_short_help_str(limit=WHOLE)

    def main(self, args: Any = None, *rest: Any, **named: Any) -> Any:
        if args is None:  # from a shell, not from a caller in Python
            _fill_closed_streams()
            _read_utf8()
        return super().main(args, *rest, **named)

    def invoke(self, ctx: click.Context) -> Any:
        _one_thread()
        _give_memory_back()
        # else Python searches all objects for garbage at exit, 0.2 s for nothing
        atexit.register(gc.freeze)
        with _told():
            return super().invoke(ctx)

    def make_context(self, *args: Any, **named: Any) -> click.Context:
        with _told():  # it prints `--help` and `--version`
            return super().make_context(*args, **named)


@contextmanager
def _told() -> Iterator[None]:
    """Errors as a sentence and an exit status."""
    try:
        yield
    except StoppedError as stop:
        tell(f"sumo-eval: {stop}", err=True)
        sys.exit(INTERRUPTED)
    except SumoEvalError as error:
        if "sumo_eval.record.children" in sys.modules:  # it would load for seconds
            import_module("sumo_eval.record.children").cool_down()
        _refuse(str(error))
    except OSError as error:
        _stdout_to_nowhere()  # else the interpreter would try to write there again when it ends
        if error.errno == errno.EPIPE:
            sys.exit(NOT_READ)
        place = f" ({clean(str(error.filename), 200)})" if error.filename else ""
        _refuse(f"{error.strerror or error}{place}. What was finished before is kept.")
    except KeyboardInterrupt:
        tell("Stopped by Ctrl-C.", err=True)
        sys.exit(INTERRUPTED)


def _nearest(name: str) -> str:
    """The command that was meant, by meaning first and by spelling second, as a closing
    half-sentence.
    """
    word = name.lower()
    for command, words in MEANT.items():
        if word in words.split():
            return f" Did you mean `{command}`?"
    return did_you_mean(word, commands())


def commands() -> list[str]:
    """The names of all commands, ours in the order of the help, then those of other packages."""
    known = {*_FILE_OF, *_plugins()}
    ours = [name for names in TASKS.values() for name in names if name in known]
    return [*ours, *sorted(known - set(ours))]


@cache
def _plugins() -> dict[str, EntryPoint]:
    """Commands that installed packages bring, by name: the first found of each, and none of a name
    of the core.
    """
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        if point.name not in _FILE_OF:
            found.setdefault(point.name, point)
    return found


def _loaded(point: EntryPoint) -> click.Command:
    what = f"Command `{point.name}`, `{point.value}`,"
    try:
        command = point.load()
    except Exception as error:  # of a package that is not ours
        raise InputError(f"{what} cannot be loaded: {said(error)}.") from error
    if not isinstance(command, click.Command):
        raise InputError(f"{what} must be a click command, got {type(command).__name__}.")
    return command


def _read_utf8() -> None:
    """Restart Python in UTF-8 mode where names of files are in another encoding, in which some
    paths could not be printed or stored.
    """
    if sys.getfilesystemencoding().lower() != "utf-8" and not sys.flags.utf8_mode:
        arguments = [sys.executable, "-X", "utf8", *sys.orig_argv[1:]]
        os.execve(sys.executable, arguments, {**os.environ, "PYTHONUTF8": "1"})  # noqa: S606


def _one_thread() -> None:
    """Limit linear algebra to one thread, before numpy is loaded. What the user has set stays.

    The matrices here are small: threads would only wait for each other, and their number would
    change sums by a bit.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _give_memory_back() -> None:
    """Return large arrays to the system when they are released.

    The GNU C library keeps what it has once given, in holes between smaller things: 100 MB of a
    page of a million cases. Other C libraries have no such setting.
    """
    mmap_threshold = -3  # M_MMAP_THRESHOLD of malloc.h
    # TypeError: Windows, where there is no CDLL(None)
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(mmap_threshold, 2 << 20)  # arrays of more than 2 MiB


def _refuse(sentence: str) -> NoReturn:
    with suppress(OSError):  # a full device behind stderr: the exit status is all that can be said
        tell(f"sumo-eval: {clean_log(sentence)}", err=True)
    sys.exit(INPUT_WRONG)


def _fill_closed_streams() -> None:
    """Put the null device in place of standard streams that are closed, as by `>&-`, for children
    as well: no file of a run takes their numbers.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) < 3:  # the lowest number that is free
        os.set_inheritable(number, True)
    nowhere = os.fdopen(number, "w", encoding="utf-8")
    sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere


def _stdout_to_nowhere() -> None:
    """Put the null device in place of a stdout that cannot be written, so that the interpreter's
    own flush at exit does not fail.
    """
    with suppress(OSError, ValueError):  # a stdout that is closed, or no file
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
