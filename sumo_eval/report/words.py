"""Words for values, cases and verdicts, which pages, terminal and nights share.

The `z` in formats of numbers, here and in all files of this folder, writes -0.0 as 0.0.

Users: `cli/run.py`, `cli/space.py`, `cli/whatif.py`, `nightly/`, `report/`,
`extras/figures/of_scenes.py`, `extras/openscenario/describe.py`, `extras/rates/`.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

from sumo_eval.cases import CaseResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.score_notes import Bounds
from sumo_eval.scoring.contact_cause import ContactCause
from sumo_eval.scoring.preventability import CaseVerdict, reference_ads
from sumo_eval.settings import EvaluationSettings, SamplingSettings


class VerdictStyle(NamedTuple):
    """Appearance of a verdict.

    letter: in a cell of the map, readable without colour.
    colour, ink: of the cell, of the letter.
    """

    words: str
    letter: str
    colour: str
    ink: str


LOOKS: Mapping[CaseVerdict, VerdictStyle] = {
    "avoided": VerdictStyle("avoided", "", "#d3e6f3", "#1b1f24"),
    "better": VerdictStyle("avoided, the reference had an incident", "+", "#2b74a8", "#ffffff"),
    "preventable": VerdictStyle("preventable incident", "P", "#b23c00", "#ffffff"),
    "unpreventable": VerdictStyle("unpreventable incident", "U", "#f2b97c", "#1b1f24"),
    "undecided": VerdictStyle("incident, reference not known", "?", "#e0cfdc", "#1b1f24"),
    "not evaluated": VerdictStyle("not evaluated", "–", "#69727c", "#ffffff"),
}

MEASURES = (
    ("min_ttc", "shortest TTC", "s"),
    ("max_ittc", "largest inverse TTC", "1/s"),
    ("min_thw", "shortest time headway", "s"),
    ("min_gap", "smallest gap ahead", "m"),
    ("max_drac", "largest DRAC", "m/s²"),
    ("pet", "post-encroachment time", "s"),
    ("conflict_pet", "PET of conflicting ways", "s"),
    ("undisturbed_pet", "PET without reactions", "s"),
    ("time_to_conflict", "undisturbed time to the conflict area", "s"),
    ("max_deceleration", "strongest deceleration", "m/s²"),
    ("max_jerk", "largest jerk", "m/s³"),
    ("max_lateral_jerk", "largest lateral jerk", "m/s³"),
    ("delta_v", "delta-v at contact", "m/s"),
    ("largest_offset", "largest offset from the lane's middle", "m"),
    ("overshoot", "overshoot beyond the lane's middle", "m"),
    ("over_line_time", "time over a line of the lane", "s"),
)
"""The criticality measures of a case: (field of CaseResult, words, unit)."""

_CAUSES = {
    "late": "braked {after:z.2f} s after the last moment at which full braking avoids it, {last}",
    "weak": "braked in time, not hard enough: full braking from {last} on avoids it",
    "never_braked": "did not brake: full braking from {last} on avoids it",
    "unavoidable_by_braking": "full braking from the start does not avoid it",
    "not_repeatable": "no point of no return: no replay ends in this contact",
}


def cause_words(case: CaseResult | ContactCause) -> str:
    """Cause of a contact, by the braking and the point of no return; "" without a contact."""
    last, braked = case.no_return_time or 0.0, case.braking_time or 0.0
    return _CAUSES.get(case.contact_cause, "").format(last=f"{last:z.2f} s", after=braked - last)


_END = {
    "contact": "contact with another road user",
    "standstill": "the ego came to a standstill",
    "road_end": "the ego reached the end of the road",
    "off_road": "the ego left the road",
    "time_limit": "the simulated time limit was reached",
    "decided": "no collision was possible any more",
    "ads_error": "the controller failed",
    "ads_timeout": "the controller took too long over one step",
    "sim_error": "SUMO failed",
}
STRUCK = "another vehicle, at fault, ran into the ego's rear"


def reference_sentence(settings: EvaluationSettings) -> str:
    """The reference, and why it is used."""
    ads = reference_ads(settings)
    same = "driven through the same concrete scenarios"
    if ads is None:
        return (
            f"No ADS of this run is “{settings.report.reference}”, so the reference is the ideal "
            f"vehicle, which brakes at once at the limit, {same}."
        )
    return f"The reference is “{ads}”, {same} as every other ADS of this run."


def number(value: float | None, digits: int) -> str:
    """A fixed number of decimals; a dash for what does not apply."""
    return "–" if value is None or not math.isfinite(value) else f"{value:z.{digits}f}"


def interval_words(interval: Bounds | None, digits: int, to: str = "..") -> str:
    """`0.912..1.000`; nothing without an interval."""
    return "" if interval is None else to.join(number(end, digits) for end in interval)


span = partial(interval_words, to=" to ")
"""`0.912 to 1.000`; nothing without an interval."""


def percent(share: float | None) -> str:
    """A share with about three significant digits, e.g. `7.69 %`, and more just below 1. Only 0 is
    `0 %`, and only 1 is `100 %`.
    """
    if share is None or not math.isfinite(share):
        return "not known"
    value = 100.0 * share
    rest = 100.0 - value
    if 0.0 < value < 1e-4:
        return "less than 0.0001 %"
    if 0.0 < rest < 1e-4:
        return "more than 99.9999 %"
    shown = _rounded_as(value, value)
    if shown == 100.0:
        shown = _rounded_as(value, rest)
    return f"{shown:z.15g} %"


def confidence_words(confidence: float) -> str:
    """`95%`; digits of the setting are not rounded away: `99.5%`."""
    return f"{100.0 * confidence:z.6g}%"


def _rounded_as(value: float, part: float) -> float:
    """A value with as many decimals as give a part of it three significant digits."""
    return round(value, max(0, 2 - math.floor(math.log10(abs(part)))) if part else 0)


def count(n: int, noun: str, nouns: str | None = None) -> str:
    """`1 case`, `3 cases`."""
    return f"{n} {noun if n == 1 else nouns or noun + 's'}"


def one_line(text: str) -> str:
    """A text on one line, without control characters, which would repaint a terminal."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def end_reason(case: CaseResult) -> str:
    """Reason why a case ended, in words."""
    if case.struck_from_behind:
        return STRUCK
    return _END.get(case.end_reason or "", case.end_reason or "not known")


