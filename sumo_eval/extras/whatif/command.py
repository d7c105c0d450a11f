"""`sumo-eval whatif`: what would have had to be different in a case."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import click

from sumo_eval.cli.options import RUN, flag, trusting
from sumo_eval.cli.sentences import show, tell
from sumo_eval.errors import InputError

if TYPE_CHECKING:
    from sumo_eval.extras.whatif.search import Answer
    from sumo_eval.record.store import Fact

_BAR = 20  # characters of a whole range


@click.command(epilog="Example: sumo-eval whatif results/first cut_in-0007-idm --lever gap")
@RUN
@click.argument("case", required=False)
@click.option("--lever", metavar="NAME", help="This lever alone, e.g. perception_delay.")
@flag("--all-collisions", help="Of every collision of RUN: how many each lever avoids.")
@flag("--json", "as_json", help="Print JSON.")
@trusting
def whatif(
    run: Path, case: str | None, lever: str | None, all_collisions: bool, as_json: bool
) -> None:
    """Find the least change of each lever that removes the collision of CASE, or brings one."""
    from sumo_eval.extras.whatif.search import WhatIf
    from sumo_eval.report.explain import known_case

    if all_collisions == (case is not None):
        raise InputError("`whatif` needs a CASE or --all-collisions, one of both.")
    asked = WhatIf(run)
    if case is None:
        facts = _collisions(run)
        found = {fact.case: asked.answers(fact, lever, fine=False) for fact in facts}
        lines = list(_table_of_all(facts, list(found.values())))
    else:
        fact = known_case(run, case)
        found = {case: asked.answers(fact, lever)}
        lines = list(_table(fact, found[case], asked.drives))
    if as_json:
        plain = {key: [_plain(it) for it in answers] for key, answers in found.items()}
        tell(json.dumps(plain, indent=1))
    else:
        show(lines)


def _plain(answer: Answer) -> dict[str, object]:
    return {**asdict(answer), "share": answer.share if answer.flips else None}


def _collisions(run: Path) -> list[Fact]:
    """The drives of ADSs with a contact, in order."""
    from sumo_eval.record.run_folder import FACTS
    from sumo_eval.record.store import open_store

    with open_store(run / FACTS) as store:
        return [fact for fact in store.facts("ads") if fact.collision is not None]


def _table(fact: Fact, answers: Sequence[Answer], drives: int) -> Iterator[str]:
    """A line for each lever: recorded value, value needed, change as a share of the range."""
    hit = fact.collision
    verb = "brings a collision" if hit is None else "avoids it"
    yield f"{fact.case}: " + ("no collision" if hit is None else f"collision at {hit.time:.2f} s")
    for it in answers:
        lever = it.lever
        unit = "" if lever.unit == "1" else f" {lever.unit}"
        start = f"  {lever.name:<28} {lever.recorded:>8.6g}"
        if not it.felt:
            yield f"{start}{unit}: not felt, the ADS sees the world as it is"
        elif not it.flips:
            yield f"{start}{unit}: none of {it.tried} values {verb}"
        else:
            flip, *rest = it.flips
            others = f"; also changes at {', '.join(f'{one.after:.4g}' for one in rest)}"
            bar = "█" * max(round(it.share * _BAR), 1)
            yield (
                f"{start} -> {flip.after:.6g}{unit} {verb}, {flip.before:.6g} does not  "
                f"{bar} {100.0 * it.share:.1f} % of its range{others if rest else ''}"
            )
    yield f"{drives} drives; a delay acts in whole steps of the simulation."


def _table_of_all(facts: Sequence[Fact], found: Sequence[Sequence[Answer]]) -> Iterator[str]:
    """A line for each lever of each ADS and scenario: how many collisions it avoids."""
    groups: dict[tuple[str, str, str], list[float]] = {}
    count: dict[tuple[str, str], int] = {}
    for fact, answers in zip(facts, found, strict=True):
        whose = fact.driver, fact.scenario
        count[whose] = count.get(whose, 0) + 1
        for it in answers:
            groups.setdefault((*whose, it.lever.name), []).extend([it.share] * bool(it.flips))
    for (ads, scenario), number in count.items():
        yield f"{ads} in {scenario}: {number} collisions"
        own = {key[2]: shares for key, shares in groups.items() if key[:2] == (ads, scenario)}
        for name, shares in sorted(own.items(), key=lambda pair: -len(pair[1])):
            half = (
                f", half of them by {100.0 * median(shares):.0f} % of its range" if shares else ""
            )
            yield f"  {name:<28} avoids {len(shares)}{half}"
