"""Measure the processor time of each test, its child processes included.

    python tools/durations.py [pytest arguments]

Runs the tests with the arguments of `make test` and prints the tests and the folders that cost
most.
Wall time on a loaded machine says nothing, so it is shown but never ranked. A fixture that several
tests share counts for the test that asks for it first.

--write: also writes tests/durations.json, from which tests/conftest.py takes the order of the
files.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = "SUMO_EVAL_DURATIONS"  # where the test processes leave their lines


def processor_seconds() -> float:
    """Return the user and system time of this process, its finished children and all living below
    them, in s.
    """
    spent = 0.0
    for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN):
        usage = resource.getrusage(whose)
        spent += usage.ru_utime + usage.ru_stime
    return spent + living_seconds()


def living_seconds() -> float:
    """Return the time of living processes below this one, s: the drives of a run are children of a
    fork server.

    0 where there is no /proc.
    """
    parents, ticks = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended meanwhile
            continue
        parents[int(stat.parent.name)] = int(fields[1])
        # its own and its finished children's
        ticks[int(stat.parent.name)] = sum(map(int, fields[11:15]))
    below = {os.getpid()}
    while more := {process for process, parent in parents.items() if parent in below} - below:
        below |= more
    return sum(ticks.get(process, 0) for process in below - {os.getpid()}) / os.sysconf(
        "SC_CLK_TCK"
    )


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Write one line with the test's name, its processor time and its wall time (s)."""
    processor, wall = processor_seconds(), time.monotonic()
    yield
    line = [item.nodeid, processor_seconds() - processor, time.monotonic() - wall]
    with (Path(os.environ[FOLDER]) / f"{os.getpid()}.jsonl").open("a") as lines:
        lines.write(json.dumps(line) + "\n")


def measure(arguments: list[str]) -> tuple[int, dict[str, tuple[float, float]]]:
    """Run pytest and return its exit status and, by test, processor and wall time in s."""
    with tempfile.TemporaryDirectory() as folder:
        places = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
        command = [sys.executable, "-m", "pytest", "-p", "durations", *arguments]
        status = subprocess.call(
            command, cwd=ROOT, env={**os.environ, FOLDER: folder, "PYTHONPATH": places}
        )
        rows = [
            json.loads(line)
            for file in Path(folder).glob("*.jsonl")
            for line in file.read_text().splitlines()
        ]
    return status, {name: (processor, wall) for name, processor, wall in rows}


def by_prefix(
    times: dict[str, tuple[float, float]], length: int
) -> dict[str, tuple[float, float, int]]:
    """Sum the times over tests whose path begins with the same parts: processor and wall time (s),
    tests.
    """
    sums: dict[str, tuple[float, float, int]] = collections.defaultdict(lambda: (0.0, 0.0, 0))
    for name, (processor, wall) in times.items():
        key = "/".join(name.split("::")[0].split("/")[:length])
        before = sums[key]
        sums[key] = (before[0] + processor, before[1] + wall, before[2] + 1)
    return dict(sorted(sums.items(), key=lambda item: -item[1][0]))


def main() -> int:
    """Run the tests, print the tables and return pytest's exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--most", type=int, default=40, help="rows of each table")
    parser.add_argument("--json", type=Path, help="also write every test's times to this file")
    parser.add_argument(
        "--write", action="store_true", help="write tests/durations.json: wall time by file"
    )
    options, arguments = parser.parse_known_args()

    begin = time.monotonic()
    status, times = measure(arguments)
    wall = time.monotonic() - begin

    for length, title in ((2, "folder"), (3, "file")):
        print(f"\n{'processor s':>12} {'wall s':>8} {'tests':>6}  {title}")
        for key, (processor, waited, tests) in list(by_prefix(times, length).items())[
            : options.most
        ]:
            print(f"{processor:12.1f} {waited:8.1f} {tests:6}  {key}")
    print(f"\n{'processor s':>12} {'wall s':>8}  test")
    for name, (processor, waited) in sorted(times.items(), key=lambda item: -item[1][0])[
        : options.most
    ]:
        print(f"{processor:12.1f} {waited:8.1f}  {name}")
    total = sum(processor for processor, _ in times.values())
    print(f"\n{total:.0f} s of processor time in {wall:.0f} s, {len(times)} tests")

    if options.json:
        options.json.write_text(json.dumps(times, indent=0))
    if options.write:
        files = {name: round(sums[1], 1) for name, sums in sorted(by_prefix(times, 9).items())}
        (ROOT / "tests/durations.json").write_text(json.dumps(files, indent=1) + "\n")
    return status


if __name__ == "__main__":
    raise SystemExit(main())
