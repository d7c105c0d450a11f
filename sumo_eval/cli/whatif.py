"""`sumo-eval whatif`: the least change of each lever that changes the outcome of a case."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from math import inf
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
    with Progress() as progress:
        if case is None:
            levers = _of_all_collisions(WhatIf(run), run, lever, progress)
        else:
            levers = [WhatIf(run, progress).answers(known_case(run, case), lever)]
    reasons = [it.why_not for it in levers if it.why_not]  # of collisions without answers
    levers = [it for it in levers if not it.why_not]
    if reasons and not levers:
        raise InputError(reasons[0])
    if reasons:
        tell(f"{count(len(reasons), 'collision')} left out. The first: {reasons[0]}", err=True)
    if as_json:
        tell(json.dumps({it.fact.case: list(map(_plain, it.answers)) for it in levers}, indent=1))
    else:
        show(_table_of_all(levers) if case is None else _table(levers[0]))


def _of_all_collisions(
    search: WhatIf, run: Path, lever: str | None, progress: Callable[..., None]
) -> list[CaseLevers]:
    """Answers for every collision of a run, or why there are none."""
    from sumo_eval.record.run_folder import check_complete
    from sumo_eval.record.store import open_store
    from sumo_eval.whatif.search import CaseLevers

    with open_store(run) as store:
        check_complete(store, run)
        facts = [fact for fact in store.facts("ads") if fact.collision is not None]
    levers = []
    for number, fact in enumerate(facts, 1):
        try:
            # `fine=False`: the values of the first round are enough for a count
            levers.append(search.answers(fact, lever, fine=False))
        except InputError as error:
            levers.append(CaseLevers(fact, why_not=str(error)))
        progress("collisions", number, len(facts))
    return levers


def _plain(answer: Answer) -> dict[str, object]:
    """An answer for JSON, which has no inf."""
    return {**asdict(answer), "share": answer.share if answer.flips else None}


def _table(levers: CaseLevers) -> Iterator[str]:
    """A line for each lever: recorded value, value needed, change as a share of the range."""
    from sumo_eval.report.levers_section import effect_words, ends_words

    hit = levers.fact.collision
    yield f"{levers.fact.case}: {ends_words(hit)}"
    for answer in levers.answers:
        line = f"  {answer.lever.name:<28} {effect_words(answer, hit)}"
        if answer.flips:
            bar = "█" * max(round(20.0 * answer.share), 1)  # 20: the whole range
            line += f"  {bar} {100.0 * answer.share:z.1f} % of its range"
        yield line
    yield f"{levers.drives} drives; a delay acts in whole steps of the simulation."


def _table_of_all(levers: Sequence[CaseLevers]) -> Iterator[str]:
    """A line for each lever of each ADS and scenario: how many collisions it avoids."""
    from sumo_eval.groups import grouped
    from sumo_eval.report.words import count

    if not levers:
        yield "The run has no collision."
    groups = grouped(((lever.fact.driver, lever.fact.scenario), lever) for lever in levers)
    for (ads, scenario), cases in groups.items():
        yield f"{ads} in {scenario}: {count(len(cases), 'collision')}"
        shares = grouped((it.lever.name, it.share) for case in cases for it in case.answers)
        # of each lever, its changes that each avoid a collision
        avoided = {name: [it for it in shares[name] if it < inf] for name in shares}
        for name, changes in sorted(avoided.items(), key=lambda pair: -len(pair[1])):
            line = f"  {name:<28} avoids {len(changes)}"
            if changes:
                line += f", half of them by at most {100.0 * median(changes):z.0f} % of its range"
            yield line
