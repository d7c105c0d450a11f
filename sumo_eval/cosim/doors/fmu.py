"""`fmu:FILE`: an FMU (FMI 2.0 or 3.0, co-simulation) as the ADS, or as the ego's vehicle model.

Needs the extra `fmu`. The mapping is `FmuSettings` or `PlantSettings`.

Inputs: the mapping gives each input a signal, a constant or its own start value. A number without a
mapping takes the signal of its name. An array takes one value of each seen vehicle (`OBJECTS`).
- Signals of an ADS: `Observation.signals`.
- Signals of a vehicle model: `acceleration` and `steering` of the command, `x`, `y`, `heading` and
  `speed` before the step, `time`.

Outputs:
- Of an ADS: `acceleration` and optionally `steering`. If the mapping names one of these instead:
  `speed` and `steering`; `throttle`, `brake` and `steer`; a plan (`PLAN`).
- Of a vehicle model: `x`, `y`, `heading`, `speed`, optionally `acceleration` and
  `steering_wheel_angle`.

Users: `cosim/ego_control.py`, `cosim/simulation.py`, `record/recording.py`;
`cosim/doors/controller.py` finds `FmuController` by name (`DOORS`).
"""

from __future__ import annotations

import cmath
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isfinite, prod
from pathlib import Path
from typing import Any

from sumo_eval.cosim.doors.controller import Adapter, Briefing
from sumo_eval.cosim.doors.entry import read_query
from sumo_eval.cosim.doors.fmu_file import open_fmu
from sumo_eval.cosim.doors.observation import (
    KINDS,
    NO_LEAD_GAP,
    Observation,
    SeenVehicle,
    signal_names,
)
from sumo_eval.cosim.plans import Plan
from sumo_eval.cosim.vehicle_model import Command, EgoState
from sumo_eval.errors import (
    ControllerError,
    InputError,
    SimulationError,
    SumoEvalError,
    check_known,
    did_you_mean,
    must_be,
    said,
)
from sumo_eval.scenario.units import si_factor
from sumo_eval.settings import FmuSettings, PlantSettings

_Names = Sequence[str]  # of signals or outputs
_STATE = ("x", "y", "heading", "speed")  # outputs that a vehicle model must have
_SPEED_TOLERANCE = 0.01  # m/s, between a vehicle model's first speed and the case's: rounding only
_MAKERS: Mapping[str, Callable[[Any], Any]] = {
    "Real": float, "Float32": float, "Float64": float, "Boolean": bool, "String": str,
    "Binary": lambda value: str(value).encode(),
}  # fmt: skip
"""Types other than whole numbers -> function that makes a value of the type."""
_WHOLE = {"Integer": 32, "Enumeration": 32} | {
    f"{sign}Int{bits}": bits for sign in ("", "U") for bits in (8, 16, 32, 64)
}
"""Types of whole numbers -> bits."""
_TEXTS = ("String", "Binary")
_TYPES = (*_MAKERS, *_WHOLE)
_STATUS = dict(enumerate(("OK", "WARNING", "DISCARD", "ERROR", "FATAL", "PENDING")))
_FATAL = 4  # fmi2Fatal, fmi3Fatal
AS_IT_STARTS = "start"
"""Value of a mapping, instead of a signal, for an input that keeps its start value.

`inputs.*=start`: every input without a mapping keeps it.
"""
OBJECTS = (
    "objects_present",
    *(f"objects_{name}" for name in SeenVehicle._fields if name != "number"),
)
"""Signals for inputs that are arrays: a value of each vehicle that is seen, the nearest first."""
PLAN = ("plan_time", "plan_x", "plan_y", "plan_heading", "plan_speed")
"""Outputs of an FMU that gives plans: arrays, or in FMI 2.0 scalars `NAME[1]`, `NAME[2]`, ...; the
last two may be missing."""
_OF_A_PLAN = ("plan_count", "plan_number")
"""Further outputs that such an FMU may have: how many elements of the arrays the plan fills, and a
number that changes with each new plan."""

Wired = tuple[Any, str | float]
"""A variable of the FMU, and the name of its signal or its constant (a text variable has only
constants)."""
Signals = Mapping[str, float | list[float]]


