"""How many recorded people there are for each concrete scenario of an evaluation, before anything is driven."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sumo_eval.drivers.recorded.matching import known_match
from sumo_eval.drivers.recorded.reference import open_people, reference
from sumo_eval.errors import InputError
from sumo_eval.record.facts import resolve, space_of
from sumo_eval.record.recording import Space
from sumo_eval.settings import EvaluationSettings


@dataclass(frozen=True, slots=True)
class PointCoverage:
    """The recorded people of a safe concrete scenario. drivers: who would be compared with; near: events within the
    tolerance; short: of these, recorded over too little of the road; again: further events of the same drivers.
    """

    scenario: str
    point: str
    drivers: int
    near: int
    short: int
    again: int


@dataclass(frozen=True, slots=True)
class Coverage:
    """The recorded people of a scenario. event: the kind of event that it is met as, empty where nobody says; events:
    how many of that kind there are.
    """

    scenario: str
    event: str
    events: int
    least: int
    points: tuple[PointCoverage, ...]

    def sentence(self) -> str:
        """What to know of it."""
        if not self.event:
            return f"{self.scenario}: no kind of recorded event is this scenario; [recorded] of its file may name one"
        people = [point.drivers for point in self.points]
        enough, some = sum(n >= self.least for n in people), sum(n > 0 for n in people)
        return (
            f"{self.scenario}: {self.events} {self.event} events; of {len(people)} safe concrete scenarios {enough} "
            f"have at least {self.least} recorded people, {some - enough} have some, {len(people) - some} have none"
        )


def coverage(
    evaluation: Path, watch: Callable[[str, int, int], None] = lambda what, done, total: None
) -> list[Coverage]:
    """The recorded people of every scenario of an evaluation file. Raises InputError where it asks for none."""
    settings, source = resolve(evaluation, Path(), resume=False)
    if settings.drivers.source != "recorded":
        raise InputError(f"{evaluation} must ask for recorded people ([drivers] source = \"recorded\"), got "
                         f"{settings.drivers.source!r}.")  # fmt: skip
    spaces = [space_of(entry, settings, source, offset=offset) for offset, entry in enumerate(settings.scenario)]
    return coverage_of(spaces, settings, source, watch)


def coverage_of(
    spaces: Sequence[Space],
    settings: EvaluationSettings,
    source: Path,
    watch: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> list[Coverage]:
    """The recorded people of the safe concrete scenarios of spaces."""
    people = open_people(settings.drivers, source)
    found = []
    for space in spaces:
        logical = space.logical
        match = known_match(logical.name, logical.recorded)
        table = None if match is None or people.events is None else people.events.tables[match.kind]
        rows = []
        for done, number in enumerate(space.safe, start=1):
            concrete = space.concrete(number)
            here = reference(concrete, people, settings.drivers, logical.recorded)
            rows.append(
                PointCoverage(logical.name, concrete.label, len(here.drives), here.near, here.short, here.again)
            )
            watch(logical.name, done, len(space.safe))
        found.append(
            Coverage(
                logical.name,
                "" if match is None else match.kind,
                0 if table is None else len(table),
                settings.drivers.least,
                tuple(rows),
            )
        )
    return found


def nobody(found: Iterable[Coverage]) -> bool:
    """Whether there is no recorded person for any concrete scenario."""
    return not any(point.drivers for one in found for point in one.points)
