"""The least change of each lever that changes the outcome of a recorded case.

Users: `cli/whatif.py`, `nightly/night.py`, `report/levers_section.py`, `report/verdict.py`.

The first round drives 33 values along each lever, or all if it has fewer. The second (`fine`)
drives every step between the two values where the outcome changes, for the nearest change on each
side of the recorded value. Then both ends of these changes are rerun: an ADS must repeat its
outcome. A change and its return between two values of the first round are not found.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError, check_known, unknown
from sumo_eval.frozen import frozen
from sumo_eval.groups import grouped
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.cases import Case, Outcome, Setup
from sumo_eval.record.engines import run_cases
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.record.run_folder import read_exposures, resolved_run
from sumo_eval.record.scenario_files import refuse_edited
from sumo_eval.whatif.levers import Lever, first_values, levers_of, moved

_WITHOUT_EFFECT = {
    "conditions.perception_delay": "perception_not_limited",
    "conditions.sensor_range": "perception_not_limited",
    "conditions.actuation_delay": "actuation_not_delayed",
}
"""Lever that does not act on some ADSs -> name of the clip by which a recording shows this."""

Trial = tuple[Lever, float]
"""A lever, and the value at which the case is driven."""
Line = dict[float, bool]
"""Whether the ADS collides, by value of a lever."""


@frozen
class Flip:
    """A change of outcome along a lever, away from the recorded value: the last value before the
    change and the first one after it.
    """

    before: float
    after: float


@frozen
class Answer:
    """Effect of one lever on a case.

    flips: changes of outcome, the nearest to the recorded value first. The nearest on each side is
        located to a step, further ones to two values of the first round.
    tried: number of values whose outcome is known, the recorded one included.
    felt: whether the lever acts on the ADS at all times.
    """

    lever: Lever
    flips: tuple[Flip, ...]
    tried: int
    felt: bool

    @property
    def share(self) -> float:
        """The least change as a share of the lever's range; inf without one."""
        return self.lever.share(self.flips[0].after) if self.flips else float("inf")


class CaseLevers(NamedTuple):
    """Answers for one case, the lever with the least change first.

    fact: the recorded case.
    drives: number of drives that the answers took.
    why_not: error message instead of answers.
    """

    fact: Fact
    answers: tuple[Answer, ...] = ()
    drives: int = 0
    why_not: str = ""


