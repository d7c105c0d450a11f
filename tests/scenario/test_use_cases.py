"""Use cases as Gherkin tables: rows are points, `Then` lines are requirements, and what is doubtful is refused."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from click.testing import CliRunner
from lxml import etree

from sumo_eval import evaluate
from sumo_eval.cli import main
from sumo_eval.errors import InputError
from sumo_eval.report.junit import run_suites, write_junit
from sumo_eval.report.tables import write_tables
from sumo_eval.report.terminal import closing_lines
from sumo_eval.scenario.catalogue import find
from sumo_eval.scenario.file import check_points
from sumo_eval.scenario.openscenario.collections import expanded
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.scenario.usecase.describe import described
from sumo_eval.scenario.usecase.logical import read_use_case
from sumo_eval.scenario.usecase.steps import SENTENCES
from sumo_eval.settings import ScenarioSettings

AUTOWARE = Path(__file__).parents[3] / "shared" / "data" / "catalogues" / "autoware"
needs_autoware = pytest.mark.skipif(not AUTOWARE.is_dir(), reason="the catalogue of use cases is not here")

FOLLOW = """# Feature: Keep the distance
## Scenario Outline: Slower car ahead
A description.
* Given Ego drives at <v>, centered on its lane
* And Npc0 drives on the same lane as Ego, 30 meters ahead of it
* And Npc0 drives slower than Ego, at a speed of <vn>
* When Ego gets close to Npc0
* Then Ego slows down
* And Ego reaches the goal position
* And Ego drives with no collisions at all times
* And Ego keeps its gap above 1 m
### Examples: slow
  | v       | vn      |
  | ------- | ------- |
  | 36 km/h | 18 km/h |
### Examples: quick
  | v       | vn      |
  | ------- | ------- |
  | 54 km/h | 18 km/h |
  | 36 km/h | 18 km/h |
