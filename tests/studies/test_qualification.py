"""`sumo-eval qualify`: known answers are found again, and a wrong one is not."""

from itertools import chain, groupby

from commands import sumo_eval
from laid import read_json

from sumo_eval.errors import SimulationError
from sumo_eval.extras.studies.qualification import table
from sumo_eval.extras.studies.qualification.qualified import carry_out
from sumo_eval.extras.studies.qualification.table import Check

FIRST = [next(group) for _, group in groupby(table.all_checks(), key=lambda check: check.kind)]


def test_one_check_of_each_kind_passes_and_a_planted_wrong_expectation_fails(tmp_path, monkeypatch):
    planted = FIRST[0]._replace(name="planted", expected=float(FIRST[0].expected) + 0.2)
    monkeypatch.setattr(table, "all_checks", lambda: chain(FIRST, [planted]))
    done = sumo_eval(f"qualify --out {tmp_path}/q", status=1)
    assert max(map(len, done.stdout.partition("FAIL  planted")[0].splitlines())) <= 80
    assert "8 of 9 checks passed: this installation is NOT qualified." in done.said
    told = read_json(tmp_path / "q" / "qualification.json")
    assert [item["name"] for item in told["checks"] if not item["passed"]] == ["planted"]
    assert told["passed"] is False
    assert told.keys() == {
        "format_version", "created", "purpose", "domain", "limits", "passed", "versions",
        "machine", "checks",
    }  # fmt: skip
    assert told["checks"][0].keys() == {
        "kind", "name", "source", "expected", "found", "bound", "unit", "passed", "error",
    }  # fmt: skip
    assert {"sumo_eval", "libsumo"} <= told["versions"].keys()
    assert "1 of 9 checks failed" in (tmp_path / "q" / "qualification.html").read_text()


def test_the_command_exits_with_0_when_all_pass(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "all_checks", lambda: iter(FIRST[1:2]))
    sumo_eval(f"qualify --out {tmp_path}")


def test_a_fault_of_the_tool_is_a_check_that_failed_with_its_sentence():
    def fails():
        raise SimulationError("SUMO is gone")

    found = carry_out(Check("kind", "name", fails, (), 1.0, "source", 1.0))
    assert (found.passed, found.found, found.error) == (False, None, "SUMO is gone")


def test_every_name_fits_the_table_and_stands_once():
    names = [check.name for check in table.all_checks()]
    assert max(map(len, names)) <= 40
    assert len(names) == len(set(names))
