"""Results of the nightly rule (`scoring/rule.py`): each of its three parts (outcome, near miss,
shift) as limits that passed, failed, or could not be evaluated, with their cases.

Users: `nightly/gates.py`, `nightly/judgement.py`, `nightly/repeats.py`.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import partial

from sumo_eval.cases import CaseResult
from sumo_eval.report.gate_result import MOST_KEYS, MOST_NAMED, CaseChange, GateResult
from sumo_eval.report.notes import why_missing
from sumo_eval.report.words import MEASURES, cause_words, count, placed, severity_words
from sumo_eval.scoring.comparison import Comparison
from sumo_eval.scoring.gate_settings import ENDS, TIMED, GateSettings
from sumo_eval.scoring.rule import (
    Noise,
    Tally,
    can_fail,
    got_worse,
    holm,
    is_far,
    many,
    newly_bad,
    severity_limit,
    tallies,
)

_TIMES = "no_return_time", "braking_time", "departure_time", "settling_time"
WORDS = {name: (words, f" {unit}") for name, words, unit in MEASURES} | {
    "task_share": ("t_i", ""), "simulated_time": ("time of the drive", " s"),
    "human_likeness": ("H_i", ""), "index": ("D_i", ""), "latency_relative": ("latency", ""),
    "impact_speed": ("impact speed", " m/s"), "departure_speed": ("departure speed", " m/s"),
    **{name: (name, " s") for name in (*TIMED[:-1], *_TIMES)}
}  # fmt: skip
"""Name and unit, after a space, of the columns that have a unit or that the rule watches."""

EVERYWHERE = "all scenarios"


def judge_rule(comparison: Comparison, settings: GateSettings, noise: Noise) -> list[GateResult]:
    """Every part of the rule that is on."""
    results = list(_outcomes(comparison, settings, noise)) if settings.outcome.on else []
    tallied = tallies(comparison, settings, noise)
    # of each tally of a noisy ADS: its P, and the least P that it could have (all changed cases
    # worse)
    chances = [
        (it.chance, 0.5 ** (it.number + it.better)) for it in tallied if noise.of(it.ads).noisy
    ]
    rejected = iter(holm(chances, settings.noise.chance))
    for tally in tallied:
        if noise.of(tally.ads).noisy:
            bad = next(rejected) and (tally.near or many(tally, settings, settings.shift.share))
        else:
            bad = got_worse(tally, settings)
        results.append(_result(tally, comparison, settings, noise, bad=bad))
    return results


def judge_pairs(comparison: Comparison, settings: GateSettings, accept: str) -> list[GateResult]:
    """A failed limit if no case was compared, or if an ADS, a scenario or more than
    `settings.lost_share` of the base's cases have no partner; else none.

    accept: the command that accepts the loss.
    """
    lost = sum(group.lost for group in comparison.unpaired)
    of = comparison.pairs + lost
    examples = tuple(key for group in comparison.unpaired for key in group.examples)[:MOST_NAMED]
    missing = list(_gone(comparison))
    if not comparison.pairs:
        missing.append("no case has a partner in the base, so nothing was compared")
    elif lost > settings.lost_share * of:
        missing.append(f"{lost} of the base's {count(of, 'case')} have no partner")
    if not missing:
        return []
    sentence = f"{'; '.join(missing)}. If this is meant: {accept}"
    kept = float(comparison.pairs)
    return [GateResult("pairs", "every ADS", EVERYWHERE, False, sentence, kept, cases=examples)]


def _gone(comparison: Comparison) -> Iterator[str]:
    """ADSs and logical scenarios of the base that the new run has not."""
    groups = comparison.unpaired
    lost = [(it.ads, it.scenario) for it in groups if it.of and it.lost == it.of]
    driven = {(part.base_ads, part.scenario) for part in comparison.ads}
    # those that only drove points that the base lacks are not missing either
    driven |= {(it.ads, it.scenario) for it in groups if it.added}
    driven_ads = {ads for ads, _ in driven}
    driven_scenarios = {scenario for _, scenario in driven}
    # as keys of a dict each stands once, in order
    lost_ads = dict.fromkeys(ads for ads, _ in lost if ads not in driven_ads)
    lost_scenarios = dict.fromkeys(it for _, it in lost if it not in driven_scenarios)
    yield from (f"ADS `{ads}` of the base is missing" for ads in lost_ads)
    yield from (f"logical scenario `{it}` of the base is missing" for it in lost_scenarios)
    yield from (
        f"`{ads}` has no case of the base's {scenario} any more"
        for ads, scenario in lost
        if ads in driven_ads and scenario in driven_scenarios
    )


# --- outcome --------------------------------------------------------------------------------------


def _outcomes(comparison: Comparison, settings: GateSettings, noise: Noise) -> Iterator[GateResult]:
    """The part on outcomes: each kind of bad end of each ADS in each scenario."""
    for part in comparison.ads:
        repeats = noise.of(part.ads)
        for quantity, worse in newly_bad(part, settings, repeats).items():
            paired = part.changed.paired
            # by case: number of its pair of rows
            pairs = dict(zip(paired.new.case[worse].tolist(), worse, strict=True))
            shaky = _by_chance(pairs, part.base_ads, settings, noise) if repeats.noisy else []
            bad = {case: pair for case, pair in pairs.items() if case not in shaky}
            cases = count(len(bad), "case")
            sentence = f"{quantity}: no case"
            if bad and quantity == "severity":
                limit = f"{severity_limit(settings, repeats, part.units):z.3g}{part.units[1]}"
                sentence = f"U rose by more than {limit} in {cases}"
            elif bad:
                sentence = f"{cases} {ENDS[quantity]}, not so in the base"
            sentence += _on_repeats(bad, shaky, settings.outcome.repeats, noise)
            yield GateResult(
                quantity, part.ads, part.scenario, False if bad else None if shaky else True,
                sentence, float(len(bad)), 0.0,
                tuple(bad)[:MOST_KEYS],
                tuple(end_change(paired.base[k], paired.new[k], part.units)
                      for k in [*bad.values()][:MOST_NAMED])
            )  # fmt: skip


def _by_chance(cases: Iterable[str], ads: str, settings: GateSettings, noise: Noise) -> list[str]:
    """Those of the bad cases of a noisy ADS that are bad by chance: cases that were bad by chance
    in an earlier night, and cases of which too few drives are bad tonight. There are none of the
    latter where the ADS drove twice alike in the last good night (`steady`).

    ads: its name in the base.
    """
    # 0: no case has too few
    least = settings.outcome.bad_of if ads not in noise.steady else 0
    return [it for it in cases if it in noise.shaky or noise.bad.get(it, least) < least]


def _on_repeats(bad: Iterable[str], shaky: Sequence[str], repeats: int, noise: Noise) -> str:
    """End of a sentence: the cases that are bad in some drives only.

    bad: cases that fail; shaky: cases that do not.
    repeats: number of further drives of each.
    """
    words = ""
    some = [case for case in bad if noise.bad.get(case, math.inf) <= repeats]
    if some:
        words += f"; bad in some of {repeats + 1} drives only: {_drives(some, noise)}"
    if shaky:
        words += (
            "; not failed, because bad in some drives only, tonight (in brackets how many) "
            f"or in an earlier night: {_drives(shaky, noise)}"
        )
    return words


def _drives(keys: Sequence[str], noise: Noise) -> str:
    """Some of the cases, each with its number of bad drives: `cut_in-0042-mine (1)`."""
    return ", ".join(f"{key} ({noise.bad.get(key, 1)})" for key in keys[:MOST_NAMED])


def end_change(old: CaseResult, now: CaseResult, units: tuple[str, str]) -> CaseChange:
    """End of a case before and now, in words, with the cause of a contact or of no outcome.

    units: of U, before and now.
    """
    before, after = map(_end_words, (old, now), units)
    cause = cause_words(now) if now.evaluated else placed(why_missing(now), now)
    return CaseChange.of(now, before, f"{after}; {cause}" if cause else after)


def _end_words(case: CaseResult, unit: str) -> str:
    """`contact with U 5.0 m/s`, `left the road`, `ads_error`, `misses: gap`, `ok`."""
    ends = [f"contact with U {severity_words(case.severity, unit)}"] if case.collided else []
    ends += ["left the road"] if case.departed else []
    ends += [] if case.evaluated else [case.status]
    ends += [f"misses: {case.requirements_missed}"] if case.requirements_missed else []
    return ", ".join(ends) or case.status


# --- near miss and shift --------------------------------------------------------------------------


def _result(
    tally: Tally, comparison: Comparison, settings: GateSettings, noise: Noise, *, bad: bool
) -> GateResult:
    """Result of a measure of the parts on near misses and on shifts.

    bad: whether it failed.
    """
    quantity, zone = tally.measure.quantity, tally.measure.zone
    words, unit = WORDS.get(quantity, (quantity, ""))
    # scenarios of the ADS, not of its worse cases: then a limit that fails keeps its name, and the
    # night since which it fails, when worse cases in another scenario are added
    (scenario, *more) = [part.scenario for part in comparison.ads if part.ads == tally.ads]
    result = partial(GateResult, quantity, tally.ads, EVERYWHERE if more else scenario)
    # Words on the cases that could show a change: `of` for the sentence; `alike`, without the limit
    # of the zone, for `reason`, so that measures with equal reasons share a line.
    of = alike = count(tally.cases, "case")
    if tally.near and zone is not None:
        of, alike = f"{of} inside {zone:g}{unit}", f"{of} inside the zone of interest"
    if not can_fail(tally, settings, noisy=noise.of(tally.ads).noisy):
        none = "cannot see a change with"
        return result(None, f"{words}: {none} {of}", reason=f"{none} {alike}", blind=words)

    sentence = f"{words}: {tally.number} worse, {tally.better} better of {of}"
    if tally.lone:
        sentence += f", and {tally.lone} with a value in one run alone, not compared"
    if not bad:
        return result(True, sentence, float(tally.number))
    if more:
        where = [worse.part.scenario for worse in tally.worse if worse.which]
        sentence += f", worse in {', '.join(where)}"
    sentence += f" (P = {tally.chance:z.2g})"
    if tally.near and tally.least_kept <= settings.near_miss.kept_margin:
        sentence += f"; one kept {tally.least_kept:z.0%} of its margin"
    if not tally.near and is_far(tally, settings):
        sentence += f"; one by {tally.furthest:z.2g} tolerances"
    keys = tuple(
        worse.part.changed.paired.new[pair].case for worse in tally.worse for pair in worse.which
    )
    return result(
        False, sentence, float(tally.number), None, keys[:MOST_KEYS], tuple(_worst(tally, unit))
    )


def _worst(tally: Tally, unit: str) -> Iterator[CaseChange]:
    """The worst cases of all scenarios, with the values before and after."""
    first = [(worse, pair) for worse in tally.worse for pair in worse.which[:MOST_NAMED]]
    first.sort(key=lambda place: -place[0].rank[place[1]])
    for worse, pair in first[:MOST_NAMED]:
        case = worse.part.changed.paired.new[pair]
        yield CaseChange.of(case, float(worse.before[pair]), float(worse.after[pair]), unit)