"""
CUT_IN = """# Feature: Cut-in
## Scenario Outline: Faster car
* Given Ego is driving at <vxi_ego>
* And Npc0 is in a neighbor lane behind Ego, driving at <vxi_npc0>
* When Npc0 overtakes Ego with <vxi_npc0> which is greater than <vxi_ego>
* And Npc0 performs a lane change to cut in front of Ego at a distance of <d_lc_npc0> from Ego
* And Npc0 decelerates to <slow> with acceleration -1 m/s^2
* Then Ego reaches the destination without collision
* And Ego does not decelerate at a rate below -2 m/s^2 after Npc0 changed lane
* And Ego velocity does not fall below 80% of <slow> after Npc0 slows down
### Examples
| vxi_npc0 | vxi_ego | d_lc_npc0 | slow | w |
| -------- | ------- | --------- | ---- | --- |
| 20 km/h  | 15 km/h | 1.0 m     | 10 km/h | 3.0 m |
| 30 km/h  | 15 km/h | 1.0 m     | 10 km/h | 3.0 m |
"""


def written(folder: Path, text: str, name: str = "UC-X-1.feature.md") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_rows_are_points_and_columns_that_vary_are_the_space(tmp_path: Path) -> None:
    """36 km/h is 10 m/s. The third row is the first one again, which is said and driven once."""
    read = read_use_case(written(tmp_path, FOLLOW))
    logical = read.logical
    assert logical.name == "uc_x_1"
    assert [(item.name, item.unit, item.values) for item in logical.parameters] == [("v", "km/h", (36.0, 54.0))]
    assert sample(logical).points.tolist() == [[36.0], [54.0]]
    assert read.rows == (1, 2, 1)
    assert logical.notes == ("Rows that are alike are driven once: row 3 is row 1 again.",)
    there = logical.concrete(v=36.0)
    assert (there.ego.speed, there.actors[0].start.speed) == (10.0, 5.0)
    assert there.actors[0].start.x - there.ego.x == 30.0 + 4.5  # bumper to bumper, two cars of 4.5 m
    check_points(logical, sample(logical).points)
    assert any("check `Ego keeps its gap above 1 m`: min(gap) >= 1" in line for line in described(read))


def test_the_scenario_file_that_it_is_can_be_written(tmp_path: Path) -> None:
    path = written(tmp_path, FOLLOW)
    done = CliRunner().invoke(main, ["import", str(path), "--out", str(tmp_path / "same.toml")])
    assert done.exit_code == 0, done.output
    same, own = find("same.toml", tmp_path), find(str(path))
    assert (same.name, same.parameters, same.samples, same.requirements) == (
        own.name, own.parameters, own.samples, own.requirements
    )  # fmt: skip
    assert same.concrete(v=54.0) == own.concrete(v=54.0)


def test_plain_gherkin_reads_as_its_markdown_does(tmp_path: Path) -> None:
    plain = "\n".join(line.lstrip("#* ") for line in FOLLOW.splitlines() if line != "A description.")
    assert (
        find(str(written(tmp_path, plain, "UC-X-1.feature"))).parameters
        == find(str(written(tmp_path, FOLLOW))).parameters
    )


def test_a_cut_in_begins_at_its_distance_and_slows_down_when_it_is_over(tmp_path: Path) -> None:
    path = written(tmp_path, CUT_IN)
    with pytest.raises(InputError, match=r"line 4: no step and no column says how far Npc0 is .*distance_npc0=35"):
        find(str(path))
    logical = find(f"{path}?distance_npc0=10")
    check_points(logical, sample(logical).points)
    npc = logical.concrete(vxi_npc0=20.0).actors[0]
    assert npc.start.y == 3.0  # a lane of 3 m
    assert [act.name for act in npc.acts] == ["act0", "act1"]
    assert npc.acts[0].offset == -3.0
    assert logical.requirements is not None
    checks = [one.text for one in logical.requirements.all]
    assert checks[1] == "min(where(abs(y(Npc0)) < 0.1, acceleration, 0)) >= -2.0 - 1e-06"
    assert checks[2] == "min(where(speed(Npc0) <= slow_si + 0.01, speed, 1000)) >= 0.8 * slow_si - 1e-06"


def test_rows_pass_and_fail_in_a_table_and_in_junit(tmp_path: Path) -> None:
    """A car that does nothing at 36 km/h is 30 m / (10 - 5) m/s = 6 s from contact, so no row of it passes."""
    path = written(tmp_path, FOLLOW)
    result = evaluate(
        {"name": "n", "scenario": [{"use": str(path)}], "drivers": {"count": 2}, "run": {"case_timeout": 600.0},
         "ads": [{"name": "nothing", "controller": "no_reaction"}, {"name": "idm", "controller": "idm"}]},
        tmp_path / "run", workers=1,
    )  # fmt: skip
    write_tables(result)
    with (tmp_path / "run" / "checks.csv").open(encoding="utf-8") as file:
        rows = {(row["ads"], row["point"], row["check"]): row["verdict"] for row in csv.DictReader(file)}
    assert len(rows) == 2 * 2 * 4
    assert rows["nothing", "v=36", "Ego slows down"] == "failed"
    assert rows["nothing", "v=36", "Ego drives with no collisions at all times"] == "failed"
    assert {verdict for (ads, _, _), verdict in rows.items() if ads == "idm"} == {"passed"}
    lines = closing_lines(result)
    assert "2 of 4 cases pass all checks of their scenarios:" in lines
    assert "  passed  idm in uc_x_1, v=54" in lines
    junit = etree.parse(write_junit(run_suites(result), tmp_path / "junit.xml")).getroot()
    assert (junit.get("tests"), junit.get("failures")) == ("4", "2")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("| v       | vn      |", "| v       | v      |", r"line 13: the header of the table `slow` is doubtful: "
         r"column `v` stands in it 2 times"),
        ("at a speed of <vn>", "at a speed of <vm>", r"`<vm>` of step .* has no column in it"),
        ("| v       | vn      |", "| v  | vn | d_dec |", r"The row in line 15 of .* must be 3 cells"),
        ("Examples: quick\n  | v       | vn", "Examples: quick\n  | vn       | v", r"must be that of the first"),
        ("| 36 km/h | 18 km/h |\n### ", "| 36 | 18 km/h |\n### ", r"must be a number with a unit, .* got '?`?36"),
        ("| 36 km/h | 18 km/h |\n### ", "| 36 mph | 18 km/h |\n### ", r"unit of column `v` .* must be one of km/h"),
        ("| 36 km/h | 18 km/h |\n### ", "| 36 m/s | 18 km/h |\n### ", r"unit of column `v` .* must be one throughout"),
        ("30 meters", "30 s", r"`30 s` of step .* must be in m, got '?s"),
        ("* Then Ego slows down", "* Then Ego behaves well", r"line 8: step `Then Ego behaves well` is not understood"),
        ("* When Ego gets close to Npc0", "* When Ego gets close to Npc1", r"names Npc1, of whom no step before it"),
        ("* Then Ego slows down", "* When Npc0 starts decelerating to <vn> with a rate of -1 m/s^2",
         r"line 8: when Npc0 begins cannot be known: `Ego gets close to Npc0` has no number"),
        ("* Given Ego drives at <v>, centered on its lane", "* Given Ego is in standstill", r"line 4: .* standstill"),
        ("## Scenario Outline: Slower car ahead", "", r"scenario outlines of .* must be one, got 0"),
        ("* Given Ego drives", "* And Ego drives", r"line 4: `And` must follow Given, When or Then"),
    ],
)  # fmt: skip
def test_what_is_doubtful_is_refused_by_name(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in FOLLOW
    with pytest.raises(InputError, match=sentence):
        find(str(written(tmp_path, FOLLOW.replace(old, new, 1))))


def test_a_column_that_no_step_uses_is_refused(tmp_path: Path) -> None:
    text = CUT_IN.replace("| w |", "| d_dec |")
    with pytest.raises(InputError, match=r"no step uses column `d_dec`"):
        find(f"{written(tmp_path, text)}?distance_npc0=10")


@pytest.mark.parametrize(
    ("option", "sentence"),
    [("gaol=100", "Did you mean `goal`"), ("goal=-1", "must be a number above 0"), ("goal=x", "must be a number above"),
     ("distance_npc0=10", "a step has said how far Npc0 is")],
)  # fmt: skip
def test_a_wrong_option_is_refused(tmp_path: Path, option: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        find(f"{written(tmp_path, FOLLOW)}?{option}")


def test_a_file_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"Use case .*none.feature.md cannot be read"):
        find("none.feature.md", tmp_path)


def test_every_sentence_is_a_pattern_that_matches_itself() -> None:
    """Its own words with 30 m for a value and Npc0 for somebody; what may be left out left in."""
    import re

    for sentence in SENTENCES:
        words = re.sub(r"<<(\w[^|<>]*)\|[^>]*>>", r"\1", sentence.shown).replace("[", "").replace("]", "")
        words = re.sub(r"VALUE\d?", "30 m", words).replace("PERCENT", "80%")
        words = re.sub(r"NPC\d?", "Npc0", words)
        assert re.fullmatch(sentence.pattern, words, re.IGNORECASE), words


@needs_autoware
def test_the_public_use_cases_play_or_are_refused_with_a_reason() -> None:
    """Of 18 files three say all that a drive needs. Three have a column twice; in six the ego begins in standstill."""
    (first, *rest) = expanded((ScenarioSettings("autoware", folder=str(AUTOWARE)),), Path())
    names = [Path(entry.use).name.removesuffix(".feature.md") for entry in (first, *rest)]
    assert names == ["UC-ACC-001-0001", "UC-AEB-001-0001", "UC-NTR-002-0001"]
    refused = first.not_played
    assert len(refused) == 15
    twice = [name for name, why in refused.items() if "is doubtful: column" in why]
    assert twice == [f"UC-NTR-001-000{number}.feature.md" for number in (7, 8, 9)]
    assert sum("Ego is in standstill" in why for why in refused.values()) == 6
    for entry in (first, *rest):
        logical = find(entry.use)
        check_points(logical, sample(logical).points)
