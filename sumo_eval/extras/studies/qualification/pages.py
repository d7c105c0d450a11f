"""A qualification as lines for a terminal, as a page and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from sumo_eval.extras.studies.qualification.qualified import DOMAIN, LIMITS, PURPOSE, Qualification
from sumo_eval.extras.studies.qualification.table import Answer
from sumo_eval.report.page import template, write_page

_HEAD = f"     {'check':<40} {'expected':>9} {'found':>9} {'bound':>7} unit"


def shown(value: Answer | None) -> str:
    """An answer in at most 9 characters, if it is a number or one of the words of an outcome."""
    if isinstance(value, float):
        return next(text for n in (5, 4, 3, 2) if len(text := f"{value:z.{n}g}") <= 9)
    return value or "nothing"


def lines(found: Qualification) -> Iterator[str]:
    """A table that fits 80 columns; the reasons of failed checks below it."""
    for kind, group in groupby(found.findings, key=lambda item: item.check.kind):
        yield f"{kind}"
        yield _HEAD
        for item in group:
            check = item.check
            bound = "" if isinstance(check.expected, str) else f"{check.bound:.2g}"
            row = f"{shown(check.expected):>9} {shown(item.found)[:9]:>9} {bound:>7} {check.unit}"
            yield f"{'ok' if item.passed else 'FAIL':<4} {check.name:<40} {row}".rstrip()
    for item in found.failed:
        why = item.error or f"expected {shown(item.check.expected)}, found {shown(item.found)}"
        yield f"FAIL  {item.check.name}: {why}"
    total = len(found.findings)
    verdict = "NOT qualified." if found.failed else "qualified on this machine."
    passed = total - len(found.failed)
    yield f"{passed} of {total} checks passed: this installation is {verdict}"


def write_qualification(found: Qualification, folder: Path) -> tuple[Path, Path]:
    """Write `qualification.html` and `qualification.json` into a folder and return their paths."""
    page, plain = folder / "qualification.html", folder / "qualification.json"
    kinds = [
        (kind, list(group))
        for kind, group in groupby(found.findings, key=lambda item: item.check.kind)
    ]
    text = template("qualification.html.j2").render(
        found=found, kinds=kinds, purpose=PURPOSE, domain=DOMAIN, limits=LIMITS, shown=shown,
    )  # fmt: skip
    write_page(page, text, "The qualification")
    write_page(
        plain, json.dumps(found.plain(), indent=2, allow_nan=False) + "\n", "The qualification"
    )
    return page, plain
