"""tools/house_check.py: this project is clean, and each kind of fault is found in a small package
that has it."""

import ast
import io
import os
import re
import subprocess
from contextlib import redirect_stdout
from itertools import dropwhile
from typing import NamedTuple

import pytest
from laid import lay, replace_in
from loaded import ROOT, load

HOUSE_CHECK = load("tools/house_check.py")


class Done(NamedTuple):
    """Exit status and output of a check."""

    returncode: int
    stdout: str


def check(root, *options):
    with redirect_stdout(io.StringIO()) as output:
        status = HOUSE_CHECK.main(["--root", str(root), *options])
    return Done(status, output.getvalue())


@pytest.fixture
def house(tmp_path):
    """A package without a fault: a command that another module's function serves."""
    for folder in ("tools", "docs"):
        (tmp_path / folder).mkdir()
    files = {
        "pyproject.toml": '[project.scripts]\nhouse = "sumo_eval.door:main"\n',
        "sumo_eval/__init__.py": '"""A package."""\n',
        "sumo_eval/room/__init__.py": '"""A room."""\n',
        "sumo_eval/door.py": "from sumo_eval.room.inner import answer\n\n\ndef main() -> int:\n    "
        '"""The way in."""\n    return answer()\n',
        "sumo_eval/room/inner.py": 'def answer() -> int:\n    """What is asked for."""\n    '
        "return 42\n",
    }
    lay(tmp_path, files)
    return tmp_path


def test_a_house_without_a_fault_is_clean_and_its_size_is_known(house):
    done = check(house, "--facts")
    assert done.stdout == "11 lines in 4 files, 2 of them loose at the top\n"
    assert done.returncode == 0


def test_a_circle_counts_inside_a_room_and_where_one_side_imports_late(house):
    inner = house / "sumo_eval" / "room" / "inner.py"
    inner.write_text(
        inner.read_text()
        + "\n\ndef late() -> int:\n    from sumo_eval.room import other\n\n    return other.n\n"
    )
    (house / "sumo_eval" / "room" / "other.py").write_text(
        "from sumo_eval.room.inner import late\n\nn = 1 if late else 0\n"
    )
    done = check(house)
    assert done.stdout == "circle: sumo_eval.room.inner sumo_eval.room.other\n"
    assert done.returncode == 1


def test_names_and_modules_that_nothing_uses_are_found_and_documentation_keeps_them(house):
    (house / "sumo_eval" / "room" / "forgotten.py").write_text(
        "LEFT = 1\n\n\nclass Lost:\n    pass\n"
    )
    assert check(house).stdout.splitlines() == [
        "dead module: sumo_eval.room.forgotten",
        "dead: sumo_eval.room.forgotten.LEFT",
        "dead: sumo_eval.room.forgotten.Lost",
    ]
    (house / "docs" / "page.md").write_text(
        "Prose about LEFT and Lost.\n\n`sumo_eval.room.forgotten.Lost`\n"
    )
    assert check(house).stdout == "dead: sumo_eval.room.forgotten.LEFT\n"


@pytest.mark.parametrize("words", ["The same for many.", "As `answer`.", "Like the plain one."])
def test_a_docstring_that_leans_on_another_is_found(words, house):
    inner = house / "sumo_eval" / "room" / "inner.py"
    replace_in(inner, "What is asked for.", words)
    assert check(house).stdout == "docstring: sumo_eval.room.inner.answer\n"
    replace_in(inner, words, "The sameness of things.")
    assert check(house).returncode == 0


@pytest.mark.parametrize("users, found", [("`other`", True), ("`door.py`", False)])
def test_a_docstring_of_a_file_names_its_users(users, found, house):
    inner = house / "sumo_eval" / "room" / "inner.py"
    inner.write_text(f'"""An answer. Users: {users}."""\n\n{inner.read_text()}')
    finding = "user not named in a docstring: sumo_eval.room.inner: door.py\n"
    assert check(house).stdout == finding * found


def test_an_allowance_needs_a_reason_and_a_finding(house):
    (house / "sumo_eval" / "room" / "inner.py").write_text(
        "def answer():\n    return 42\n\n\ndef kept():\n    return 1\n"
    )
    allowances = house / "tools" / "house_allowances.toml"
    lines = [
        "[allowed]\n",
        '"dead: sumo_eval.room.inner.kept" = ""\n',
        '"dead: sumo_eval.gone" = "A reason."\n',
    ]
    allowances.write_text("".join(lines))
    assert check(house).stdout.splitlines() == [
        "allowance that nothing needs: dead: sumo_eval.gone",
        "allowance without a reason: dead: sumo_eval.room.inner.kept",
    ]
    allowances.write_text(lines[0] + lines[1].replace('""', '"Users call it."'))
    assert check(house).returncode == 0


