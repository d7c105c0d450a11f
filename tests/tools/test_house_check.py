"""tools/house_check.py: this project is clean, and each kind of fault is found in a small package that has it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "tools" / "house_check.py"


def check(root: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), "--root", str(root), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A package without a fault: a command that another module's function serves."""
    for folder in ("sumo_eval/room", "tools", "docs"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "pyproject.toml").write_text('[project.scripts]\nhouse = "sumo_eval.door:main"\n')
    (tmp_path / "sumo_eval" / "__init__.py").write_text('"""A package."""\n')
    (tmp_path / "sumo_eval" / "room" / "__init__.py").write_text('"""A room."""\n')
    (tmp_path / "sumo_eval" / "door.py").write_text(
        'from sumo_eval.room.inner import answer\n\n\ndef main() -> int:\n    """The way in."""\n    return answer()\n'
    )
    (tmp_path / "sumo_eval" / "room" / "inner.py").write_text(
        'def answer() -> int:\n    """What is asked for."""\n    return 42\n'
    )
    return tmp_path


@pytest.mark.campaign
def test_the_project_has_nothing_to_mend() -> None:
    done = check(ROOT)
    assert done.stdout == ""
    assert done.returncode == 0


def test_a_house_without_a_fault_is_clean_and_its_size_is_known(house: Path) -> None:
    done = check(house, "--facts")
    assert done.stdout == "11 lines in 4 files, 2 of them loose at the top\n"
    assert done.returncode == 0


def test_a_circle_counts_inside_a_room_and_where_one_side_imports_late(house: Path) -> None:
    inner = house / "sumo_eval" / "room" / "inner.py"
    inner.write_text(
        inner.read_text() + "\n\ndef late() -> int:\n    from sumo_eval.room import other\n\n    return other.n\n"
    )
    (house / "sumo_eval" / "room" / "other.py").write_text(
        "from sumo_eval.room.inner import late\n\nn = 1 if late else 0\n"
    )
    done = check(house)
    assert done.stdout == "circle: sumo_eval.room.inner sumo_eval.room.other\n"
    assert done.returncode == 1


def test_names_and_modules_that_nothing_uses_are_found_and_documentation_keeps_them(house: Path) -> None:
    (house / "sumo_eval" / "room" / "forgotten.py").write_text("LEFT = 1\n\n\nclass Lost:\n    pass\n")
    assert check(house).stdout.splitlines() == [
        "dead module: sumo_eval.room.forgotten",
        "dead: sumo_eval.room.forgotten.LEFT",
        "dead: sumo_eval.room.forgotten.Lost",
    ]
    (house / "docs" / "page.md").write_text("Prose about LEFT and Lost.\n\n`sumo_eval.room.forgotten.Lost`\n")
    assert check(house).stdout == "dead: sumo_eval.room.forgotten.LEFT\n"


@pytest.mark.parametrize("words", ["The same for many.", "As `answer`.", "Like the plain one."])
def test_a_docstring_that_leans_on_another_is_found(words: str, house: Path) -> None:
    inner = house / "sumo_eval" / "room" / "inner.py"
    inner.write_text(inner.read_text().replace("What is asked for.", words))
    assert check(house).stdout == "docstring: sumo_eval.room.inner.answer\n"
    inner.write_text(inner.read_text().replace(words, "The sameness of things."))
    assert check(house).returncode == 0


def test_an_allowance_needs_a_reason_and_a_finding_and_is_pruned_without_one(house: Path) -> None:
    (house / "sumo_eval" / "room" / "inner.py").write_text(
        "def answer():\n    return 42\n\n\ndef kept():\n    return 1\n"
    )
    allowances = house / "tools" / "house_allowances.toml"
    lines = ["[allowed]\n", '"dead: sumo_eval.room.inner.kept" = ""\n', '"dead: sumo_eval.gone" = "A reason."\n']
    allowances.write_text("".join(lines))
    assert check(house).stdout.splitlines() == [
        "allowance that nothing needs: dead: sumo_eval.gone",
        "allowance without a reason: dead: sumo_eval.room.inner.kept",
    ]
    allowances.write_text("".join(lines).replace('""', '"Users call it."'))
    done = check(house, "--prune")
    assert done.stdout == "1 allowances taken out.\n"
    assert done.returncode == 0
    assert allowances.read_text() == '[allowed]\n"dead: sumo_eval.room.inner.kept" = "Users call it."\n'
