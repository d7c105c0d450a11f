"""Run the slow tests, and the laws with twenty times as many examples; keep when each file last
passed.

    python tools/run_campaign.py [pytest arguments, such as tests/record or -k people]

tests/campaign/passed.json has a row for each file: day, commit, share of the cases
(SUMO_EVAL_CAMPAIGN_SHARE), tests, wall time (s). A run of a part renews the rows of its files; a
file with a failure loses its row.
"""

from __future__ import annotations

import datetime
import json
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PASSED = ROOT / "tests" / "campaign" / "passed.json"
SELECTION = ["-m", "campaign or hypothesis", "--hypothesis-profile", "campaign"]


class Outcomes:
    """What came of the tests of each file."""

    def __init__(self) -> None:
        self.failed: set[str] = set()
        self.tests: dict[str, int] = defaultdict(int)
        self.seconds: dict[str, float] = defaultdict(float)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count one part of a test."""
        file = report.nodeid.partition("::")[0]
        self.seconds[file] += report.duration
        self.tests[file] += report.when == "call" and report.passed
        if report.failed:
            self.failed.add(file)


def main(arguments: list[str]) -> int:
    """Run, keep what passed and return pytest's exit status."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    outcomes = Outcomes()
    status = pytest.main([*SELECTION, *arguments], plugins=[outcomes])

    rows = json.loads(PASSED.read_text(encoding="utf-8")) if PASSED.is_file() else {}
    for file in outcomes.failed:
        rows.pop(file, None)
    share = float(os.environ.get("SUMO_EVAL_CAMPAIGN_SHARE", "1"))
    for file, tests in outcomes.tests.items():
        if tests and file not in outcomes.failed:
            day, seconds = datetime.date.today().isoformat(), round(outcomes.seconds[file], 1)
            rows[file] = {
                "day": day,
                "commit": commit,
                "share": share,
                "tests": tests,
                "seconds": seconds,
            }
    lines = ",\n".join(
        f"{json.dumps(file)}: {json.dumps(row)}" for file, row in sorted(rows.items())
    )
    PASSED.write_text("{\n" + lines + "\n}\n", encoding="utf-8")
    return int(status)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
