"""The gate file: which changes between two runs, and which values of the new run, fail it.

`nightly/`, `scoring/` and `cli/compare.py` take bounds and tolerances from here. `report/` and
`extras/` look up which scores are better when higher.

Fixed: keys of the settings and names of quantities, which users' gate files have. A text of a
setting appears in the reference page and in messages.
"""

from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Le

from sumo_eval.case_table import NUMBERS
from sumo_eval.errors import InputError, check_known
from sumo_eval.frozen import frozen, required
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.settings.checked import (
    Checked,
    InnerShare,
    Natural,
    NotNegative,
    NotNegativeFloat,
    PositiveInt,
    Share,
    optional,
    setting,
)
from sumo_eval.settings.config import read_checked

HIGHER_IS_BETTER = {name: field for name, (field, _) in SCORES.items() if name != "regret"}
"""Score that is better when higher -> field of ScenarioResult. Any other number of an ADS is better
when lower.
"""
WITH_INTERVAL = (*HIGHER_IS_BETTER, "regret", "collision_probability")
"""Quantities whose difference between two runs has an interval."""
Change = Literal[
    "new collision", "left the road", "not evaluated any more", "harsher", "less human",
    "collision gone", "back on the road", "evaluated again", "softer", "more human",
]  # fmt: skip
"""Changes of a case: five for the worse, the worst first, then five for the better."""
OF_THE_COMPARISON: dict[str, Change] = {
    "new_collisions": "new collision",
    "harsher": "harsher",
    "less_human": "less human",
    "newly_off_road": "left the road",
    "newly_not_evaluated": "not evaluated any more",
}
"""Quantity of a limit that counts cases with a change -> the change."""

QUANTITIES = (
    *WITH_INTERVAL,
    "collisions", "avoidable_collisions", "unavoidable_collisions", "caused_collisions",
    "safe_collisions", "off_road", "departures", "gave_up", "not_evaluated", "requirements_missed",
    *OF_THE_COMPARISON,
)  # fmt: skip
"""Numbers of an ADS in a logical scenario that a limit may be about."""

COLUMNS = (*NUMBERS, "d_i", "departed", "incident_severity")
"""Columns of cases.csv that a limit may be about; the limit holds for each case."""
HIGHER_COLUMNS = frozenset((
    "min_ttc", "min_thw", "min_gap", "pet", "conflict_pet", "undisturbed_pet", "time_to_conflict",
    "index", "d_i", "length_factor", "operation_factor", "similarity",
    "likeness_length_factor", "operation_tolerance", "mixture_similarity", "plausibility",
    "human_likeness", "manoeuvre_share", "task_share", "beats_ideal",
    "human_low", "human_mean", "human_high",
))  # fmt: skip
"""Columns of which more is better; in all other columns less is better."""

OF_U = frozenset((
    "severity", "ideal_severity", "no_reaction_severity", "departure_severity", "incident_severity",
))  # fmt: skip
"""Columns in the unit of U. They are compared only if both runs have U in one unit."""

OF_HARM = frozenset((
    "severity", "loss", "impact_speed", "departure_severity", "departure_speed",
))  # fmt: skip
"""Columns of the harm of a contact or a departure: 0 in an evaluated case that has none."""

ENDS = {
    "collided": "collided", "departed": "left the road", "gave_up": "gave up",
    "not_evaluated": "not evaluated", "missed": "missed a requirement",
}  # fmt: skip
"""Bad end of a case -> its words, the gravest first. A case with several counts for the first."""

TIMED = (
    "wall_time", "latency_mean", "latency_max", "latency_median", "latency_p99",
    "latency_reference", "latency_relative",
)  # fmt: skip
"""Columns of measured times, which differ between any two drives of one case."""

LAST_DIGIT = 1e-9
"""Largest effect of rounding, as a share of what is compared: no difference up to it counts."""

# defaults for the change of U that counts
SEVERITY_BY = 0.5  # m/s; the rule fails a case whose U rises by more
HARSHER_BY = 0.1  # m/s; a comparison lists a collision as harsher or softer by more
LOSS_BY = 0.01  # instead of both if the evaluation's `severity` makes U a loss in 0..1
_OF_A_LOSS = f"or {LOSS_BY:g} if U is a loss in 0..1"


def change_of_u(setting: float | None, default: float, unit: str) -> float:
    """Change of U that counts, in the unit of U.

    setting: from the gate file; None: the default.
    default: for U in m/s. For a loss the default is `LOSS_BY`.
    unit: of U, empty for a loss.
    """
    if setting is not None:
        return setting
    return default if unit else LOSS_BY


