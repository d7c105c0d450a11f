"""Section of the report on settings: how this run reads the paper where it leaves something open,
and every setting with its unit and equation.

Users: `report/sections.py`.
"""

from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, NamedTuple

from sumo_eval.groups import grouped
from sumo_eval.report.verdict import Additions
from sumo_eval.results import Evaluation
from sumo_eval.settings import About, EvaluationSettings, about


class SettingRow(NamedTuple):
    """One setting as the report lists it.

    path: its tables and its name, e.g. `method.zones.deceleration`.
    changed: whether it differs from the default.
    """

    path: str
    value: str
    default: str
    changed: bool
    about: About


def settings_content(evaluation: Evaluation, _: Additions) -> dict[str, Any]:
    """Content of templates/sections/settings.html.j2.

    origin: where the numbers come from: versions, machine, time, seed.
    """
    settings, manifest = evaluation.settings, evaluation.manifest
    origin = {"seed": settings.seed}
    names = {"recorded": "created", "format version": "format_version",
             "paths start in": "source_folder"}  # fmt: skip
    origin |= {label: manifest[key] for label, key in names.items() if key in manifest}
    origin |= manifest.get("versions", {}) | manifest.get("machine", {})
    return {"readings": readings(settings), "groups": setting_rows(settings), "origin": origin}


def setting_rows(settings: EvaluationSettings) -> dict[str, list[SettingRow]]:
    """Every setting outside the scenarios and the ADSs, by the group of settings it belongs to."""
    return grouped(
        (row.path.rpartition(".")[0] or "evaluation", row) for row in _rows(settings, "")
    )


def _rows(settings: Any, prefix: str) -> Iterator[SettingRow]:
    """The settings of a table and of the tables in it.

    prefix: names of the tables around it, each followed by a dot.
    """
    for item in fields(settings):
        value = getattr(settings, item.name)
        if is_dataclass(value):
            yield from _rows(value, f"{prefix}{item.name}.")
        elif item.name not in ("scenario", "ads"):  # these have tables of their own
            default: Any = value if item.default is MISSING else item.default
            if item.default_factory is not MISSING:
                default = item.default_factory()
            yield SettingRow(
                f"{prefix}{item.name}",
                _word(value),
                _word(default),
                value != default,
                about(type(settings), item.name),
            )


def _word(value: object) -> str:
    """A setting's value as text."""
    if isinstance(value, tuple):
        return ", ".join(value) or "none"
    if isinstance(value, bool | None):  # as the evaluation file has it: `true`, not `True`
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def readings(settings: EvaluationSettings) -> list[tuple[str, str]]:
    """(equation, sentence): how the method was read in this run."""
    method, simulation = settings.method, settings.simulation
    zones, index = method.zones, method.anthropomorphic
    field = index.field
    target = (
        f"The GP learns tanh((T² − T*²) / {zones.target_scale:g} s²), T = 1/max ITTC, "
        "smoothly through contact."
        if zones.target == "squared_time"
        else "The GP learns plain labels, +1 safe and −1 hazardous."
    )
    superposition = (
        "The field sums magnitudes, so its peak lies on the driven path; the printed unit vector "
        "would cancel there."
        if field.superposition == "magnitude"
        else "The field sums vectors, as printed; it vanishes on the driven path itself."
    )
    loss = (
        "C compares the severity U, as the equation prints, not the loss class L of the text."
        if method.collision.loss == "severity"
        else "C compares the loss class L, as the text says, not the severity U that the equation "
        "prints."
    )
    return [
        (
            "1–6",
            f"A point is hazardous where ideal braking with {zones.deceleration:g} m/s² meets an "
            f"inverse TTC of {zones.critical_inverse_ttc:g} 1/s or more.",
        ),
        (
            "7–8",
            f"{target} Its kernel works in the unit box, because metres and metres per second "
            "have no common length.",
        ),
        ("9", superposition),
        (
            "10",
            f"k1 = {field.k1:g} and k2 = {field.k2:g} s/m; nearer than 1 m the distance counts as "
            "1 m.",
        ),
        (
            "11",
            f"Slices lie every {index.slice_spacing:g} m; each has {2 * index.points_per_side + 1} "
            f"points within ±{index.side_width:g} m of the ADS's own path, fewer metres where the "
            "road ends sooner.",
        ),
        (
            "12",
            "p/p_2σ = min(1, exp(2 − z²/2)): full marks within two deviations of the drivers. "
            f"Deviations are at least {index.centre_deviation_floor:g} m (path) and "
            f"{100 * index.field_deviation_floor:g} % (field).",
        ),
        (
            "12",
            "f_n = min(1, operations of the drivers / operations of the ADS). The printed fraction "
            "is upside down: it would reward more operations.",
        ),
        (
            "13",
            "D is the mean of D_i over the safe zone, weighted by exposure where one was declared "
            "or measured. After a "
            "collision there that the ideal vehicle avoids, D is not computed.",
        ),
        (
            "14–15",
            "U is the relative speed at first contact over the overlap w, and w is at least 0.5."
            + ("" if method.collision.unit else f" `{method.collision.severity}` replaces it."),
        ),
        (
            "16",
            "r is the distance to the most dangerous point over the distance to the zone's "
            "boundary, in the unit box; "
            "above 1 in the safe zone, 1 where there is no hazardous zone.",
        ),
        (
            "17",
            f"{loss} The ideal vehicle brakes at once with {simulation.ideal_deceleration:g} "
            "m/s² where friction allows it, built up in "
            f"{simulation.ideal_build_up:g} s. An ADS that hits more gently than it counts 1.",
        ),
        (
            "17",
            "C averages over collisions only, as the paper has it, so avoiding one can lower it. "
            "Read it beside the number of collisions. Without a collision C = 1.",
        ),
        (
            "beside 17",
            "A = 1 − Σ w max(0, U − Ug) / Σ w max(0, U0 − Ug) over all evaluated points, w = r: U0 "
            "is that of `no_reaction`, U that of the worst incident: contact, departure, giving "
            "up. An ADS that is no worse in any case and better in one never has a lower A. A' = 1 "
            f"− ln(1 + x/x0) / ln(1 + 1/x0), x = 1 − A, x0 = {method.task.sharpness:g}.",
        ),
        (
            "beside 13",
            "T is the mean over the safe cases of t_i: along the way that the drivers and the "
            f"reference car `{method.task.task_reference}` drove, the mean of min(1, time of the "
            "slowest of them / own time); 0 with an incident. A departure: a corner of the body "
            f"more than {method.task.road_margin:g} m off the road.",
        ),
        (
            "beside 13",
            "H is the mean over the safe cases of f_L, f_n+, the similarity among drivers who make "
            "the same kind of manoeuvre and the plausibility, multiplied. An avoidable incident "
            "there counts 0; a collision that the ideal vehicle has as well is left out.",
        ),
        ("beside 18", f"S+ = T max(0, A') ({method.score.a:g} + {method.score.b:g} H)."),
        (
            "18",
            f"S = {method.score.a:g} k5 C + {method.score.b:g} k6 D. Where D is not computed its "
            "term counts 0.",
        ),
    ]