def sampling_words(sampling: SamplingSettings, logical: LogicalScenario) -> str:
    """Choice of the points, in words."""
    method = sampling.method or sampling.default_method(logical.default_sample)
    # a sample that the scenario defines has its own words
    texts = [item.about for item in logical.samples if item.name == method]
    if texts:
        return f"{method}, {texts[0]}"
    if sampling.count is not None:
        return f"{method}, {count(sampling.count, 'point')} asked for"
    if sampling.file is not None:
        return f"{method}, {sampling.file}"
    return f"{method}, {_axes_words(sampling, logical)}"


def _axes_words(sampling: SamplingSettings, logical: LogicalScenario) -> str:
    """Values of a grid on each axis."""
    levels, steps = sampling.levels, sampling.steps or {}
    # such an axis has all its values, whatever the levels are
    listed = [f"{it.name}: {len(it.values)} values" for it in logical.parameters if it.values]
    if isinstance(levels, int):
        return ", ".join([*listed, f"{levels} points on each {'other ' if listed else ''}axis"])
    units = {item.name: item.unit_suffix for item in logical.parameters}
    parts = [f"{name}: {points} points" for name, points in (levels or {}).items()]
    parts += [f"{name}: steps of {step:g}{units.get(name, '')}" for name, step in steps.items()]
    if not parts:
        return "the space's own steps"
    if len(parts) + len(listed) == len(logical.parameters):  # every axis has its words
        return ", ".join([*parts, *listed])
    return ", ".join([*parts, "elsewhere the space's own steps"])


def placed(sentence: str, case: CaseResult) -> str:
    """A sentence about a case, with the place of its exception in the user's code, if any."""
    return f"{sentence} At {case.error_place}." if case.error_place else sentence


def severity_words(value: float | None, unit: str, digits: int = 1) -> str:
    """`5.0 m/s`; a loss in 0..1, which has no unit, with three decimals."""
    return "not known" if value is None else number(value, digits if unit else 3) + unit