@frozen
class LimitSettings(Checked):
    """One limit: it fails when any of its bounds is passed."""

    quantity: str = required(
        "what is limited: a number of the ADS, or a column of cases.csv in every case"
    )
    ads: str | None = optional("only this ADS; default: each")
    scenario: str | None = optional("only this logical scenario; default: each")
    at_least: float | None = optional("smallest value of the new run")
    at_most: float | None = optional("largest value of the new run")
    worse_by: Annotated[float | None, NotNegative] = optional(
        "largest change for the worse, in the quantity's own unit"
    )
    worse_by_percent: Annotated[float | None, NotNegative] = optional(
        "largest change for the worse, of the base's value", "%"
    )
    tolerance: NotNegativeFloat = setting(
        LAST_DIGIT,
        "how far beyond a bound is only rounding, as a share of the bound (`worse_by`, "
        "`worse_by_percent`: of the base's value), or of 1 if that is larger",
    )
    only_if_certain: bool = setting(
        False,
        "`worse_by` and `worse_by_percent` count only where the interval of the difference "
        "leaves out 0",
    )


@frozen
class MeasureSettings(Checked):
    """A quantity of a case, and the least change that counts as worse or better."""

    quantity: str = required("a column of cases.csv")
    absolute: NotNegativeFloat = required("least change that counts, in the quantity's own unit")
    share: NotNegativeFloat = setting(
        0.0, "least change that counts, as a share of the base's value"
    )
    zone: float | None = optional(
        "near misses only: a case counts if its value in one of the runs is worse than this"
    )
    higher_is_better: bool | None = optional(
        "whether a rise is an improvement; default: by the column"
    )

    @property
    def sign(self) -> float:
        """1 if a rise is an improvement, else -1."""
        known, by_column = self.higher_is_better, self.quantity in HIGHER_COLUMNS
        return 1.0 if (by_column if known is None else known) else -1.0


@frozen
class OutcomeSettings(Checked):
    """Part one of the rule: single cases that ended worse.

    floors, repeats and bad_of: for an ADS that does not repeat bit for bit.
    """

    on: bool = setting(True, "whether this part is evaluated")
    severity_by: Annotated[float | None, NotNegative] = setting(
        None,
        f"rise of U above which a case failed; default: {SEVERITY_BY}, {_OF_A_LOSS}",
        "m/s",
        "U",
        "15",
    )
    floors: NotNegativeFloat = setting(
        2.0, "least rise of U that counts, as a multiple of its floor (`noise.factor`)"
    )
    repeats: Natural = setting(4, "repetitions of a case that became bad")
    bad_of: PositiveInt = setting(3, "of the first drive and its repetitions, how many must be bad")

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.bad_of > self.repeats + 1:  # then no case of such an ADS could fail
            raise InputError(
                f"`bad_of` of [outcome] must be at most `repeats` + 1 = {self.repeats + 1}, the "
                f"number of drives, got {self.bad_of}."
            )


@frozen
class NearMissSettings(Checked):
    """Part two of the rule: whether more cases lost than gained distance to an accident."""

    on: bool = setting(True, "whether this part is evaluated")
    chance: InnerShare = setting(0.1, "P of the sign test below which it fails")
    kept_margin: NotNegativeFloat = setting(
        0.6, "share of its distance to an accident that a case must keep"
    )
    measure: tuple[MeasureSettings, ...] = setting(
        (
            MeasureSettings("min_gap", absolute=0.1, share=0.1, zone=2.0),
            MeasureSettings("min_ttc", absolute=0.1, share=0.1, zone=1.5),
            MeasureSettings("max_drac", absolute=0.2, share=0.05, zone=3.4),
        ),
        "what is watched",
    )


