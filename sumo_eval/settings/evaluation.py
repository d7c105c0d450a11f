"""Settings of an evaluation, the content of evaluation.toml: its scenarios, their samples and
exposures, its ADSs, and the tables of the other files of this folder.

Users: `cli/`, `drivers/`, `evaluation.py`, `record/`, `report/`, `results.py`, `scenario/`,
`scoring/`, `settings/`, `extras/`.
"""

from json import dumps
from typing import Annotated, Any, Literal
from urllib.parse import urlencode

from annotated_types import Ge

from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen, required
from sumo_eval.settings.checked import (
    Checked,
    FilledText,
    Natural,
    PositiveFloat,
    PositiveOrNone,
    empty_table,
    optional,
    setting,
)
from sumo_eval.settings.drivers import DriverSettings
from sumo_eval.settings.method import MethodSettings
from sumo_eval.settings.report import ReportSettings
from sumo_eval.settings.run import RunSettings
from sumo_eval.settings.simulation import FmuSettings, SimulationSettings
from sumo_eval.text import clean

_Levels = Annotated[int, Ge(2)]


@frozen
class SamplingSettings(Checked):
    """Choice of the concrete scenarios of a space that are simulated."""

    method: str | None = optional(
        "how points are chosen: grid, pairwise, combinations, latin_hypercube, sobol, halton, "
        "exposure, exposure_danger, adaptive, file, openscenario, module:name, or a sample "
        "that the scenario names; default: the scenario's own",
    )
    levels: _Levels | dict[str, _Levels] | None = optional(
        "points on each axis, one number or by parameter; default: the space's steps"
    )
    steps: dict[str, PositiveFloat] | None = optional(
        "step by parameter name; others keep the space's own"
    )
    count: Annotated[int | None, Ge(1)] = optional(
        "number of points, for methods that draw them; the most points of `adaptive`"
    )
    strength: Annotated[int | None, Ge(1)] = optional(
        "of `combinations`: t; for any t parameters, all combinations of values occur"
    )
    file: str | None = optional("CSV of points, or mapping of an OpenSCENARIO variation")
    round: Annotated[int | None, Ge(1)] = optional(
        "of `adaptive`: points of a round; default: a fifth of `count`"
    )
    aim: Literal["s_plus", "boundary"] | None = optional(
        "of `adaptive`: what new points make more certain: S+ (default), or the boundary "
        "between collisions and none, i.e. the share of the space that collides",
    )
    until: PositiveOrNone = optional(
        "of `adaptive`: no further round once half the width of every ADS's 95 % interval, of "
        "what `aim` names, is at most this; default: all of `count`",
        "points of S+, or share of the space",
    )
    rounds: tuple[tuple[int, ...], ...] = setting(
        (), "filled in by `adaptive`: for each round, numbers of points from each cell"
    )

    def default_method(self, of_scenario: str) -> str:
        """The method where none is named: the grid where levels or steps are given, the file where
        one is given, else the scenario's.
        """
        if self.levels or self.steps:
            return "grid"
        return of_scenario if self.file is None else "file"