WORDS = """
since = "2026-01-01T00:00:00Z"
page = 10
[pages]
"docs/long.md" = 20
[most]
words = 35
"English of pages" = 1
"English of the package" = 0
"long lines" = 0
"long test names" = 0
"lines over 100 characters" = 0
"functions over 7 parameters" = 0
"assignments over 3 targets" = 0
"functions over 150 tokens" = 0
[patterns]
'\\bnobody\\b' = "name it"
'^Who' = "noun phrase"
[allowed]
"nobody in particular" = "a name"
"""


@pytest.fixture
def worded(house):
    """A house whose words have limits."""
    (house / "tools" / "house_words.toml").write_text(WORDS)
    (house / "mkdocs.yml").write_text("nav: [page.md, long.md]\n")
    (house / "tests").mkdir()
    (house / "docs" / "page.md").write_text(
        "There is nobody, nor nobody in particular, nor `nobody`.\n"
    )
    (house / "docs" / "long.md").write_text("word " * 20)
    return house


def test_words_within_their_limits_are_clean_and_listed(worded):
    assert check(worded).returncode == 0
    assert check(worded, "--words").stdout == "English of pages: docs/page.md: nobody\n"


@pytest.mark.parametrize(
    "file, text, finding",
    [
        ("docs/page.md", "word " * 11, "words: docs/page.md must have at most 10, has 11"),
        ("docs/other.md", "A page.\n", "menu: docs/other.md is not in mkdocs.yml"),
        (
            "docs/page.md",
            "nobody\nWho\n",
            "English of pages: must be at most 1, are 2 (--words lists them)",
        ),
        ("docs/page.md", "x" * 161, "long lines: must be at most 0, are 1 (--words lists them)"),
        ("GLOSSARY.md", "word " * 10, "words: must be at most 35, are 40 (--words lists them)"),
        (
            "tests/test_one.py",
            f"def test_{'x' * 56}():\n    pass\n",
            "long test names: must be at most 0, are 1 (--words lists them)",
        ),
        *(
            (
                "sumo_eval/__init__.py",
                f'"""A package."""\n{text}\n',
                f"{kind}: must be at most 0, are 1 (--words lists them)",
            )
            for kind, text in {
                "English of the package": '"""For nobody."""',
                "lines over 100 characters": "#" * 101,
                "functions over 7 parameters": "def _f(a, b, c, d, e, f, g, h): ...\n_f",
                "assignments over 3 targets": "a, b, c, d = '1234'",
                "functions over 150 tokens": "def _f():\n" + "    -1\n" * 73 + "_f",
            }.items()
        ),
    ],
)
def test_words_beyond_a_limit_are_found(worded, file, text, finding):
    (worded / "docs" / "page.md").write_text("word " * 10)
    (worded / "docs" / "long.md").write_text("word " * 20)
    (worded / file).write_text(text)
    done = check(worded)
    assert done.stdout.splitlines() == [finding]
    assert done.returncode == 1


@pytest.mark.parametrize(
    "day, length, found",
    [("2025-12-31", 61, 0), ("2026-01-02", 60, 0), ("2026-01-02", 61, 1)],
)
def test_long_subject_of_a_later_commit_is_found(worded, day, length, found):
    who = {
        f"GIT_{role}_{item}": "a" for role in ("AUTHOR", "COMMITTER") for item in ("NAME", "EMAIL")
    }
    for words in (["init"], ["commit", "--allow-empty", "--message", "x" * length]):
        environment = {**os.environ, **who, "GIT_COMMITTER_DATE": f"{day}T12:00:00Z"}
        subprocess.run(
            ["git", words[0], "--quiet", *words[1:]], cwd=worded, env=environment, check=True
        )
    assert check(worded).stdout == f"subject over 60 characters: {'x' * length}\n" * found


def test_law_a_skip_of_a_whole_file_stands_before_its_tests():
    """Further down it leaves out the tests above it, and no count of skipped tests shows that."""
    for path in sorted(ROOT.glob("tests/**/test_*.py")):
        body = ast.parse(path.read_text(encoding="utf-8")).body
        below = dropwhile(lambda node: not getattr(node, "name", "").startswith("test_"), body)
        loose = "".join(ast.dump(it) for it in below if not isinstance(it, ast.FunctionDef))
        assert not {"importorskip", "allow_module_level"} & set(re.findall(r"\w+", loose)), path