@frozen
class ShiftSettings(Checked):
    """Part three of the rule: whether many cases became a little worse."""

    on: bool = setting(True, "whether this part is evaluated")
    chance: InnerShare = setting(0.02, "P of the sign test below which it fails")
    cases: PositiveInt = setting(3, "least number of worse cases")
    share: Share = setting(0.05, "least share of worse cases")
    share_alone: Share = setting(0.15, "share that fails if no case is better")
    far: NotNegativeFloat = setting(
        5.0,
        "fails if none is better, `cases` are worse, and one by this many tolerances; not of times",
    )
    lost: Share = setting(0.3, "fails if none is better and a case loses this much of its task")
    measure: tuple[MeasureSettings, ...] = setting(
        (
            MeasureSettings("task_share", 0.01),
            MeasureSettings("simulated_time", 0.25, 0.02),
            MeasureSettings("human_likeness", 0.01),
            MeasureSettings("index", 0.01),
            MeasureSettings("overshoot", 0.1),
            MeasureSettings("min_thw", 0.1, 0.1),
            MeasureSettings("max_jerk", 2.0, 0.2),
            MeasureSettings("max_lateral_jerk", 5.0, 0.5),
            MeasureSettings("latency_relative", 2.0, 0.5),
        ),
        "what is watched",
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if zoned := [it.quantity for it in self.measure if it.zone is not None]:
            raise InputError(
                f"Measure `{zoned[0]}` of [shift] must have no `zone`, which only near misses have."
            )


@frozen
class NoiseSettings(Checked):
    """Detection of ADSs that do not repeat bit for bit, and the tolerance for them."""

    cases: Natural = setting(
        30, "cases of an ADS that a night drives twice; 0: each ADS is taken to repeat"
    )
    quantile: InnerShare = setting(0.95, "of the differences between two drives")
    factor: NotNegativeFloat = setting(
        1.5, "floor, the least tolerance, as a multiple of that quantile"
    )
    chance: InnerShare = setting(0.02, "P of all sign tests of a night together (Holm)")


@frozen
class GateSettings(Checked):
    """Comparison of two runs, and the changes that fail it."""

    confidence: InnerShare = setting(0.95, "share that the intervals of differences cover")
    resamples: Annotated[int, Ge(100), Le(1_000_000)] = setting(
        2000, "resamples of the paired bootstrap"
    )
    seed: Natural = setting(1, "of the resampling")
    harsher_by: Annotated[float | None, NotNegative] = setting(
        None,
        f"change of U above which a collision is harsher or softer; default: {HARSHER_BY}, "
        f"{_OF_A_LOSS}",
        "m/s",
        "U",
        "15",
    )
    less_human_by: NotNegativeFloat = setting(
        0.01,
        "change of a case's human-likeness, or of D_i, above which it is less or more human",
        symbol="D_i",
        equation="12",
    )
    lost_share: Share = setting(
        0.1, "share of the base's cases that a night may lose; a lost ADS or scenario always fails"
    )
    outcome: OutcomeSettings = OutcomeSettings()
    near_miss: NearMissSettings = NearMissSettings()
    shift: ShiftSettings = ShiftSettings()
    noise: NoiseSettings = NoiseSettings()
    limit: tuple[LimitSettings, ...] = setting((), "further limits")

    @property
    def watched(self) -> tuple[MeasureSettings, ...]:
        """Quantities of parts two and three."""
        return *self.near_miss.measure, *self.shift.measure


def read_gate(path: Path | None) -> GateSettings:
    """The settings in a gate file; without a file, the defaults.

    Raises InputError for mistakes in the file.
    """
    if path is None:
        return GateSettings()
    settings = read_checked(path, GateSettings, "gate file")
    for number, limit in enumerate(settings.limit, start=1):
        _check(limit, f"`limit` {number} in {path}")
    quantities = (measure.quantity for measure in settings.watched)
    check_known(f"column of a `measure` in {path}", NUMBERS, *quantities)
    return settings


def _check(limit: LimitSettings, where: str) -> None:
    """Raise InputError unless the bounds of a limit fit its quantity.

    where: the limit and its file, for messages.
    """
    check_known(f"quantity of {where}", (*QUANTITIES, *COLUMNS), limit.quantity)
    changes = [by for by in (limit.worse_by, limit.worse_by_percent) if by is not None]
    if not changes and limit.at_least is None and limit.at_most is None:
        raise InputError(
            f"{where} must have at_least, at_most, worse_by or worse_by_percent, got none of them."
        )
    if limit.quantity in OF_THE_COMPARISON and (changes or limit.at_least is not None):
        raise InputError(
            f"{where} must have at_most alone for `{limit.quantity}`, which is a change already."
        )
    if limit.only_if_certain and not (changes and limit.quantity in WITH_INTERVAL):
        raise InputError(
            f"`only_if_certain` of {where} must stand beside worse_by or worse_by_percent of "
            f"{', '.join(WITH_INTERVAL)}; only they have an interval."
        )
