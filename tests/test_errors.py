"""One error family, one sentence shape."""

import difflib
import importlib.metadata
import random
import shlex
import sys
from types import SimpleNamespace

import pytest
from tables import values_of

from sumo_eval.errors import (
    ControllerError,
    ControllerTimeoutError,
    InputError,
    SimulationError,
    SumoEvalError,
    did_you_mean,
    must_be,
    nearest,
    needs_extra,
    said,
    unknown,
)


def test_the_family():
    for kind in (InputError, ControllerError, ControllerTimeoutError, SimulationError):
        assert issubclass(kind, SumoEvalError)
    assert issubclass(InputError, ValueError)  # so that plain Python code may catch what it expects
    assert issubclass(ControllerTimeoutError, ControllerError)


def test_must_be_says_what_of_which_object_must_be_what_and_what_it_got():
    error = must_be("`gap`", "scenario `front_vehicle_cut_out`", "within 20..120 m", 150)
    assert isinstance(error, InputError)
    assert (
        str(error) == "`gap` of scenario `front_vehicle_cut_out` must be within 20..120 m, got 150."
    )


def test_a_text_is_quoted_so_that_it_is_not_read_as_a_number():
    assert str(must_be("`step`", "the simulation", "a number", "0.1")).endswith(
        "must be a number, got '0.1'."
    )


@pytest.mark.parametrize(
    "kind, sentence",
    [
        (
            "parameter of scenario `cut_in`",
            "Unknown parameter `gpa` of scenario `cut_in`. Did you mean `gap`?",
        ),
        (
            "name in `gpa + 1` of road of x:",
            "Unknown name `gpa` in `gpa + 1` of road of x. Did you mean `gap`?",
        ),
    ],
)
def test_of_what_a_name_is_unknown_stands_behind_the_name(kind, sentence):
    assert str(unknown(kind, "gpa", ["gap"])) == sentence


@pytest.mark.parametrize(
    "name, known, sentence",
    [
        *values_of("""
    "idn", ["idm", "lane_changer"], "Unknown ADS `idn`. Did you mean `idm`?"
    "zzz", ["idm", "lane_changer"], "Unknown ADS `zzz`. Known: idm, lane_changer."
    "zzz", [], "Unknown ADS `zzz`."
    """),
        (
            "lane_changr",
            iter(["idm", "lane_changer"]),
            "Unknown ADS `lane_changr`. Did you mean `lane_changer`?",
        ),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest_or_with_all(name, known, sentence):
    assert str(unknown("ADS", name, known)) == sentence


def test_a_list_of_known_names_ends_after_a_few():
    said = did_you_mean("nothere", [f"cut_in-{number:04d}-idm" for number in range(1000)])
    # A name takes 15 characters and 2 between: after 47 of them 47 * 17 - 2 = 797 of the 800 are
    # full.
    assert said.endswith("cut_in-0046-idm and 953 more.")
    assert did_you_mean("nothere", ["a, b"] * 1000).endswith("a, b and 867 more.")  # 800 / 6 fit
    long = did_you_mean("nothere", ["x" * 900, *"abc", "y" * 900])
    assert long.endswith(f"{'x' * 300}, a, b, c, {'y' * 300}.")


def test_law_the_nearest_name_is_that_of_difflib_among_however_many():
    draw = random.Random(5)
    for _ in range(300):
        known = [
            "".join(draw.choices("abc-01", k=draw.randint(1, 9)))
            for _ in range(draw.randint(0, 30))
        ]
        name = "".join(draw.choices("abc-01", k=draw.randint(1, 9)))
        assert nearest(name, known) == next(
            iter(difflib.get_close_matches(name, known, n=1, cutoff=0.55)), None
        )


def test_did_you_mean_offers_one_name_only():
    assert did_you_mean("gap_", ["gap", "gaps"]).count("`") == 2


@pytest.mark.parametrize(
    "error, words",
    [
        (ValueError("no such lane"), "ValueError: no such lane"),
        # the sentence around it sets the full stop
        (ValueError("It ended. "), "ValueError: It ended"),
        (SystemExit(), "SystemExit"),
        (SystemExit(3), "SystemExit: 3"),
        (KeyError("x"), "KeyError: 'x'"),
    ],
)
def test_an_exception_in_words(error, words):
    assert said(error) == words


def test_a_missing_extra_is_named_with_the_command_that_installs_it_from_where_the_package_came(
    monkeypatch,
):
    origins = {
        '{"url": "file:///home/me/sumo%20eval", "dir_info": {"editable": '
        "true}}": "-e '/home/me/sumo eval[fmu]'",
        '{"url": "file:///srv/sumo_eval", "dir_info": {}}': "'/srv/sumo_eval[fmu]'",
        '{"url": "https://host/s-1.whl", "archive_info": '
        "{}}": "'sumo_eval[fmu] @ https://host/s-1.whl'",
        '{"url": "https://host/s.git", "vcs_info": {"vcs": "git", "commit_id": '
        '"1a2b"}}': "'sumo_eval[fmu] @ git+https://host/s.git@1a2b'",
        '{"url": "https://host/s.zip", "archive_info": {}, "subdirectory": '
        '"python"}': "'sumo_eval[fmu] @ https://host/s.zip#subdirectory=python'",
        None: "'sumo_eval[fmu]'",
    }
    for origin, words in origins.items():
        there = SimpleNamespace(read_text=lambda name, text=origin: text)
        monkeypatch.setattr(importlib.metadata, "distribution", lambda name, there=there: there)
        assert str(needs_extra("An FMU", "fmu")) == (
            f"An FMU needs the extra `fmu`, which this installs: {shlex.quote(sys.executable)} -m "
            f"pip install {words}"
        )
