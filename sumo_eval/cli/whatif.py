"""`sumo-eval whatif`: the least change of each lever that changes the outcome of a case."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import click

from sumo_eval.cli.options import RUN, flag, trusting
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import show, tell
from sumo_eval.errors import InputError

if TYPE_CHECKING:
    from sumo_eval.whatif.search import Answer, CaseLevers, WhatIf

_BAR = 20  # characters for a change over the whole range


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
    from sumo_eval.report.explain import known_case
    from sumo_eval.report.words import count
    from sumo_eval.whatif.search import WhatIf

    if all_collisions == (case is not None):
        raise InputError("`whatif` needs either a CASE or --all-collisions.")
    search = WhatIf(run)
    if case is None:
        found = _of_all_collisions(search, run, lever)
        reasons = [one.why_not for one in found if one.why_not]  # of collisions without answers
        found = [one for one in found if not one.why_not]
        if reasons and not found:
            raise InputError(reasons[0])
        if reasons:
            words = f"{count(len(reasons), 'collision')} left out. The first: {reasons[0]}"
            tell(words, err=True)
        lines = _table_of_all(found)
    else:
        found = [search.answers(known_case(run, case), lever)]
        lines = _table(found[0])
    if as_json:
        plain = {one.fact.case: [_plain(it) for it in one.answers] for one in found}
        tell(json.dumps(plain, indent=1))
    else:
        show(lines)


def _of_all_collisions(search: WhatIf, run: Path, lever: str | None) -> list[CaseLevers]:
    """Answers for every collision of a run, or why there are none."""
    from sumo_eval.record.run_folder import FACTS
    from sumo_eval.record.store import open_store

    with open_store(run / FACTS) as store:
        facts = [fact for fact in store.facts("ads") if fact.collision is not None]
    found = []
    with Progress() as progress:
        for number, fact in enumerate(facts, start=1):
            # to count, the values of the first round are enough
            found.append(search.answers_or_why_not(fact, lever, fine=False))
            progress("collisions", number, len(facts))
    return found


def _plain(answer: Answer) -> dict[str, object]:
    """An answer for JSON, which has no inf."""
    return {**asdict(answer), "share": answer.share if answer.flips else None}


def _table(found: CaseLevers) -> Iterator[str]:
    """A line for each lever: recorded value, value needed, change as a share of the range."""
    from sumo_eval.report.levers_section import effect_words, ends_words

    hit = found.fact.collision
    yield f"{found.fact.case}: {ends_words(hit)}"
    for it in found.answers:
        line = f"  {it.lever.name:<28} {effect_words(it, hit)}"
        if it.flips:
            bar = "█" * max(round(it.share * _BAR), 1)
            line += f"  {bar} {100.0 * it.share:z.1f} % of its range"
        yield line
    yield f"{found.drives} drives; a delay acts in whole steps of the simulation."


def _table_of_all(found: Sequence[CaseLevers]) -> Iterator[str]:
    """A line for each lever of each ADS and scenario: how many collisions it avoids."""
    from sumo_eval.report.words import count

    if not found:
        yield "The run has no collision."
    groups: dict[tuple[str, str], list[CaseLevers]] = {}
    for one in found:
        groups.setdefault((one.fact.driver, one.fact.scenario), []).append(one)
    for (ads, scenario), cases in groups.items():
        yield f"{ads} in {scenario}: {count(len(cases), 'collision')}"
        # of each lever, the change of each collision that it avoids
        avoided: dict[str, list[float]] = {}
        for it in chain.from_iterable(one.answers for one in cases):
            changes = avoided.setdefault(it.lever.name, [])
            if it.flips:
                changes.append(it.share)
        for name, changes in sorted(avoided.items(), key=lambda pair: -len(pair[1])):
            line = f"  {name:<28} avoids {len(changes)}"
            if changes:
                line += f", half of them by at most {100.0 * median(changes):z.0f} % of its range"
            yield line
