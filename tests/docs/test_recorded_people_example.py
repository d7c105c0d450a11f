"""The worked example of recorded people, as the tutorial has it, on a recording that anybody can
have."""

import runpy
import sys

import pytest
from commands import program, sumo_eval
from doc_blocks import ROOT, blocks
from laid import read_json

SAMPLE = runpy.run_path(str(ROOT / "docs" / "examples" / "dlr_sample.py"))
PAGE = "docs/tutorials/recorded_drivers.md"


@pytest.mark.campaign
@pytest.mark.skipif(
    SAMPLE["archive"]() is None,
    reason="the wheel tasi is not installed: pip install --no-deps tasi",
)
def test_the_tutorials_example_runs_from_the_public_recording_to_the_count_of_people(
    tmp_path, monkeypatch
):
    commands = [words for block in blocks(PAGE) for words in block.commands()]
    evaluation = next(block.text for block in blocks(PAGE) if "motorway_approach" in block.text)
    monkeypatch.chdir(tmp_path)
    SAMPLE["write_sample"](tmp_path / "recordings", 45)
    (tmp_path / "people.toml").write_text(evaluation)
    example = [words for words in commands if "dlr_highway" in words or "people.toml" in words]
    assert [words[0] for words in example] == ["humans", "run"]
    for words in example:
        given = [*words, "--engine", "serial"] if words[0] == "run" else words
        # 3: concrete scenarios with fewer than three people get no D_i, as the page says
        sumo_eval(*given, status=3 if words[0] == "run" else 0)
    (told,) = read_json(tmp_path / "results" / "people" / "scores.json")["recorded_people"]
    assert told["points"] == 14
    assert told["with_people"] == 3
    assert told["drives"] >= 3 * 3


@pytest.mark.parametrize("given", [[], ["recordings"], ["recordings", "all"]])
def test_the_sample_says_what_to_name(given):
    sample = ROOT / "docs" / "examples" / "dlr_sample.py"
    told = program(sys.executable, sample, *given, status=1)
    assert told.stderr.startswith("Name the folder to write to and how many seconds")
