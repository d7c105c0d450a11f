"""`sumo-eval drive` given what it cannot use: one sentence, exit status 2."""

import sys

import pytest
from commands import sumo_eval
from tables import rows_of


@pytest.mark.parametrize(
    "arguments, words",
    rows_of(
        """
nowhere_at_all | nowhere_at_all
cut_in --rate 30 | one of 20, 50, 100 Hz, got 30
cut_in --set gap | NAME=VALUE with a number
cut_in --set =5 | NAME=VALUE with a number
cut_in --set gap=3 --set gap=4 | must be given once, got `gap` twice
cut_in --set gapp=3 | Did you mean `gap`
cut_in --set gap=1e9 | gap
nothing.jsonl | There is no tape nothing.jsonl
nothing.toml | nothing.toml
""",
        str.split,
    ),
)
def test_what_it_cannot_use_gets_a_sentence(arguments, words):
    assert words in sumo_eval("drive", *arguments, "--no-browser", "--port", "0", status=2).said


def test_without_websockets_a_sentence_names_the_extra(monkeypatch, tmp_path):
    for name in list(sys.modules):
        if name.partition(".")[0] == "websockets" or name == "sumo_eval.extras.wheel.window":
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "websockets", None)
    done = sumo_eval("drive", "cut_in", "--no-browser", "--port", "0", "--out", tmp_path, status=2)
    assert "needs the extra `drive`" in done.said