class WhatIf:
    """Recorded cases of a run, rerun with one lever moved."""

    def __init__(self, run: Path, progress: Progress = quiet) -> None:
        self._progress = progress
        self._run = resolved_run(run, driving=True)
        self._exposures = read_exposures(run)
        settings = self._run.settings
        # only contacts matter here: once the outcome is decided, the rest need not be driven
        self._setup = Setup(
            replace(settings.simulation, end_when_decided=True), settings.run, self._run.source
        )
        self._locators = {ads.name: ads.locator for ads in settings.ads}
        self._drives = 0

    def answers(self, fact: Fact, name: str | None = None, *, fine: bool = True) -> CaseLevers:
        """Effects of all levers, or of the one called `name`.

        name: as `vehicle.friction` or `friction`.
        fine: locate the nearest changes to a step.
        Raises InputError for a case that was not evaluated or does not repeat.
        """
        levers = self._levers(fact, name)
        self._drives = 0
        if fact.status not in EVALUATED:
            raise InputError(
                f"Case `{fact.case}` must have an outcome to change, got {fact.status}: "
                f"{fact.error or 'no reason is recorded'}"
            )
        # the recorded case itself: any lever at its recorded value
        plain = levers[0], levers[0].recorded
        trials = [
            (lever, value)
            for lever in levers
            for value in first_values(self._run.scenarios[fact.scenario], fact.values, lever)
        ]
        outcomes = self._outcomes(fact, "levers", [plain, *trials])
        _check_repeats(fact, outcomes[plain])
        lines: dict[Lever, Line] = {it: {it.recorded: fact.collision is not None} for it in levers}
        _fill(lines, outcomes)
        if fine:
            self._locate(fact, lines)
        recordings = (it.recording for it in outcomes.values() if it.recording)
        clips = {clip.what for recording in recordings for clip in recording.clips}
        answers = [
            Answer(
                lever, _flips(lever, line), len(line), _WITHOUT_EFFECT.get(lever.name) not in clips
            )
            for lever, line in lines.items()
        ]
        answers.sort(key=lambda answer: answer.share)
        return CaseLevers(fact, tuple(answers), self._drives)

    def _levers(self, fact: Fact, name: str | None) -> list[Lever]:
        """All levers of a case, or the one called `name`; raises InputError for an unknown name."""
        # a run whose evaluation was edited may lack the scenario or the ADS
        check_known("scenario of the run", self._run.scenarios, fact.scenario)
        check_known("ADS of the run", self._locators, fact.driver)
        refuse_edited(self._run, self._exposures, [fact.scenario])
        logical = self._run.scenarios[fact.scenario]
        levers = levers_of(logical, fact.values, self._run.settings.simulation)
        named = [it for it in levers if name in (None, it.name, it.name.split(".")[-1])]
        if name is not None and not named:
            raise unknown(f"lever of `{fact.scenario}`", name, [it.name for it in levers])
        return named

    def _locate(self, fact: Fact, lines: dict[Lever, Line]) -> None:
        """Drive every step between the ends of the nearest changes, then rerun both ends.

        Raises InputError if an end does not repeat its outcome.
        """
        inside = [
            (lever, value)
            for lever, flip in _nearest(lines)
            for value in lever.steps()
            if min(flip.before, flip.after) < value < max(flip.before, flip.after)
        ]
        _fill(lines, self._outcomes(fact, "levers, step by step", inside))
        ends = [
            (lever, value) for lever, flip in _nearest(lines) for value in (flip.before, flip.after)
        ]
        rerun = self._outcomes(fact, "levers, changes rerun", ends)
        for (lever, value), outcome in rerun.items():
            if _collides(outcome) is not lines[lever][value]:
                raise InputError(
                    f"Case `{fact.case}` with {lever.name} = {value:g} does not repeat: its ADS "
                    "must do the same in every drive."
                )

    def _outcomes(self, fact: Fact, stage: str, trials: Iterable[Trial]) -> dict[Trial, Outcome]:
        """Drive the case once for each trial at which the scenario has a point.

        stage: name of this round, for the progress.
        """
        logical = self._run.scenarios[fact.scenario]
        locator = self._locators[fact.driver]
        revealed = self._setup.simulation.conditions.reveal_scenario
        different = list(dict.fromkeys(trials))
        # a case gets the number of its trial as that of its point
        cases = [
            Case(number, concrete, "ads", fact.driver, locator, seed=self._run.settings.seed)
            for number, (lever, value) in enumerate(different)
            if (concrete := moved(logical, fact.values, lever, value, revealed=revealed))
        ]
        self._drives += len(cases)
        outcomes = {}
        for outcome in run_cases(cases, self._setup):
            outcomes[different[outcome.case.point]] = outcome
            self._progress(stage, len(outcomes), len(cases))
        return outcomes


def _collides(outcome: Outcome) -> bool | None:
    """Whether the ADS collides in a drive; None: the drive could not be evaluated."""
    return outcome.status == "collision" if outcome.status in EVALUATED else None


def _fill(lines: dict[Lever, Line], outcomes: Mapping[Trial, Outcome]) -> None:
    """Add the outcomes of drives to the lines, except at recorded values: these are known."""
    for (lever, value), outcome in outcomes.items():
        collides = _collides(outcome)
        if collides is not None and value != lever.recorded:
            lines[lever][value] = collides


def _check_repeats(fact: Fact, outcome: Outcome) -> None:
    """Refuse a case whose rerun has another contact than the recorded drive, or no outcome."""
    hit = outcome.recording.collision if outcome.recording else None
    evaluated = outcome.status in EVALUATED
    if evaluated and hit == fact.collision:
        return
    before, now = (
        "no contact" if it is None else f"a contact at {it.time:.3f} s"
        for it in (fact.collision, hit)
    )
    if not evaluated:
        now = f"not evaluated ({outcome.error or outcome.status})"
    raise InputError(
        f"Case `{fact.case}` does not repeat: recorded {before}, now {now}. Its ADS must be the "
        "recorded one and do the same in every drive: undo its changes, or run the evaluation "
        "again."
    )


def _flips(lever: Lever, line: Line) -> tuple[Flip, ...]:
    """Changes of outcome along a lever, away from its recorded value, the nearest first."""
    # the recorded value is among the values: no two neighbours lie on both sides of it
    flips = [
        Flip(low, high) if low >= lever.recorded else Flip(high, low)
        for high, low in pairwise(sorted(line, reverse=True))
        if line[low] != line[high]
    ]
    return tuple(sorted(flips, key=lambda flip: lever.share(flip.after)))


def _nearest(lines: dict[Lever, Line]) -> list[tuple[Lever, Flip]]:
    """The nearest change of each lever above its recorded value and below it, if there is any."""
    nearest = []
    for lever, line in lines.items():
        sides = grouped((flip.after > lever.recorded, flip) for flip in _flips(lever, line))
        nearest += [(lever, flips[0]) for flips in sides.values()]
    return nearest
