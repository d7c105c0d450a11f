"""The command line. A command's file is imported when the command is named, so that `--help` answers at once."""

from __future__ import annotations

import atexit
import errno
import gc
import os
import sys
from contextlib import suppress
from importlib import import_module
from typing import Any, Final, NoReturn

import click

from sumo_eval.cli.exit_status import INPUT_WRONG, INTERRUPTED
from sumo_eval.errors import StoppedError, SumoEvalError, did_you_mean
from sumo_eval.text import clean, clean_log

COMMANDS: Final = (
    "run",
    "score",
    "report",
    "compare",
    "nightly",
    "trend",
    "replay",
    "explain",
    "humans",
    "calibrate",
    "sensitivity",
    "verify",
    "merge",
    "export",
    "scenarios",
    "partition",
    "sample",
    "boundary",
    "check",
    "schema",
    "bench",
)  # sumo_eval/cli/NAME.py defines NAME


class _Group(click.Group):
    """Loads a command when it is named, offers the nearest name for a misspelt one, turns errors into sentences."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command = getattr(import_module(f"sumo_eval.cli.{cmd_name}"), cmd_name)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and not args[0].startswith("-") and args[0] not in COMMANDS:
            raise click.UsageError(f"There is no command `{args[0]}`.{did_you_mean(args[0], self.list_commands(ctx))}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        _one_thread()
        atexit.register(gc.freeze)  # else Python looks through all that was imported before it lets go of it, for 0.2 s
        try:
            return super().invoke(ctx)
        except StoppedError as stop:
            click.echo(f"sumo-eval: {stop}", err=True)
            sys.exit(INTERRUPTED)
        except SumoEvalError as error:
            _refuse(str(error))
        except OSError as error:
            if error.errno == errno.EPIPE:  # who reads has read enough; click knows how to leave
                raise
            _stdout_to_nowhere()  # else the interpreter would try to write there again when it ends
            place = f" ({clean(str(error.filename), 200)})" if error.filename else ""
            _refuse(f"{error.strerror or error}{place}. What was finished before is kept.")
        except KeyboardInterrupt:
            click.echo("Stopped by Ctrl-C.", err=True)
            sys.exit(INTERRUPTED)


def _one_thread() -> None:
    """Of linear algebra, before it is loaded: the matrices here are small, threads would only wait for each other, and
    their number would change sums by a bit. What the user has set stays.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _refuse(sentence: str) -> NoReturn:
    with suppress(OSError):  # a full device behind stderr: the exit status is all that can be said
        click.echo(f"sumo-eval: {clean_log(sentence)}", err=True)
    sys.exit(INPUT_WRONG)


def _stdout_to_nowhere() -> None:
    with suppress(OSError, ValueError):  # a stdout that is closed, or no file
        try:
            sys.stdout.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            os.close(nowhere)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="sumo_eval", message="%(version)s")
def main() -> None:
    """Score automated driving systems over the whole parameter space of logical scenarios, in simulation with SUMO.

    Exit status: 0 done, 1 a gate failed, 2 the input is wrong, 3 some cases could not be evaluated.
    """