class _Fmu:
    """One FMU file and its wiring; `load` makes a fresh instance of it.

    wiring: the mapping of its inputs, outputs and parameters.
    signals: names of the signals that its inputs may take.
    needed, optional: names of outputs that are one number, which it must or may have.
    lists: names of outputs that are many numbers.
    """

    def __init__(
        self, path: Path, wiring: FmuSettings, signals: _Names, needed: _Names,
        optional: _Names, lists: _Names = (),
    ) -> None:  # fmt: skip
        self.path, self._signals = path, signals
        self._library, self._folder, model = open_fmu(path)
        self.description = model
        # name of a unit of the FMU -> its size in SI units
        self._factors: dict[Any, float] = {
            unit.name: unit.baseUnit.factor for unit in model.unitDefinitions if unit.baseUnit
        }
        self._variables = {variable.name: variable for variable in model.modelVariables}
        self._inputs = self._wire_inputs(wiring)
        self._outputs = self._wire_outputs(wiring, needed, optional, lists)
        self.lists = self._wire_lists(wiring, lists)
        self._parameters = list(self._wired(wiring.parameters, "parameters"))
        self._instance: Any = None
        self.initialized = False
        self._reported = set[str]()  # unknown units that the log of this drive names

    def _variable(self, name: str, key: str) -> Any:
        """The variable of a name in the table `key` of the mapping. Raises InputError for an
        unknown name, or a variable that `key` does not allow. An output must be a number.
        """
        owner = f"FMU `{self.path.name}`"
        check_known(f"variable of {owner} in `{key}`", self._variables, name)
        variable = self._variables[name]
        if variable.type not in _TYPES:
            raise must_be(f"`{name}`", owner, f"one of {', '.join(_TYPES)}", variable.type)
        if not _may_be(variable, key):
            got = f"a {variable.variability} {variable.causality}"
            raise must_be(f"`{name}`", owner, f"one of its {key} that can be set", got)
        if key == "outputs" and variable.type in _TEXTS:
            raise must_be(f"The output `{name}`", owner, "a number", variable.type)
        return variable

    def _wire_inputs(self, wiring: FmuSettings) -> list[Wired]:
        """The inputs that take a signal or a constant. Raises InputError if one has no mapping."""
        rest = wiring.inputs.get("*")
        if rest not in (None, AS_IT_STARTS):
            raise must_be("`inputs.*`", f"FMU `{self.path.name}`", f"`{AS_IT_STARTS}`", rest)
        inputs = [name for name, it in self._variables.items() if it.causality == "input"]
        # a number without a mapping takes the signal of its name
        numbers = (name for name in inputs if self._variables[name].type not in _TEXTS)
        mapping = {**{name: name for name in numbers if name in self._signals}, **wiring.inputs}
        mapping.pop("*", None)
        wired = list(self._wired(mapping, "inputs"))
        unmapped = [name for name in inputs if name not in mapping]
        if unmapped and rest is None:
            name = unmapped[0]
            is_text = self._variables[name].type in _TEXTS
            raise InputError(
                f"Input `{name}` of FMU `{self.path.name}` is "
                f"{'a text' if is_text else 'not a signal'}; `inputs` must map it. A number is a "
                f"constant, `{AS_IT_STARTS}` its start value "
                f"(`inputs.*={AS_IT_STARTS}`: of all that are left)."
                f"{did_you_mean(name, () if is_text else self._signals)}"
            )
        return wired

    def _wired(self, mapping: Mapping[str, str | float], key: str) -> Iterator[Wired]:
        """Inputs or parameters (`key`), and the signal or constant of each; without the inputs that
        keep their start values.
        """
        for name, value in mapping.items():
            variable = self._variable(name, key)
            if key == "inputs" and value == AS_IT_STARTS:
                continue
            if variable.type not in _TEXTS:
                value = _number(value)
                self._check_given(variable, value, key)
            yield variable, value

    def _check_given(self, variable: Any, signal: str | float, key: str) -> None:
        """Raise InputError for a constant or signal that does not fit the type and size of a
        variable.

        key: `inputs` or `parameters`.
        """
        name, owner = f"`{variable.name}`", f"FMU `{self.path.name}`"
        is_array = _count(variable) is not None
        if isinstance(signal, float):  # a constant
            if not isfinite(signal) or _plain(variable.type, signal) != signal:
                raise must_be(name, owner, f"finite and of type {variable.type}", signal)
        elif is_array and key == "inputs" and signal not in OBJECTS:
            must = f"given one of {', '.join(OBJECTS)}, as it is an array"
            raise must_be(name, owner, must, signal)
        elif signal in OBJECTS and not is_array:
            raise must_be(name, owner, f"an array to be given `{signal}`", "one number")
        else:
            check_known(f"signal for {owner}", self._signals, signal)

    def _wire_outputs(
        self, wiring: FmuSettings, needed: _Names, optional: _Names, lists: _Names
    ) -> dict[str, tuple[Any, int]]:
        """The outputs that are one number, as of `_output`, by name.

        Arguments as of the class.
        """
        names = (*needed, *optional)
        owner = f"FMU `{self.path.name}`"
        check_known(f"output in the mapping of {owner}", (*names, *lists), *wiring.outputs)
        outputs = [name for name, it in self._variables.items() if it.causality == "output"]
        wired = {}
        for name in names:
            if name in (*wiring.outputs, *outputs):
                wired[name] = self._output(wiring.outputs.get(name, name))
            elif name in needed:
                raise InputError(
                    f"{owner} has no output `{name}`; `outputs` must map it."
                    f"{did_you_mean(name, outputs)}"
                )
        return wired

    def _wire_lists(self, wiring: FmuSettings, lists: _Names) -> dict[str, list[Any]]:
        """Outputs that are many numbers: an array, or scalars `NAME[1]`, `NAME[2]`, ..."""
        wired = {}
        for output in lists:
            name = wiring.outputs.get(output, output)
            names = [name] if name in self._variables else _scalars(self._variables, name)
            if names:
                wired[output] = [self._variable(it, "outputs") for it in names]
            elif output in wiring.outputs or output in PLAN[:3]:  # a plan needs time, x and y
                raise InputError(
                    f"FMU `{self.path.name}` has no output `{name}`, nor `{name}[1]`, for "
                    f"`{output}`; `outputs` must map it.{did_you_mean(name, self._variables)}"
                )
        return wired

    def _output(self, name: str) -> tuple[Any, int]:
        """An output, and the index of the value that is read: `name`, or `name[2]` of an array.

        Indices count from 0. A variable that is itself called `name[2]` comes first.
        """
        what, owner = f"The output `{name}`", f"FMU `{self.path.name}`"
        array, bracket, rest = name.partition("[")
        if not bracket or name in self._variables:
            variable = self._variable(name, "outputs")
            if _count(variable) is not None:
                raise must_be(what, owner, f"one value, `{name}[0]`", "an array")
            return variable, 0

        variable = self._variable(array, "outputs")
        size = _count(variable) or 1
        index = rest.rstrip("]")
        if not (index.isdecimal() and int(index) < size):
            raise must_be(what, owner, f"within its {size} values", index)
        return variable, int(index)

    def load(self) -> None:
        """Load the library and make an instance for another drive."""
        self._reported.clear()
        with self._in_words():
            self._instance = self._library.instantiate_fmu(
                self._folder, self.description, "CoSimulation", logger=_log
            )

    def begin(self, signals: Signals) -> None:
        """Set parameters and inputs, initialize at time 0."""
        with self._in_words():
            if self.description.fmiVersion == "2.0":
                self._instance.setupExperiment()
            self._give(self._parameters, signals)
            self._instance.enterInitializationMode()
            self._give(self._inputs, signals)
            self._instance.exitInitializationMode()
        self.initialized = True

    def step(self, signals: Signals, time: float, step: float) -> dict[str, float]:
        """Give the inputs, step from `time` to `time + step`, read the outputs."""
        with self._in_words():
            self._give(self._inputs, signals)
            flags = self._instance.doStep(
                currentCommunicationPoint=time, communicationStepSize=step
            )
        # of FMI 3: 0: `eventEncountered`, 1: `terminateSimulation`, 2: `earlyReturn`,
        # 3: `lastSuccessfulTime`
        if isinstance(flags, tuple) and any(flags[1:3]):
            deed = "asked to end the simulation" if flags[1] else "ended its step early"
            raise ControllerError(f"FMU `{self.path.name}` {deed}")
        return self.read(self._outputs)

    def read(self, names: Iterable[str]) -> dict[str, float]:
        """The outputs of these names, all of them finite."""
        outputs = {}
        for name in names:
            variable, index = self._outputs[name]
            outputs[name] = self._values([variable])[index] * self._factor(variable)
        if not all(map(isfinite, outputs.values())):
            raise ControllerError(f"FMU `{self.path.name}` must give finite numbers, got {outputs}")
        return outputs

    def read_lists(self) -> dict[str, list[float]]:
        """The outputs that are many numbers."""
        return {
            name: [value * self._factor(variables[0]) for value in self._values(variables)]
            for name, variables in self.lists.items()
        }

    def _values(self, variables: Sequence[Any]) -> Sequence[Any]:
        """Values of scalars of one type, or of one array."""
        first = variables[0]
        get = getattr(self._instance, f"get{self._kind(first)}")
        count = _count(first)
        references = [variable.valueReference for variable in variables]
        with self._in_words():
            return list(get(references) if count is None else get(references, count))

    @property
    def sees_objects(self) -> bool:
        """Whether an input is given a value of each vehicle."""
        return any(signal in OBJECTS for _, signal in (*self._inputs, *self._parameters))

    def end(self) -> None:
        """Terminate and free the instance."""
        if self._instance is not None:
            instance = self._instance
            self._instance = None
            if self.initialized:  # an FMU may crash if terminated before its initialization
                self.initialized = False
                instance.terminate()
            instance.freeInstance()

    def _factor(self, variable: Any) -> float:
        """Factor from the unit of a variable, or of its type, to the SI unit."""
        unit = variable.unit or getattr(variable.declaredType, "unit", None) or ""
        # a unit that the FMU does not describe is known by its name
        factor = self._factors.get(unit) or si_factor(unit)
        if factor is None and unit not in self._reported:
            self._reported.add(unit)
            fmu = f"FMU `{self.path.name}`"
            print(f"{fmu}: unit `{unit}` is not known, SI is assumed.")  # noqa: T201
        return factor or 1.0

    def _kind(self, variable: Any) -> str:
        """Type of a variable in the names of the FMU's get and set functions."""
        if variable.type == "Enumeration":
            return "Integer" if self.description.fmiVersion == "2.0" else "Int64"
        return str(variable.type)

    def _give(self, wired: Sequence[Wired], signals: Signals) -> None:
        """Set variables to their constants, or to the values of their signals."""
        for variable, signal in wired:
            if variable.type in _TEXTS or isinstance(signal, float):  # a constant
                self._set(variable, signal)
            else:
                self._set(variable, signals[signal], self._factor(variable))

    def _set(self, variable: Any, value: Any, factor: float = 1.0) -> None:
        """Set a variable to a value, or an array to a value of each vehicle.

        factor: of `_factor`, for a value in SI units.
        """
        count = _count(variable)
        size = 1 if count is None else count
        values = [value] * size
        if isinstance(value, list):  # its last value, of an empty place, fills the rest of an array
            values = [*value, *(value[-1:] * size)][:size]
        for place, it in enumerate(values):
            values[place] = _plain(variable.type, it if factor == 1.0 else it / factor)
            if values[place] is None:
                raise ControllerError(
                    f"`{variable.name}` of FMU `{self.path.name}` is of type {variable.type}, "
                    f"which cannot hold {it:g}"
                )
        getattr(self._instance, f"set{self._kind(variable)}")([variable.valueReference], values)

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """Context for calls of the instance: turns their errors into ControllerErrors.

        After an error the instance may only be freed, after a fatal one not even that.
        """
        try:
            yield
        except SumoEvalError:
            raise
        except Exception as error:
            self.initialized = False
            if getattr(error, "status", None) == _FATAL:
                self._instance = None
            # without the folder, which differs in each process
            words = said(error).replace(f"{self._folder}/", "")
            raise ControllerError(f"FMU `{self.path.name}` failed: {words}") from error


