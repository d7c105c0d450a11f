"""tools/nightly.sh: it passes arguments and the exit status on, keeps a log, and is silent after a
good night."""

import os

import pytest
from commands import program
from loaded import ROOT

SCRIPT = ROOT / "tools" / "nightly.sh"


def night(tmp_path, *arguments, status=0):
    """The script with a program in place of sumo-eval that says what it was asked for."""
    stand_in = tmp_path / "sumo-eval"
    stand_in.write_text(f'#!/bin/sh\necho "asked: $*"\nexit {status}\n')
    stand_in.chmod(0o755)
    environment = {**os.environ, "SUMO_EVAL": str(stand_in)}
    return program(SCRIPT, *arguments, status=status if arguments else 2, env=environment)


@pytest.mark.parametrize("status", [0, 1, 2, 3])
def test_the_status_is_passed_on_and_only_a_good_night_is_silent(status, tmp_path):
    history = tmp_path / "my nights"
    done = night(tmp_path, "a b.toml", str(history), "--gate", "g.toml", status=status)
    said = f"asked: nightly a b.toml --history {history} --gate g.toml\n"
    (log,) = (history / "logs").iterdir()
    assert log.read_text() == said
    assert done.stdout == ""
    assert done.stderr.startswith(said) if status else done.stderr == ""


def test_without_arguments_it_says_how_it_is_used(tmp_path):
    done = night(tmp_path)
    assert "usage:" in done.stderr
