"""GLOSSARY.md has every symbol, reference/outputs.md every column and key of a score, and nothing
else."""

import dataclasses
import importlib
import re

import pytest
from loaded import ROOT

from sumo_eval import settings
from sumo_eval.cases import CaseResult
from sumo_eval.report.tables import cases_csv
from sumo_eval.results import Evaluation, ScenarioResult

PAGES = [(ROOT / page).read_text() for page in ("GLOSSARY.md", "docs/reference/outputs.md")]


def rows(section):
    """The cells of a section's table, without its head."""
    (page,) = [page for page in PAGES if f"\n## {section}\n" in page]
    table = page.split(f"\n## {section}\n")[1].split("\n## ")[0]
    lines = [line for line in table.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def names(section):
    return [name for row in rows(section) for name in re.findall(r"`(.*?)`", row[0])]


def symbols():
    return {symbol for row in rows("Symbols") for symbol in row[0].split(", ")}


def test_every_column_of_cases_csv_has_one_row_and_every_row_a_column(tmp_path):
    run = settings.EvaluationSettings(name="none", scenario=(), ads=())
    cases_csv(Evaluation("none", tmp_path, run, {}, (), (), ()), tmp_path / "cases.csv")
    written = (tmp_path / "cases.csv").read_text().strip().split(",")
    found = names("Columns of cases.csv")
    assert sorted(found) == sorted({*written, "values"})
    assert {field.name for field in dataclasses.fields(CaseResult)} <= set(found)


def test_every_key_of_a_score_has_one_row_and_every_row_a_key():
    fields = [field.name for field in dataclasses.fields(ScenarioResult)]
    assert sorted(names("Keys of a score in scores.json")) == sorted(fields)


def test_every_symbol_of_a_setting_and_of_the_readmes_equations_has_a_row():
    classes = [
        found
        for found in vars(settings).values()
        if isinstance(found, type) and dataclasses.is_dataclass(found)
    ]
    given = {
        settings.about(owner, field.name).symbol
        for owner in classes
        if issubclass(owner, settings.Checked)
        for field in dataclasses.fields(owner)
    }
    assert {"k1", "p_i", "Ug"} <= given
    page = (ROOT / "docs" / "formulas.md").read_text()
    table = page.split("## Where each equation is")[1].split("\n## ")[0]
    whats = re.findall(r"^\| \d[\d-]* \| (.*?) \|", table, flags=re.M)
    used = {word for what in whats for word in what.split() if re.fullmatch(r"[A-Z](_i)?|r", word)}
    assert {"C", "D_i", "r", "U"} <= used
    assert given - {""} <= symbols()
    assert used <= symbols()


def test_every_symbol_used_in_a_table_is_explained():
    shown = {
        row[2].partition(",")[0]
        for section in ("Columns of cases.csv", "Keys of a score in scores.json")
        for row in rows(section)
        if "," in row[2]
    }
    assert len(shown) > 20
    parts = {part for symbol in shown for part in symbol.split()} - {
        "THW",
        "DRAC",
        "PET",
        "x_i",
        "b",
        "f_n+",
    }
    assert parts <= symbols()


@pytest.mark.parametrize(
    "function",
    sorted({name for row in rows("Symbols") for name in re.findall(r"`(\w+\.\w+)`", row[3])} - {
        "method.anthropomorphic", "method.score", "scenario.exposure",
        "simulation.ideal_deceleration",
        "ZonePartition.most_dangerous",
    }),
)  # fmt: skip
def test_a_function_named_beside_a_symbol_exists(function):
    module, _, name = function.partition(".")
    assert callable(getattr(importlib.import_module(f"sumo_eval.method.{module}"), name))


def test_a_setting_named_beside_a_symbol_exists():
    run = settings.EvaluationSettings(name="none", scenario=(), ads=())
    entry = settings.ScenarioSettings("cut_in")
    named = {
        name
        for row in rows("Symbols")
        for name in re.findall(r"`((?:method|simulation|drivers|scenario)[.\w]+)`", row[3])
    }
    assert len(named) >= 8
    for name in named:
        found = entry if name.startswith("scenario.") else run
        for part in name.removeprefix("scenario.").split("."):
            assert hasattr(found, part), name
            found = getattr(found, part)