def _log(*words: Any) -> None:
    """Print a message of an FMU, in any encoding.

    words: arguments of FMI's callback, of which the last are status, category and text.
    """
    status, _, text = words[-3:]
    print(f"[{_STATUS.get(status, status)}] {(text or b'').decode(errors='replace')}")  # noqa: T201


def _plain(kind: str, value: Any) -> Any:
    """A value as a type of FMI, whole numbers rounded; None: the type cannot hold it."""
    if kind in _MAKERS:
        return _MAKERS[kind](value)
    if not isfinite(value):  # `change_by` of an ego that may keep its lane
        return None
    whole = round(value)
    span = 1 << _WHOLE[kind]
    low = 0 if kind.startswith("U") else -span // 2
    return whole if low <= whole < low + span else None


def _may_be(variable: Any, key: str) -> bool:
    """Whether a variable may be in the table `key` of a mapping."""
    kind = variable.causality
    if key == "parameters":  # also start values, but no sizes of arrays (structural parameters)
        at_start = variable.initial in ("exact", "approx")
        return at_start and kind not in ("input", "structuralParameter")
    return key == "outputs" or kind == "input" or variable.variability == "tunable"


def _scalars(variables: Mapping[str, Any], name: str) -> list[str]:
    """Names of the variables `NAME[1]`, `NAME[2]`, ..., in the order of their numbers."""
    numbers = {}  # by name of the variable
    for full in variables:
        number = full[len(name) + 1 : -1]
        if full.startswith(f"{name}[") and number.isdecimal():
            numbers[full] = int(number)
    return sorted(numbers, key=numbers.__getitem__)


