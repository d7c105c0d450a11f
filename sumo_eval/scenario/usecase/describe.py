"""What was understood of a use case, in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from sumo_eval.errors import InputError
from sumo_eval.scenario.usecase.logical import UseCase, read_use_case
from sumo_eval.scenario.usecase.steps import SENTENCES


def described(read: UseCase) -> Iterator[str]:
    """Sentences on the space, the rows, who does what and what is checked."""
    logical, outline = read.logical, read.outline
    yield f"{logical.name}: {outline.feature}"
    yield f"  {outline.name}"
    for item in logical.parameters:
        yield f"  parameter {item.name} = {', '.join(f'{value:g}' for value in item.values)}{item.behind}, {item.about}"
    fixed = [item for item in outline.columns if item.name not in logical.names]
    if fixed:
        yield "  in all rows: " + ", ".join(f"{item.name} = {item.values[0]:g} {item.unit}" for item in fixed)
    count, different, goal = len(read.rows), len(set(read.rows)), logical.road.length
    yield f"  {count} row{'' if count == 1 else 's'}, {different} of them different; goal at {goal:g} m"
    for sentence in logical.notes:
        yield f"  {sentence}"
    for other in read.story.others.values():
        for move in other.moves:
            yield f"  {other.name}: {move['do']} when {move['when']}"
    for check in logical.requirements.all if logical.requirements is not None else ():
        yield f"  check `{check.name}`: {check.text}"


def listed(name: str, files: Iterable[Path]) -> Iterator[str]:
    """A line for each file of a catalogue: its rows and checks, or why it does not play; and their sums."""
    whole = played = rows = 0
    for file in files:
        whole += 1
        try:
            read = read_use_case(file)
        except InputError as error:
            yield f"does not play: {error}"
            continue
        played += 1
        rows += len(read.rows)
        checks = 0 if read.logical.requirements is None else len(read.logical.requirements.all)
        yield f"{read.logical.name}: {len(read.rows)} rows, {checks} checks"
    yield f"{name}: {played} of {whole} files play, {rows} rows"


def sentences() -> Iterator[str]:
    """Every sentence that is understood, by its keyword."""
    yield "[...] may be left out; <<a|b>>: one of them; NPC: Npc0, Pedestrian0, ..."
    yield "VALUE: <column>, or a number with a unit"
    for sentence in SENTENCES:
        yield f"{sentence.kind.capitalize():5} {sentence.shown}"
