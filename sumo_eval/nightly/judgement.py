"""Judgement of a night: its limits, compared with its bases; what may be chance; and whether the
night becomes a base itself. For `nightly.night`.

Users: `nightly/morning.py`, `nightly/night.py`.
"""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from itertools import dropwhile, takewhile
from pathlib import Path
from typing import NamedTuple

from sumo_eval.nightly.bases import Bases, find_bases, pin_of, pinned_by_itself
from sumo_eval.nightly.gates import judge
from sumo_eval.nightly.history import Accepted, History, Night, ShakyCase
from sumo_eval.nightly.repeats import AGAIN, bad_again, keys_of, repeats_of, shaky_cases
from sumo_eval.nightly.rule_limits import EVERYWHERE, judge_pairs
from sumo_eval.record.progress import Progress
from sumo_eval.report.gate_result import MOST_NAMED, GateResult, LimitName, failed, in_order
from sumo_eval.report.words import count
from sumo_eval.results import Evaluation
from sumo_eval.scoring.gate_settings import GateSettings
from sumo_eval.scoring.rule import Noise, only_improved


class Since(NamedTuple):
    """Nights in a row, up to tonight, in which a limit failed: the first, and their number."""

    night: str
    nights: int

    @property
    def words(self) -> str:
        """`new` or `since 2026-11-21T02-00-00Z, 3 nights`."""
        return "new" if self.nights == 1 else f"since {self.night}, {count(self.nights, 'night')}"


class Judgement(NamedTuple):
    """A night compared with its bases.

    gates: results of the limits, each limit once.
    noise: how differently the ADSs drove repeated cases tonight.
    shaky: cases that ended badly in some of their drives only.
    builds: build by ADS, where known.
    since: by limit that failed tonight: since when it has failed.
    """

    bases: Bases
    gates: tuple[GateResult, ...]
    noise: Noise
    shaky: frozenset[ShakyCase]
    builds: Mapping[str, str]
    since: Mapping[LimitName, Since] = {}


def judge_night(
    history: Path, database: History, evaluation: Evaluation, gate: GateSettings, progress: Progress
) -> Judgement:
    """Compare a night with its bases and evaluate its limits.

    Each limit is listed once: against the last good night, or, if it fails only against the
    accepted night, against that.
    """
    bases = find_bases(history, database, evaluation, gate)
    folder = history / AGAIN
    repeats = repeats_of(evaluation, gate, folder, progress)
    noise = Noise(repeats, {}, keys_of(evaluation, database.shaky()), bases.steady)
    bad = bad_again(bases.comparisons, evaluation, noise, gate, folder)
    # A case may be bad in all drives compared with one base, and in some compared with the other.
    noises = [noise._replace(bad=drives) for drives in bad]
    accept = shlex.join(["sumo-eval", "accept", str(history), "--reason", "..."])
    gates = [
        *judge(evaluation, bases.comparison, gate, noises[0] if noises else noise),
        *judge_repeats(noise, bases.good, database, gate),
    ]
    if bases.unusable:
        missing = "the accepted night cannot be compared with, so slow drift was not evaluated"
        if bases.good is None:
            missing = "no earlier good night can be compared with, so no limit was evaluated"
        missing += f". If this is meant: {accept}"
        gates.append(GateResult("pairs", "every ADS", EVERYWHERE, False, missing, 0.0, None))
    for comparison, counted in zip(bases.comparisons, noises, strict=True):
        results = judge_pairs(comparison, gate, accept)
        if comparison is bases.pinned:  # with the accepted night
            results = [
                result._replace(against=comparison.base_folder.name)
                for result in (*judge(evaluation, comparison, gate, counted), *results)
            ]
        known = {result.name for result in failed(gates)}
        gates += [result for result in failed(results) if result.name not in known]
    since = failing_since(database, gates, evaluation.folder.name)
    return Judgement(
        bases,
        in_order(gates, {name: start.nights for name, start in since.items()}),
        noise,
        frozenset(shaky_cases(evaluation, bad, gate)),
        evaluation.manifest.get("builds", {}),
        since,
    )


def judge_repeats(
    noise: Noise, good: Night | None, database: History, settings: GateSettings
) -> Iterator[GateResult]:
    """A result for each ADS on whether two drives of a case are equal, within the tolerances.

    With k nights in a row, up to the last good one, in which all repeats were equal, the
    probability that n cases differ tonight by chance is taken as 1 / (k + 1) ** n. The result fails
    where this is below `settings.noise.chance`.
    """
    newest_first = [line for line in database.gates()[::-1] if line.quantity == "repeats"]
    lines = list(dropwhile(lambda line: good is None or line.night != good.night, newest_first))
    for ads, repeats in noise.repeats.items():
        apart = repeats.apart
        quiet = len(list(takewhile(bool, (line.passed for line in lines if line.ads == ads))))  # k
        lost = (quiet + 1.0) ** -len(apart) < settings.noise.chance  # repeatability was lost
        of = count(repeats.cases, "case")
        sentence = f"{len(apart)} of {of} differed beyond tolerances in a second drive"
        if apart and not lost:
            named = ", ".join(list(apart)[:MOST_NAMED])
            sentence += f"; not failed, because few or not new: {named}"
        yield GateResult(
            "repeats", ads, EVERYWHERE, False if lost else None if apart else True, sentence,
            cases=tuple(apart), worst=tuple(apart.values())[:MOST_NAMED]
        )  # fmt: skip


def failing_since(
    database: History, gates: Sequence[GateResult], tonight: str
) -> dict[LimitName, Since]:
    """Since when each limit that failed tonight has failed, by its name."""
    failing = {
        (line.night, line.ads, line.scenario, line.quantity, line.bound)
        for line in database.gates()
        if line.passed == 0
    }
    since = {}
    for gate in failed(gates):
        unbroken = [tonight]
        for night in reversed(database.ran()):
            if (night.night, *gate.name) not in failing:
                break
            unbroken += [night.night]
        since[gate.name] = Since(unbroken[-1], len(unbroken))
    return since


def new_pin(
    night: Night, judgement: Judgement, database: History, gate: GateSettings
) -> Accepted | None:
    """Automatic acceptance of a night: of the first good night, and of a night in which paired
    cases only improved. None for any other night.
    """
    if not night.good:
        return None
    pin = pin_of(database)
    if pin is None:
        return pinned_by_itself(night.night, "the first good night", None)
    # with the accepted night, which is also the last good one if `pinned` is None
    comparison = judgement.bases.pinned or judgement.bases.comparison
    accepted = judgement.bases.accepted
    if (
        comparison is None
        # a user accepted another night meanwhile, or the acceptance expired
        or accepted is None
        or accepted.night != pin.night
        or any(repeats.noisy for repeats in judgement.noise.repeats.values())
        or comparison.unpaired
        or not only_improved(comparison, gate)
    ):
        return None
    return pinned_by_itself(night.night, "paired cases only improved", pin)