def _count(variable: Any) -> int | None:
    """Number of values of an array; None: it is not an array."""
    return prod(variable.shape) if variable.dimensions else None


def _objects(seen: Observation) -> dict[str, list[float]]:
    """Values of each vehicle that is seen, the nearest first, then those of an empty place."""
    # present, then the fields of `SeenVehicle` without its number, in the order of `OBJECTS`
    rows = [(1, *it[1:-1], KINDS[it.kind]) for it in seen.vehicles]
    empty = {"objects_gap": NO_LEAD_GAP, "objects_kind": -1}  # the other values are 0
    rows.append(tuple(empty.get(name, 0) for name in OBJECTS))
    columns = (list(map(float, column)) for column in zip(*rows, strict=True))
    return dict(zip(OBJECTS, columns, strict=True))


@dataclass(slots=True)
class FmuController(Adapter):
    """An FMU as the ADS."""

    path: Path
    wiring: FmuSettings
    _fmu: _Fmu = field(init=False)
    _period: float = 0.0  # s from one call to the next, the length of the FMU's steps
    _plan_number: float | None = None  # of the plan in force
    is_policy = True

    def __post_init__(self) -> None:
        # the first of these outputs that is mapped decides the kind of the ADS's answers
        kinds = ("acceleration", "speed", "throttle", *PLAN)
        kind = next((name for name in kinds if name in self.wiring.outputs), kinds[0])
        outputs: tuple[_Names, ...] = (kind,), ("steering",)
        if kind in PLAN:
            outputs = (), _OF_A_PLAN, PLAN
        elif kind == "throttle":
            outputs = ("throttle", "brake"), ("steer",)
        self._fmu = _Fmu(self.path, self.wiring, (*signal_names(), *OBJECTS), *outputs)

    @classmethod
    def from_locator(cls, text: str, folder: Path) -> FmuController:
        """`acc.fmu`, or
        `acc.fmu?inputs.v=ego_speed&outputs.acceleration=a&parameters.headway=1.5`.
        """
        file, _, query = text.partition("?")
        wiring: dict[str, dict[str, Any]] = {"inputs": {}, "outputs": {}, "parameters": {}}
        pairs = read_query(query, f"ADS `fmu:{text}`", "inputs.NAME=SIGNAL&outputs.NAME=NAME")
        for key, value in pairs.items():
            group, _, name = key.partition(".")
            if group not in wiring or not name:
                raise must_be(
                    "A mapping",
                    f"ADS `fmu:{text}`",
                    "inputs.NAME, outputs.NAME or parameters.NAME",
                    key,
                )
            wiring[group][name] = value.strip("\"'")
        return cls(folder / file, FmuSettings(**wiring))

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Make a fresh instance; the first step initializes it, as the signals are known then."""
        self._period = scenario.period
        self._plan_number = None
        self._fmu.load()

    def act(self, seen: Observation) -> Any:
        """One step of the FMU: the observation goes in, the command comes out."""
        fmu = self._fmu
        signals = seen.signals() | (_objects(seen) if fmu.sees_objects else {})
        if not fmu.initialized:
            fmu.begin(signals)
        answer = fmu.step(signals, seen.time, self._period)
        if fmu.lists:
            return self._planned(answer)
        return Command.pedals(**answer) if "throttle" in answer else Command(**answer)

    def _planned(self, answer: Mapping[str, float]) -> Any:
        """The outputs as a Plan; None while `plan_number` stays the same: the last plan holds.

        Without `plan_number` each answer is a new plan.

        answer: the outputs that are one number.
        """
        number = answer.get("plan_number")
        if number is not None and number == self._plan_number:
            return None
        self._plan_number = number
        lists = self._fmu.read_lists()
        most = min(len(values) for values in lists.values())
        count = answer.get("plan_count", most)
        if not 1.0 <= count <= most:
            raise ControllerError(
                f"`plan_count` of FMU `{self.path.name}` must be within 1 and {most}, the places "
                f"that it has, got {count:g}"
            )
        return Plan(*(lists[name][: round(count)] if name in lists else None for name in PLAN))

    def close(self) -> None:
        """Free the instance."""
        self._fmu.end()


class FmuPlant:
    """An FMU as the ego's vehicle model: commands in, pose and speed of the vehicle's centre out.

    The FMU may start at an origin and in a direction of its own: its poses are moved and turned so
    that they start at the ego's. Its first speed must be the ego's.
    """

    def __init__(self, wiring: PlantSettings, folder: Path | None) -> None:
        signals = ("acceleration", "steering", *_STATE, "time")
        outputs = ("acceleration", "steering_wheel_angle")
        folder = folder or Path.cwd()
        self._fmu = _Fmu(folder / wiring.file, wiring, signals, _STATE, outputs)
        self._offset: tuple[complex, float] | None = None  # x + y i, m, and heading, rad
        self._time = 0.0

    def advance(self, state: EgoState, command: Command, step: float) -> EgoState:
        """The state one step later."""
        fmu = self._fmu
        signals = state._asdict() | {
            "acceleration": command.acceleration, "steering": command.steering, "time": self._time,
        }  # fmt: skip
        try:
            if self._offset is None:
                fmu.load()
                fmu.begin(signals)
                first = fmu.read(_STATE)  # an FMU may have no acceleration before its first step
                if abs(first["speed"] - state.speed) > _SPEED_TOLERANCE:
                    raise SimulationError(
                        f"The vehicle model {fmu.path.name} must start at {state.speed:g} "
                        f"m/s, got {first['speed']:g}; map a parameter of it to `speed`."
                    )
                turn = state.heading - first["heading"]
                self._offset = complex(state.x, state.y) - _turned(first, turn), turn
            outputs = fmu.step(signals, self._time, step)
        except ControllerError as error:
            raise SimulationError(f"The vehicle model: {error}.") from error
        self._time += step
        offset, turn = self._offset
        position = _turned(outputs, turn) + offset
        motion = {
            "acceleration": (outputs["speed"] - state.speed) / step,
            "steering_wheel_angle": command.steering,
        }
        placed = {"x": position.real, "y": position.imag, "heading": outputs["heading"] + turn}
        return EgoState(**motion | outputs | placed)

    def close(self) -> None:
        """Free the instance."""
        self._fmu.end()


def _turned(outputs: Mapping[str, float], turn: float) -> complex:
    """Position x + y i, m, of a vehicle model, turned by `turn`, rad, about the model's origin."""
    return complex(outputs["x"], outputs["y"]) * cmath.rect(1.0, turn)


def _number(text: str | float) -> float | str:
    """A number, or a truth value as 0 or 1, also from text; else the text, a signal's name."""
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text)
    except ValueError:
        return str(text).strip("\"'")
