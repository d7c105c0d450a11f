"""README is true: its ADS runs, its evaluation file is accepted; so is the table of equations in
docs/formulas.md."""

import importlib
import re

import pytest
from loaded import ROOT

README = (ROOT / "README.md").read_text()


def equation_rows():
    page = (ROOT / "docs" / "formulas.md").read_text()
    table = page.split("## Where each equation is")[1].split("\n## ")[0]
    rows = re.findall(
        r"^\| (\d+(?:-\d+)?) \| (.*?) \| `(.*?)` \| `(.*?)` \| (.*?) \|$", table, flags=re.M
    )
    return [(row[0], row[1], row[2], row[3], row[4]) for row in rows]


def equations(text):
    first, _, last = text.partition("-")
    return set(range(int(first), int(last or first) + 1))


def test_every_equation_of_the_paper_has_a_row():
    assert set().union(*(equations(row[0]) for row in equation_rows())) == set(range(1, 19))


@pytest.mark.parametrize("row", equation_rows(), ids=lambda row: row[0])
def test_an_equation_is_where_the_table_says(row):
    number, _, function, test, twin = row
    module_name, _, name = function.rpartition(".")
    found = getattr(importlib.import_module(f"sumo_eval.method.{module_name}"), name)
    first_line = (found.__doc__ or "").strip().split("\n")[0]
    named = set().union(
        *(equations(hit) for hit in re.findall(r"Eqs?\. (\d+(?:-\d+)?)", first_line))
    )
    assert equations(number) <= named, f"{function} names {named}"
    source = (ROOT / "tests" / "method" / f"test_{module_name}.py").read_text()
    assert f"def {test}(" in source
    if twin != "by hand":
        module, _, name = twin.strip("`").partition(".")
        plain = (ROOT / "tests" / "twins" / f"{module}.py").read_text()
        assert f"def {name}(" in plain
        assert f"twins.{module} import" in source or f"twins import {module}" in source


def test_every_baseline_has_a_row():
    from sumo_eval.cosim.doors.controller import SHIPPED

    page = (ROOT / "docs" / "baselines.md").read_text()
    for name in SHIPPED:
        assert f"`{name}`" in page


def test_readme_is_short():
    assert len(README.split()) <= 900


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_picture_of_the_report_is_small(scheme):
    path = f"docs/pictures/report_{scheme}.png"
    assert path in README
    assert (ROOT / path).stat().st_size < 150_000


def test_first_program_is_one_file_on_every_page():
    program = (ROOT / "docs" / "examples" / "my_ads.py").read_text()
    assert len([line for line in program.splitlines() if line.strip()]) <= 10
    for page in ("README.md", "docs/index.md", "docs/tutorials/own_ads.md"):
        assert f"```python\n{program}```" in (ROOT / page).read_text(), page
