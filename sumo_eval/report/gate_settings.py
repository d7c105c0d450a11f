"""The gate file: which changes between two runs, or which values of the new one, are not let through."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, Lt

from sumo_eval.errors import InputError
from sumo_eval.settings import About, Checked, NotNegative
from sumo_eval.settings.config import read_checked

Quantity = Literal[
    "T", "A", "A'", "H", "S+", "regret", "C", "D", "S", "collision_probability", "collisions", "avoidable_collisions",
    "unavoidable_collisions", "caused_collisions", "safe_collisions", "off_road", "departures", "gave_up",
    "not_evaluated", "requirements_missed",
    "new_collisions", "harsher", "less_human", "newly_off_road", "newly_not_evaluated",
]  # fmt: skip

HIGHER_IS_BETTER: tuple[Quantity, ...] = ("T", "A", "A'", "H", "S+", "C", "D", "S")
WITH_INTERVAL: tuple[Quantity, ...] = (*HIGHER_IS_BETTER, "regret", "collision_probability")
OF_THE_COMPARISON: tuple[Quantity, ...] = (
    "new_collisions", "harsher", "less_human", "newly_off_road", "newly_not_evaluated",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class LimitSettings(Checked):
    """One limit: it fails when any of its bounds is passed."""

    quantity: Annotated[Quantity, About("what is limited")]
    ads: Annotated[str | None, About("only this ADS; default: each")] = None
    scenario: Annotated[str | None, About("only this logical scenario; default: each")] = None
    at_least: Annotated[float | None, About("smallest value of the new run")] = None
    at_most: Annotated[float | None, About("largest value of the new run")] = None
    worse_by: Annotated[float | None, About("largest change for the worse, in the quantity's own unit")] = None
    worse_by_percent: Annotated[float | None, About("largest change for the worse, of the base's value", "%")] = None
    only_if_certain: Annotated[
        bool, About("`worse_by` and `worse_by_percent` count only where the interval of the difference leaves out 0")
    ] = False


DEFAULT_LIMITS = (
    LimitSettings("new_collisions", at_most=0.0),
    LimitSettings("newly_off_road", at_most=0.0),
    LimitSettings("newly_not_evaluated", at_most=0.0),
    *(LimitSettings(score, worse_by=0.0, only_if_certain=True) for score in HIGHER_IS_BETTER),
)


@dataclass(frozen=True, slots=True)
class GateSettings(Checked):
    """How two runs are compared, and what is not let through."""

    confidence: Annotated[float, Gt(0.0), Lt(1.0), About("share that the intervals of differences cover")] = 0.95
    resamples: Annotated[int, Ge(100), Le(1_000_000), About("resamples of the paired bootstrap")] = 2000
    seed: Annotated[int, Ge(0), About("of the resampling")] = 1
    harsher_by: Annotated[
        float, NotNegative, About("change of U from which a collision is harsher or softer", "m/s", "U", "15")
    ] = 0.1
    less_human_by: Annotated[
        float,
        NotNegative,
        About(
            "change of a case's human-likeness, or of D_i, from which it is less or more human",
            symbol="D_i",
            equation="12",
        ),
    ] = 0.01
    limit: Annotated[tuple[LimitSettings, ...], About("what is not let through")] = DEFAULT_LIMITS


def read_gate(path: Path | None) -> GateSettings:
    """The settings in a gate file; without one, the defaults. Raises InputError naming every mistake."""
    if path is None:
        return GateSettings()
    settings = read_checked(path, GateSettings, "gate file")
    for number, limit in enumerate(settings.limit, start=1):
        _check(limit, f"`limit` {number} in {path}")
    return settings


def _check(limit: LimitSettings, where: str) -> None:
    bounds = (limit.at_least, limit.at_most, limit.worse_by, limit.worse_by_percent)
    if all(bound is None for bound in bounds):
        raise InputError(f"{where} must have at_least, at_most, worse_by or worse_by_percent, got none of them.")
    if any(bound is not None and bound < 0.0 for bound in (limit.worse_by, limit.worse_by_percent)):
        raise InputError(f"worse_by and worse_by_percent of {where} must be at least 0.")
    relative = limit.worse_by is not None or limit.worse_by_percent is not None
    if relative and limit.quantity in OF_THE_COMPARISON:
        raise InputError(
            f"{where} must have at_most for `{limit.quantity}`, which is a change already; it cannot be worse by "
            "something."
        )
    if limit.only_if_certain and not (relative and limit.quantity in WITH_INTERVAL):
        raise InputError(
            f"`only_if_certain` of {where} must stand beside worse_by or worse_by_percent of "
            f"{', '.join(WITH_INTERVAL)}; only they have an interval."
        )