@frozen
class DeclaredDistribution(Checked):
    """Declared distribution of one parameter on the road."""

    distribution: Literal["normal", "lognormal", "uniform"] = required("which family")
    first: float = required("normal: mean; lognormal: mean of the logarithm; uniform: lowest value")
    second: float = required(
        "normal: standard deviation; lognormal: that of the logarithm; uniform: highest value"
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        least, words = 0.0, "0"
        if self.distribution == "uniform":
            least, words = self.first, f"`first` ({self.first:g})"
        if not self.second > least:
            owner = f"a {self.distribution} distribution"
            raise must_be("`second`", owner, f"greater than {words}", self.second)


@frozen
class ExposureSettings(Checked):
    """Frequency of the concrete scenarios of a space on the road: p_i of Eq. 13."""

    kind: Literal["scenario", "uniform", "recorded", "declared"] = setting(
        "scenario",
        "the scenario's own, uniform, from recorded events, or declared",
        symbol="p_i",
        equation="13",
    )
    recordings: tuple[str, ...] = setting(
        (), "canonical tables of recorded driving; none: those of the drivers"
    )
    bandwidth: Literal["scott", "cross_validated"] = setting(
        "scott", "bandwidth of the KDE over recorded events"
    )
    declared: dict[str, DeclaredDistribution] | None = optional(
        "distribution by parameter; others are uniform"
    )


@frozen
class ScenarioSettings(Checked):
    """One logical scenario of an evaluation."""

    use: str = required(
        "a shipped name, a scenario file (.toml, .xosc), module:name, suite:NAME, or a "
        "catalogue: osc_alks, ncap_2026"
    )
    sampling: SamplingSettings = SamplingSettings()
    exposure: ExposureSettings = ExposureSettings()
    folder: str | None = optional("of a catalogue: where your copy of it is")
    not_played: dict[str, str] = empty_table(
        "filled in for a catalogue: its files that are not supported, and why"
    )


@frozen
class AdsSettings(Checked):
    """One ADS under test."""

    name: FilledText = required("what the tables call it")
    controller: str = required(
        "a shipped name, module:name, file.py:name, sumo:MODEL, exec:COMMAND, traci:COMMAND, "
        "fmu:FILE or onnx:FILE"
    )
    fmu: FmuSettings | None = optional("variables of the FMU, where the controller is one")

    period: PositiveOrNone = optional(
        "time between calls, in which the last answer stays in force; default: a time step",
        "s",
    )
    batch: bool = setting(
        True, "whether its cases may share a simulation; false: its objects share state"
    )
    options: dict[str, Any] = empty_table(
        "keyword arguments of the class; an `exec:` program receives them in its reset"
    )
    files: tuple[str, ...] = setting(
        (), "files that it depends on, such as weights; if one changes, its cases are rerun"
    )
    build: str = setting(
        "", "which build it is, for readers; default: the Git commit of its folder"
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        object.__setattr__(self, "name", clean(self.name))
        object.__setattr__(self, "build", clean(self.build))

    @property
    def locator(self) -> str:
        """The controller with its period, batch, options and FMU variables as one text, which
        names it in facts: `fmu:acc.fmu?inputs.v=ego_speed`.

        `files` are not in it, but in the fingerprint of a drive. `build` is information only.
        """
        # defaults are left out; values are JSON, and plain text names variables
        pairs = [] if self.period is None else [("period", dumps(self.period))]
        pairs += [] if self.batch else [("batch", "false")]
        pairs += [(f"options.{name}", dumps(value)) for name, value in self.options.items()]
        if self.fmu is not None:
            pairs += [
                (f"{group}.{name}", value if isinstance(value, str) else dumps(value))
                for group in ("inputs", "outputs", "parameters")
                for name, value in getattr(self.fmu, group).items()
            ]
        if not pairs:
            return self.controller
        # a controller may have a query of its own
        return f"{self.controller}{'&' if '?' in self.controller else '?'}{urlencode(pairs)}"


@frozen
class EvaluationSettings(Checked):
    """Everything an evaluation depends on: the content of evaluation.toml, defaults filled in."""

    name: FilledText = required("name of the evaluation")
    scenario: tuple[ScenarioSettings, ...] = required("logical scenarios")
    ads: tuple[AdsSettings, ...] = setting((), "ADSs under test; none where `--ads` names them")
    seed: Natural = setting(1, "the only source of randomness")
    drivers: DriverSettings = DriverSettings()
    run: RunSettings = RunSettings()
    simulation: SimulationSettings = SimulationSettings()
    method: MethodSettings = MethodSettings()
    report: ReportSettings = ReportSettings()

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        object.__setattr__(self, "name", clean(self.name))
