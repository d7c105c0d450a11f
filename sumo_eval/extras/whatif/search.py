"""The least change of each lever that changes the outcome of a recorded case.

Two rounds: at least 32 values along each lever, then every step between the neighbours of the
nearest change on either side. Both ends of every change are rerun.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError, unknown
from sumo_eval.extras.whatif.levers import Lever, levers_of, moved
from sumo_eval.record.cases import Case, Outcome, Setup
from sumo_eval.record.engines import run_cases
from sumo_eval.record.run_folder import resolved_run
from sumo_eval.record.store import Fact
from sumo_eval.trajectory import Clip, Collision

_UNSEEN = "perception_not_limited"
_PERCEIVED = ("conditions.perception_delay", "conditions.sensor_range")


@dataclass(frozen=True, slots=True)
class Flip:
    """A change of outcome along a lever: the last value before it and the first after it."""

    before: float
    after: float


@dataclass(frozen=True, slots=True)
class Answer:
    """Effect of one lever on a case.

    flips: changes of outcome, the nearest to the recorded value first; the nearest on each side is
        located to a step, further ones to a value of the first round.
    tried: values that were driven.
    felt: whether the ADS perceives what the lever changes.
    """

    lever: Lever
    flips: tuple[Flip, ...]
    tried: int
    felt: bool

    @property
    def share(self) -> float:
        """The least change as a share of the lever's range; inf without one."""
        return self.lever.share(self.flips[0].after) if self.flips else float("inf")


class WhatIf:
    """Recorded cases of a run, rerun with one lever moved."""

    def __init__(self, run: Path) -> None:
        self._run = resolved_run(run)
        settings = self._run.settings
        # a contact ends a case before anything else could
        simulation = replace(settings.simulation, end_when_decided=True)
        self._setup = Setup(simulation, settings.run, self._run.source)
        self._locators = {ads.name: ads.locator for ads in settings.ads}
        self.drives = 0

    def levers(self, fact: Fact, name: str | None = None) -> list[Lever]:
        """The levers of a case, or the one with a name."""
        logical = self._run.scenarios[fact.scenario]
        levers = levers_of(logical, fact.values, self._run.settings.simulation)
        if name is None:
            return levers
        found = [lever for lever in levers if name in (lever.name, lever.name.split(".")[-1])]
        if not found:
            raise unknown("lever", name, [lever.name for lever in levers])
        return found

    def answers(self, fact: Fact, name: str | None = None, *, fine: bool = True) -> list[Answer]:
        """Effects of all levers, the least change first.

        fine: locate the nearest changes to a step.
        Raises InputError for a case that does not repeat.
        """
        levers = self.levers(fact, name)
        asked = [(lever, value) for lever in levers for value in lever.coarse()]
        known = self._outcomes(fact, [(levers[0], levers[0].recorded), *asked])
        self._check_repeats(fact, known[0])
        collided = fact.collision is not None
        lines = {
            lever.name: {value: it for (one, value), it in zip(asked, known[1:], strict=True)
                if one is lever and it is not None}
            for lever in levers
        }  # fmt: skip
        found = {lever.name: _flips(lever, lines[lever.name], collided) for lever in levers}
        if fine:
            self._locate(fact, levers, lines, found)
        felt = not any(clip.what == _UNSEEN for it in known if it for clip in _clips(it))
        answers = [
            Answer(
                lever,
                _flips(lever, lines[lever.name], collided),
                len(lines[lever.name]),
                felt or lever.name not in _PERCEIVED,
            )
            for lever in levers
        ]
        return sorted(answers, key=lambda answer: answer.share)

    def _locate(
        self,
        fact: Fact,
        levers: Sequence[Lever],
        lines: dict[str, dict[float, Outcome]],
        found: dict[str, tuple[Flip, ...]],
    ) -> None:
        """Drive every step between the ends of the nearest changes, then both ends again."""
        collided = fact.collision is not None
        asked = [
            (lever, value)
            for lever in levers
            for flip in _nearest(lever, found[lever.name])
            for value in lever.between(flip.before, flip.after)
        ]
        for (lever, value), it in zip(asked, self._outcomes(fact, asked), strict=True):
            if it is not None:
                lines[lever.name][value] = it
        ends = [
            (lever, value)
            for lever in levers
            for flip in _nearest(lever, _flips(lever, lines[lever.name], collided))
            for value in (flip.before, flip.after)
            if value != lever.recorded
        ]
        for (lever, value), it in zip(ends, self._outcomes(fact, ends), strict=True):
            if it is None or _hit(it) != _hit(lines[lever.name][value]):
                raise InputError(f"`{fact.case}` with {lever.name} = {value:g} does not repeat.")

    def _outcomes(self, fact: Fact, asked: Sequence[tuple[Lever, float]]) -> list[Outcome | None]:
        """The outcomes with these levers at these values; None where there is none."""
        logical = self._run.scenarios[fact.scenario]
        seed, locator = self._run.settings.seed, self._locators[fact.driver]
        cases = [
            Case(number, concrete, "ads", fact.driver, locator, seed=seed)
            for number, (lever, value) in enumerate(asked)
            if (concrete := moved(logical, fact.values, lever, value)) is not None
        ]
        self.drives += len(cases)
        known = {it.case.point: it for it in run_cases(cases, self._setup)}
        outcomes = [known.get(number) for number in range(len(asked))]
        return [it if it is not None and it.status in EVALUATED else None for it in outcomes]

    def _check_repeats(self, fact: Fact, now: Outcome | None) -> None:
        """Refuse a case whose recorded outcome does not come again."""
        hit = None if now is None or now.recording is None else now.recording.collision
        if now is None or hit != fact.collision:
            raise InputError(
                f"Case `{fact.case}` does not repeat: recorded {_words(fact.collision)}, now "
                f"{'not evaluated' if now is None else _words(hit)}. Run its evaluation again."
            )


def _words(hit: Collision | None) -> str:
    return "no contact" if hit is None else f"a contact at {hit.time:.3f} s"


def _hit(outcome: Outcome) -> bool:
    return outcome.status == "collision"


def _clips(outcome: Outcome) -> Sequence[Clip]:
    return () if outcome.recording is None else outcome.recording.clips


def _flips(lever: Lever, line: dict[float, Outcome], collided: bool) -> tuple[Flip, ...]:
    """Changes of outcome along a lever, away from its recorded value, the nearest first."""
    flips = []
    outcomes = {value: _hit(it) for value, it in line.items()} | {lever.recorded: collided}
    for side in (1, -1):
        away = sorted(
            (value for value in outcomes if side * (value - lever.recorded) >= 0.0),
            key=lambda value: side * value,
        )
        flips += [Flip(one, two) for one, two in pairwise(away) if outcomes[one] != outcomes[two]]
    return tuple(sorted(flips, key=lambda flip: lever.share(flip.after)))


def _nearest(lever: Lever, flips: Sequence[Flip]) -> list[Flip]:
    """The nearest change on each side of the recorded value."""
    sides = ([it for it in flips if (it.after > lever.recorded) is up] for up in (True, False))
    return [side[0] for side in sides if side]
