"""The report's section on the levers of the night's worst case, and a lever's effect in words, also
for `sumo-eval whatif`.

Users: `cli/whatif.py`, `report/sections.py`.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from sumo_eval.report.page import case_key
from sumo_eval.report.verdict import Additions
from sumo_eval.report.words import cause_words, count
from sumo_eval.results import Evaluation
from sumo_eval.scoring.contact_cause import cause_of_contact
from sumo_eval.text import point_words
from sumo_eval.trajectory import Collision

if TYPE_CHECKING:  # they load the simulator, which a look at a report does not need
    from sumo_eval.whatif.levers import Lever
    from sumo_eval.whatif.search import Answer

MOST_CHANGES = 4  # changes of the outcome that are named after the first one; JSON has all


def levers_content(evaluation: Evaluation, additions: Additions) -> Mapping[str, Any] | None:
    """Content of templates/sections/levers.html.j2; None where no levers were searched."""
    levers = additions.levers
    if levers is None:
        return None
    fact = levers.fact
    return {
        "why_not": levers.why_not,
        "drives": levers.drives,
        "title": f"{fact.driver} in {fact.scenario} at {point_words(fact.values)}",
        "address": f"#case:{case_key(fact.case)}",
        "ends": ends_words(fact.collision),
        "cause": cause_words(cause_of_contact(fact)) if fact.collision else "",
        "command": shlex.join(["sumo-eval", "whatif", str(evaluation.folder), fact.case]),
        "bars": [_bar(answer, fact.collision) for answer in levers.answers],
    }


def ends_words(hit: Collision | None) -> str:
    """`collision at 2.25 s`."""
    return "no collision" if hit is None else f"collision at {hit.time:z.2f} s"


def effect_words(answer: Answer, hit: Collision | None) -> str:
    """Effect of a lever: `40 -> 46.4 m avoids it, 46.3 does not`.

    hit: contact of the recorded case.
    """
    lever = answer.lever
    unit = _unit_of(lever)
    verb = "brings a collision" if hit is None else "avoids it"
    start = "no limit" if lever.unlimited else f"{lever.recorded:z.5g}"
    if not answer.flips:
        recorded = start if lever.unlimited else start + unit
        if answer.felt:
            return f"{recorded}: none of {answer.tried} values {verb}"
        # of the levers that may have no effect, all but this one limit what the ADS sees
        delay = lever.name == "conditions.actuation_delay"
        why = " where SUMO moves the ego" if delay else ", the ADS sees the world as it is"
        return f"{recorded}: no effect{why}"
    flip, *rest = answer.flips
    more = (
        f" and {count(len(rest) - MOST_CHANGES, 'more value')}" if len(rest) > MOST_CHANGES else ""
    )
    values = ", ".join(f"{it.after:z.4g}" for it in rest[:MOST_CHANGES])
    further = f"; also changes at {values}{more}" if rest else ""
    return f"{start} -> {flip.after:z.5g}{unit} {verb}, {flip.before:z.5g} does not{further}"


def _unit_of(lever: Lever) -> str:
    """Unit behind a number, as ` m`; empty for a share."""
    return "" if lever.unit == "1" else f" {lever.unit}"


def _bar(answer: Answer, hit: Collision | None) -> dict[str, Any]:
    """A lever on a rail of 100 units, its range from left to right.

    at: position of the recorded value.
    to: position of the nearest value that changes the outcome; without such a value: `at`.
    low, width: of the part from `at` to `to`. share: its width in words; "" without a change.
    parts: begin and width of each part with a collision.
    """
    lever, flips = answer.lever, answer.flips
    at = 100.0 * lever.place(lever.recorded)
    to = 100.0 * lever.place(flips[0].after) if flips else at
    return {
        "name": lever.name,
        "words": effect_words(answer, hit).replace("->", "→"),
        "share": f"{100.0 * answer.share:z.1f} %" if flips else "",
        "range": f"{lever.low:g} to {lever.high:g}{_unit_of(lever)}",
        "at": f"{at:z.1f}",
        "to": f"{to:z.1f}",
        "low": f"{min(at, to):z.1f}",
        "width": f"{abs(to - at):z.1f}",
        # a lever that does not act on the ADS at all times may change an outcome all the same
        "parts": list(_collides(answer, hit)) if answer.felt or answer.flips else [],
    }


def _collides(answer: Answer, hit: Collision | None) -> Iterator[tuple[str, str]]:
    """Begin and width of each part of the rail whose values collide."""
    lever = answer.lever
    changes = sorted(100.0 * lever.place(flip.after) for flip in answer.flips)
    # the outcome at the lowest value: the recorded outcome, reversed by each change in between
    below = sum(flip.after < lever.recorded for flip in answer.flips)
    collides = (hit is not None) != (below % 2 == 1)
    for begin, end in pairwise([0.0, *changes, 100.0]):
        if collides:
            yield f"{begin:z.1f}", f"{end - begin:z.1f}"
        collides = not collides
