"""The least change of each lever that changes the outcome of a recorded case.

Users: `cli/whatif.py`, `nightly/night.py`, `report/levers_section.py`, `report/verdict.py`.

The first round drives 33 values along each lever, or all if it has fewer. The second (`fine`)
drives every step between the two values where the outcome changes, for the nearest change on each
side of the recorded value. Then both ends of these changes are rerun: an ADS must repeat its
outcome. A change and its return between two values of the first round are not found.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError, check_known, unknown
from sumo_eval.frozen import frozen
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
        self._error = ""  # message of the plain rerun (trial 0), if it failed

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
        trials = [
            (lever, value)
            for lever in levers
            for value in first_values(self._run.scenarios[fact.scenario], fact.values, lever)
        ]
        # first the recorded case itself: any lever at its recorded value
        rerun, *outcomes = self._outcomes(
            fact, "levers", [(levers[0], levers[0].recorded), *trials]
        )
        _check_repeats(fact, rerun, self._error)
        lines: dict[Lever, Line] = {it: {it.recorded: fact.collision is not None} for it in levers}
        _fill(lines, trials, outcomes)
        if fine:
            self._locate(fact, lines)
        clips = {clip.what for it in outcomes if it and it.recording for clip in it.recording.clips}
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
        for entry, logical in self._run.entries:
            if logical.name == fact.scenario:
                # the run keeps the hashes of the scenario's files beside its exposure
                hashes = self._exposures.get(logical.name, {})
                refuse_edited(logical.name, hashes, entry.use, self._run.source)
        logical = self._run.scenarios[fact.scenario]
        levers = levers_of(logical, fact.values, self._run.settings.simulation)
        named = [it for it in levers if name in (None, it.name, it.name.split(".")[-1])]
        if name is not None and not named:
            raise unknown(f"lever of `{fact.scenario}`", name, [it.name for it in levers])
        return named

    def answers_or_why_not(
        self, fact: Fact, name: str | None = None, *, fine: bool = True
    ) -> CaseLevers:
        """Effects of all levers, or the error message of a case without any."""
        try:
            return self.answers(fact, name, fine=fine)
        except InputError as error:
            return CaseLevers(fact, why_not=str(error))

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
        _fill(lines, inside, self._outcomes(fact, "levers, step by step", inside))
        ends = [
            (lever, value) for lever, flip in _nearest(lines) for value in (flip.before, flip.after)
        ]
        rerun = zip(ends, self._outcomes(fact, "levers, changes rerun", ends), strict=True)
        for (lever, value), outcome in rerun:
            if outcome is None or (outcome.status == "collision") != lines[lever][value]:
                raise InputError(
                    f"Case `{fact.case}` with {lever.name} = {value:g} does not repeat: its ADS "
                    "must do the same in every drive."
                )

    def _outcomes(
        self, fact: Fact, stage: str, trials: Sequence[tuple[Lever, float]]
    ) -> list[Outcome | None]:
        """Drive the case once for each (lever, value).

        stage: name of this round, for the progress.

        None: the scenario has no such point, or the drive could not be evaluated.
        """
        logical = self._run.scenarios[fact.scenario]
        locator = self._locators[fact.driver]
        revealed = self._setup.simulation.conditions.reveal_scenario
        # a case gets the number of its trial as that of its point, and by it the outcome's place
        cases = [
            Case(number, concrete, "ads", fact.driver, locator, seed=self._run.settings.seed)
            for number, (lever, value) in enumerate(trials)
            if (concrete := moved(logical, fact.values, lever, value, revealed=revealed))
        ]
        self._drives += len(cases)
        evaluated: list[Outcome | None] = [None] * len(trials)
        for number, outcome in enumerate(run_cases(cases, self._setup), start=1):
            if outcome.status in EVALUATED:
                evaluated[outcome.case.point] = outcome
            elif outcome.case.point == 0:  # the plain rerun
                self._error = outcome.error or outcome.status
            self._progress(stage, number, len(cases))
        return evaluated


def _fill(
    lines: dict[Lever, Line],
    trials: Sequence[tuple[Lever, float]],
    outcomes: Sequence[Outcome | None],
) -> None:
    """Add the outcomes of drives to the lines, except at recorded values: these are known."""
    for (lever, value), outcome in zip(trials, outcomes, strict=True):
        if outcome is not None and value != lever.recorded:
            lines[lever][value] = outcome.status == "collision"


def _check_repeats(fact: Fact, outcome: Outcome | None, error: str) -> None:
    """Refuse a case whose rerun has another contact than the recorded drive.

    outcome: of the rerun; None: it was not evaluated, because of `error`.
    """
    rerun = None if outcome is None else outcome.recording
    if rerun is None or rerun.collision != fact.collision:
        before, after = (
            "no contact" if hit is None else f"a contact at {hit.time:.3f} s"
            for hit in (fact.collision, None if rerun is None else rerun.collision)
        )
        now = after if rerun else f"not evaluated ({error})"
        raise InputError(
            f"Case `{fact.case}` does not repeat: recorded {before}, now {now}. Its ADS must be "
            "the recorded one and do the same in every drive: undo its changes, or run the "
            "evaluation again."
        )


def _flips(lever: Lever, line: Line) -> tuple[Flip, ...]:
    """Changes of outcome along a lever, away from its recorded value, the nearest first."""
    flips = []
    for direction in (1, -1):
        # from the recorded value upwards, then downwards
        away = sorted(
            (value for value in line if direction * (value - lever.recorded) >= 0.0),
            key=lambda value: direction * value,
        )
        flips += [Flip(near, far) for near, far in pairwise(away) if line[near] != line[far]]
    return tuple(sorted(flips, key=lambda flip: lever.share(flip.after)))


def _nearest(lines: dict[Lever, Line]) -> list[tuple[Lever, Flip]]:
    """The nearest change of each lever above its recorded value and below it, if there is any."""
    nearest = []
    for lever, line in lines.items():
        flips = _flips(lever, line)
        above = [flip for flip in flips if flip.after > lever.recorded]
        below = [flip for flip in flips if flip.after < lever.recorded]
        nearest += [(lever, flip) for flip in (*above[:1], *below[:1])]
    return nearest
