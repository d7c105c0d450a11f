"""Plant mistakes in the package, one at a time, and count how many the tests find.

    python tools/mutate.py --count 60 --seed 1 [pytest arguments]

Each mistake is one operator or number of one line, drawn evenly over the rooms, in a copy of the
repository. The tests near it run first and stop at the first failure; all others follow only where
these found nothing.
"""

from __future__ import annotations

import argparse
import ast
import itertools
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
OTHER = {
    "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "+": "-", "-": "+",
    "*": "/", "/": "*",
    "and": "or", "or": "and", "min": "max", "max": "min", "True": "False", "False": "True",
}  # fmt: skip
"""A word of the code, and the mistake in its place."""
KEPT = ("__init__", "known_answers")  # names without rules; answers that tests compare with


@dataclass(frozen=True)
class Mistake:
    """One word of a file that is another one; line and column count from 1 and 0."""

    file: str
    line: int
    column: int
    word: str
    other: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column + 1}: {self.word} -> {self.other}"


def mistakes(path: Path) -> Iterator[Mistake]:
    """Every mistake that may be planted in a file: no type, decorator or text is touched."""
    text = path.read_text(encoding="utf-8")
    lines, file = text.splitlines(), path.relative_to(ROOT).as_posix()
    tree = ast.parse(text)
    decorators = [one for node in ast.walk(tree) for one in getattr(node, "decorator_list", ())]
    # of zip
    checks = [one for one in ast.walk(tree) if isinstance(one, ast.keyword) and one.arg == "strict"]
    left_out = {id(node) for one in (*decorators, *checks) for node in ast.walk(one)}
    for node in ast.walk(tree):
        if id(node) in left_out:
            continue
        if isinstance(node, ast.Compare | ast.BinOp | ast.BoolOp):
            first, second = (
                (node.values[0], node.values[1]) if isinstance(node, ast.BoolOp)
                else (node.left,
                    node.comparators[0] if isinstance(node, ast.Compare) else node.right)
            )  # fmt: skip
            if first.end_lineno != second.lineno:
                continue
            begin, end = first.end_col_offset or 0, second.col_offset
            between = lines[first.end_lineno - 1].encode()[begin:end].decode()
            word = between.strip("() ")
            if word in OTHER:
                column = begin + between.index(word)
                yield Mistake(file, first.end_lineno, column, word, OTHER[word])
        elif isinstance(node, ast.Constant) and isinstance(node.value, bool | float | int):
            word = lines[node.lineno - 1].encode()[node.col_offset : node.end_col_offset].decode()
            other = OTHER.get(word) or (f"{node.value + 1}" if node.value else "1")
            yield Mistake(file, node.lineno, node.col_offset, word, other)
        elif isinstance(node, ast.Name) and node.id in ("min", "max"):
            yield Mistake(file, node.lineno, node.col_offset, node.id, OTHER[node.id])


def room_of(path: Path) -> str:
    """The room of a file of the package, or the file's own name where it stands in none."""
    return path.parts[2 if path.parts[1] == "extras" else 1].removesuffix(".py")


def drawn(count: int, seed: int) -> list[Mistake]:
    """So many mistakes, the rooms in turn, each file of a room as likely as another."""
    chance = random.Random(seed)
    rooms: dict[str, list[Path]] = {}
    for path in sorted((ROOT / "sumo_eval").rglob("*.py")):
        if path.stem not in KEPT:
            rooms.setdefault(room_of(path.relative_to(ROOT)), []).append(path)
    found: list[Mistake] = []
    for room in itertools.cycle(sorted(rooms)):
        if len(found) == count:
            break
        known = [one for one in mistakes(chance.choice(rooms[room])) if one not in found]
        if known:
            found.append(chance.choice(known))
    return found


def plant(mistake: Mistake, copy: Path) -> None:
    """Write the mistake into a copy of the repository."""
    path = copy / mistake.file
    lines = path.read_bytes().splitlines(keepends=True)
    line, word = lines[mistake.line - 1], mistake.word.encode()
    assert line[mistake.column : mistake.column + len(word)] == word, mistake
    lines[mistake.line - 1] = (
        line[: mistake.column] + mistake.other.encode() + line[mistake.column + len(word) :]
    )
    path.write_bytes(b"".join(lines))


def finder(mistake: Mistake, copy: Path, arguments: list[str], *, near: bool) -> str:
    """The test that fails, twice; empty where none does.

    First the files run that name the mistake's module, then those of its room, then, unless `near`,
    all.
    """
    module = mistake.file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    names = re.compile(
        rf"{re.escape(module)}\b|from {re.escape(module.rpartition('.')[0])} import "
        rf".*{Path(mistake.file).stem}"
    )
    naming = [
        str(path)
        for path in sorted((copy / "tests").rglob("test_*.py"))
        if names.search(path.read_text())
    ]
    room = copy / "tests" / room_of(Path(mistake.file))
    for tests in (naming, [str(room)] if room.is_dir() else [], [] if near else ["tests"]):
        for name in failing(copy, [*arguments, *tests]) if tests else []:
            if failing(copy, [name]):  # else only the load of the machine had let it fail
                return name
    return ""


def failing(copy: Path, arguments: list[str]) -> list[str]:
    """The tests that fail first."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": ""}
    run = subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, text=True, check=False
    )
    names = re.findall(r"^[A-Z]+ (tests/.+?)(?: - .*)?$", run.stdout, re.MULTILINE)
    return names or ([f"exit status {run.returncode}"] if run.returncode else [])


def main() -> int:
    """Plant and run; print a line for each mistake and the count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--near", action="store_true", help="run only the tests of the module and of its room"
    )
    options, arguments = parser.parse_known_args()

    chosen, found = drawn(options.count, options.seed), 0
    # one place: kernels that did not change stay compiled
    copy = Path(tempfile.gettempdir()) / "sumo_eval_mistakes"
    shutil.rmtree(copy, ignore_errors=True)
    kept_out = shutil.ignore_patterns(".venv", ".mypy_cache", "build", "__pycache__")
    shutil.copytree(ROOT, copy, ignore=kept_out)
    for mistake in chosen:
        shutil.copy2(ROOT / mistake.file, copy / mistake.file)
        plant(mistake, copy)
        by = finder(mistake, copy, arguments, near=options.near)
        shutil.copy2(ROOT / mistake.file, copy / mistake.file)
        found += bool(by)
        print(f"{'found' if by else 'NOT FOUND':9} {mistake}  {by}", flush=True)
    print(f"{found} of {len(chosen)} mistakes are found.")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
