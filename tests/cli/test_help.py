"""`--help`: commands by task, an example for each that its own parser takes, the nearest command by
meaning."""

import io
import os
import shlex
import sys

import click
import pytest
from click.testing import CliRunner
from tables import rows_of

from sumo_eval.cli import MEANT, TASKS, commands, main
from sumo_eval.cli.sentences import broken, say

CONTEXT = click.Context(main, info_name="sumo-eval")


def all_commands():
    """Every command and subcommand with the words that call it."""
    found = []
    for name in commands():
        command = main.get_command(CONTEXT, name)
        assert command is not None
        found.append((name, command))
        if isinstance(command, click.Group):
            found += [(f"{name} {inner}", command.commands[inner]) for inner in command.commands]
    return found


@pytest.mark.parametrize(
    "name, command", all_commands(), ids=lambda value: value if isinstance(value, str) else ""
)
def test_every_command_has_an_example_that_its_own_parser_takes(name, command):
    shown = CliRunner().invoke(main, [*name.split(), "--help"])
    assert shown.exit_code == 0
    assert command.epilog.startswith("Example: sumo-eval ")
    assert " ".join(command.epilog.split()) in " ".join(shown.output.split())
    words = shlex.split(command.epilog.removeprefix("Example: sumo-eval ").partition(" > ")[0])
    called, words = words[: len(name.split())], words[len(name.split()) :]
    assert called == name.split()
    if isinstance(command, click.Group):
        command, words = command.commands[words[0]], words[1:]
    command.make_context(name, words, parent=CONTEXT)  # raises for an option that does not exist


def test_the_help_names_every_command_under_its_task_and_cuts_no_line():
    shown = CliRunner().invoke(main, ["--help"], terminal_width=80).output
    assert [line[:-1] for line in shown.splitlines() if line.rstrip(":") in TASKS] == list(TASKS)
    assert "..." not in shown.partition("Evaluate:")[2]
    for name in commands():
        assert f"\n  {name} " in shown


@pytest.mark.parametrize(
    "typed, meant",
    rows_of("""
evaluate | run
simulate | run
html | report
diff | compare
list | scenarios
validate | check
Benchmark | bench
runn | run
nigthly | nightly
"""),
)  # fmt: skip
def test_the_nearest_command_is_found_by_meaning_first(typed, meant):
    done = CliRunner().invoke(main, [typed])
    assert done.exit_code == 2
    assert f"Did you mean `{meant}`?" in done.output


def test_no_word_means_two_commands_and_none_is_a_command_itself():
    words = [word for line in MEANT.values() for word in line.split()]
    assert len(words) == len(set(words))
    assert not set(words) & set(commands())
    assert MEANT.keys() == set(commands())


def test_the_help_of_humans_cuts_no_line_either():
    shown = CliRunner().invoke(main, ["humans", "--help"], terminal_width=80).output
    assert "..." not in shown.partition("Commands:")[2]
    assert "\n  departure " in shown


def test_a_line_wider_than_the_terminal_continues_indented():
    line = (
        "  2. an_ads_with_a_long_name  57.2 (39.9..66.0)  -8.0 to another_one: not told apart, "
        "the place is shared"
    )
    parts = broken(line, 60).splitlines()
    assert len(parts) == 2
    assert all(len(part) <= 60 for part in parts)
    assert parts[1].startswith("      ")
    assert " ".join(line.split()) == " ".join(" ".join(parts).split())
    assert broken("  columns   stay", 60) == "  columns   stay"
    assert broken("x" * 70, 60).strip() == "x" * 70, "a path is not cut: it could not be copied"


@pytest.mark.parametrize("err", [False, True], ids=["stdout", "stderr"])
def test_sentences_break_on_a_terminal_and_nowhere_else(err, monkeypatch, capsys):
    line = "The next round is expected to move a part of the space: settled.\n  second"
    monkeypatch.setattr("shutil.get_terminal_size", lambda: os.terminal_size((40, 20)))
    monkeypatch.setattr("sys.stderr" if err else "sys.stdout", OnTerminal())
    say([line], err=err)
    shown = (sys.stderr if err else sys.stdout).getvalue()
    assert [len(part) <= 40 for part in shown.splitlines()] == [True] * 3
    monkeypatch.undo()
    capsys.readouterr()
    say([line], err=err)
    assert capsys.readouterr()[int(err)] == f"{line}\n"


class OnTerminal(io.StringIO):
    """A text that says it is a terminal."""

    def isatty(self):
        return True
