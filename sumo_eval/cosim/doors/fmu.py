"""`fmu:FILE`: an FMU (FMI 2.0 or 3.0, co-simulation) as the ADS, or as the ego's vehicle model. Needs the extra `fmu`.

An input of the FMU is given the signal of the same name, or the one that the mapping names (signals:
`Observation.signals`; of a vehicle model: acceleration and steering of the command). An ADS's outputs are
`acceleration` and, if it steers, `steering`; a vehicle model's are `x`, `y`, `heading`, `speed` and, if it has them,
`acceleration` and `steering_wheel_angle`.
"""

from __future__ import annotations

import functools
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from sumo_eval.cosim.doors.controller import Briefing, ObservingController
from sumo_eval.cosim.doors.observation import Senses, signal_names
from sumo_eval.cosim.vehicle_model import Clipped, Command, EgoState, Pedals
from sumo_eval.errors import InputError, SimulationError, did_you_mean, must_be, said, unknown
from sumo_eval.settings import FmuSettings

SIGNALS = signal_names()
"""What an ADS's inputs can be given; where no vehicle is its gap is 1000 m."""

_SPEED_TOLERANCE = 0.01  # m/s, what a vehicle model may be off the speed of the start
_TYPES = {"Real": "Real", "Float64": "Float64", "Float32": "Float32", "Integer": "Integer", "Int32": "Int32",
          "Int64": "Int64", "Boolean": "Boolean"}  # fmt: skip
_WHOLE = ("Integer", "Int32", "Int64")


class _Fmu:
    """One FMU file and how it is wired; `begin` makes a fresh instance of it."""

    def __init__(
        self, path: Path, wiring: FmuSettings, signals: Sequence[str], needed: Sequence[str], optional: Sequence[str]
    ) -> None:
        self.path = path
        self._library = _fmpy()
        if not path.is_file():
            raise InputError(f"FMU {path}: there is no such file.")
        try:
            self._folder, self.description = _unpacked(path, path.stat().st_mtime_ns)
        except Exception as error:
            raise InputError(f"FMU {path} cannot be read: {said(error)}.") from error
        if self.description.coSimulation is None:
            raise must_be("The FMU", f"`{path.name}`", "one for co-simulation", "one for model exchange only")
        self._variables = {variable.name: variable for variable in self.description.modelVariables}
        self._inputs = self._wire_inputs(wiring, signals)
        self._outputs = self._wire_outputs(wiring, needed, optional)
        self._parameters = self._wire_parameters(wiring)
        self._instance: Any = None

    def _variable(self, name: str, key: str) -> Any:
        if name not in self._variables:
            raise unknown(f"variable of FMU `{self.path.name}` in `{key}`", name, list(self._variables))
        variable = self._variables[name]
        if variable.type not in _TYPES:
            raise must_be(f"`{name}`", f"FMU `{self.path.name}`", f"one of {', '.join(_TYPES)}", variable.type)
        return variable

    def _wire_inputs(self, wiring: FmuSettings, signals: Sequence[str]) -> list[tuple[Any, str]]:
        wired = [(self._variable(name, "inputs"), signal) for name, signal in wiring.inputs.items()]
        for _, signal in wired:
            if signal not in signals:
                raise unknown(f"signal for FMU `{self.path.name}`", signal, signals)
        for name, variable in self._variables.items():
            if variable.causality == "input" and name not in wiring.inputs:
                if name not in signals:
                    raise InputError(
                        f"Input `{name}` of FMU `{self.path.name}` is no signal; `inputs` must map it."
                        f"{did_you_mean(name, signals)}"
                    )
                wired.append((variable, name))
        return wired

    def _wire_outputs(self, wiring: FmuSettings, needed: Sequence[str], optional: Sequence[str]) -> dict[str, Any]:
        known = (*needed, *optional)
        for what in wiring.outputs:
            if what not in known:
                raise unknown(f"output in the mapping of FMU `{self.path.name}`", what, known)
        wired = {what: self._variable(name, "outputs") for what, name in wiring.outputs.items()}
        for what in known:
            found = self._variables.get(what)
            if what not in wired and found is not None and found.causality == "output":
                wired[what] = self._variable(what, "outputs")
            if what in needed and what not in wired:
                raise InputError(
                    f"FMU `{self.path.name}` has no output `{what}`; `outputs` must map it."
                    f"{did_you_mean(what, [n for n, v in self._variables.items() if v.causality == 'output'])}"
                )
        return wired

    def _wire_parameters(self, wiring: FmuSettings) -> list[tuple[Any, float | int | bool | str]]:
        return [(self._variable(name, "parameters"), value) for name, value in wiring.parameters.items()]

    def begin(self, signals: Mapping[str, float]) -> None:
        """Instantiate, set parameters and inputs, initialize at time 0."""
        description = self.description
        kinds = {"2.0": "fmi2.FMU2Slave", "3.0": "fmi3.FMU3Slave"}
        kind = kinds.get(description.fmiVersion)
        if kind is None:
            raise must_be("The FMI version", f"FMU `{self.path.name}`", "2.0 or 3.0", description.fmiVersion)
        module, name = kind.split(".")
        self._instance = fmu = getattr(getattr(self._library, module), name)(
            guid=description.guid,
            unzipDirectory=self._folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="sumo_eval",
        )
        fmu.instantiate()
        if description.fmiVersion == "2.0":
            fmu.setupExperiment(startTime=0.0)
        for variable, value in self._parameters:
            if isinstance(value, str) and value not in signals:
                raise unknown(f"signal for FMU `{self.path.name}`", value, list(signals))
            self._set(variable, signals[value] if isinstance(value, str) else value)
        if description.fmiVersion == "2.0":
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=0.0)
        self._give(signals)
        fmu.exitInitializationMode()

    def step(self, signals: Mapping[str, float], time: float, step: float) -> dict[str, float]:
        """Give the inputs, step from `time` to `time + step`, read the outputs."""
        self._give(signals)
        self._instance.doStep(currentCommunicationPoint=time, communicationStepSize=step)
        return self.read()

    def read(self) -> dict[str, float]:
        """The outputs as they are."""
        fmu = self._instance
        return {
            what: float(getattr(fmu, f"get{_TYPES[variable.type]}")([variable.valueReference])[0])
            for what, variable in self._outputs.items()
        }

    def end(self) -> None:
        """Terminate and free the instance."""
        if self._instance is not None:
            instance, self._instance = self._instance, None
            instance.terminate()
            instance.freeInstance()

    def _give(self, signals: Mapping[str, float]) -> None:
        for variable, signal in self._inputs:
            self._set(variable, signals[signal])

    def _set(self, variable: Any, value: float | int | bool) -> None:
        kind = _TYPES[variable.type]
        plain = bool(value) if kind == "Boolean" else (round(value) if kind in _WHOLE else float(value))
        getattr(self._instance, f"set{kind}")([variable.valueReference], [plain])


@dataclass(slots=True)
class FmuController(ObservingController):
    """An FMU at the wheel."""

    path: Path
    wiring: FmuSettings
    senses: Senses = field(init=False, repr=False)
    _fmu: _Fmu = field(init=False)
    _step: float = 0.0
    _begun: bool = False

    def __post_init__(self) -> None:
        asks = next((name for name in ("speed", "throttle") if self._gives(name)), "acceleration")
        if asks == "throttle":
            self._fmu = _Fmu(self.path, self.wiring, SIGNALS, ("throttle", "brake"), ("steer",))
        else:
            self._fmu = _Fmu(self.path, self.wiring, SIGNALS, (asks,), ("steering",))

    @classmethod
    def from_locator(cls, text: str, folder: Path | None) -> FmuController:
        """`acc.fmu`, or `acc.fmu?inputs.v=ego_speed&outputs.acceleration=a&parameters.headway=1.5`."""
        file, _, query = text.partition("?")
        wiring: dict[str, dict[str, Any]] = {"inputs": {}, "outputs": {}, "parameters": {}}
        for key, value in parse_qsl(query, keep_blank_values=True):
            group, _, name = key.partition(".")
            if group not in wiring or not name:
                raise must_be("A mapping", f"ADS `fmu:{text}`", "inputs.NAME, outputs.NAME or parameters.NAME", key)
            wiring[group][name] = _number(value) if group == "parameters" else value
        return cls((folder or Path.cwd()) / file, FmuSettings(**wiring))

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """A fresh instance of the FMU is made at the first step, which knows the signals."""
        self._step, self._begun = scenario.period, False

    def step(self, traci: Any, ego: str, time: float) -> Command | Pedals:
        """One step of the FMU: what is seen goes in, the command comes out."""
        signals = self.senses.observe().signals()
        if not self._begun:
            self._begun = True
            self._fmu.begin(signals)
        answer = self._fmu.step(signals, time, self._step)
        return Command.pedals(**answer) if "throttle" in answer else Command(**answer)

    def _gives(self, name: str) -> bool:
        """Whether the mapping has an output of this name, where it has no acceleration."""
        return name in self.wiring.outputs and "acceleration" not in self.wiring.outputs

    def close(self) -> None:
        """Free the instance."""
        self._fmu.end()


class FmuPlant:
    """An FMU as the ego's vehicle model: commands in, pose and speed of the vehicle's centre out.

    Positions and heading count from where the FMU starts, so it may start at its own origin; its speed is the case's.
    """

    def __init__(self, wiring: FmuSettings, file: str, folder: Path | None) -> None:
        signals = ("acceleration", "steering", "x", "y", "heading", "speed", "time")
        outputs = ("acceleration", "steering_wheel_angle")
        path = (folder or Path.cwd()) / file
        self._fmu = _Fmu(path, wiring, signals, ("x", "y", "heading", "speed"), outputs)
        self._offset: dict[str, float] | None = None
        self._time = 0.0

    def advance(self, state: EgoState, command: Command, step: float) -> tuple[EgoState, tuple[Clipped, ...]]:
        """The state one step later."""
        signals = {
            "acceleration": command.acceleration, "steering": command.steering, "time": self._time,
            "x": state.x, "y": state.y, "heading": state.heading, "speed": state.speed,
        }  # fmt: skip
        try:
            if self._offset is None:
                self._fmu.begin(signals)
                first = self._fmu.read()
                if abs(first["speed"] - state.speed) > _SPEED_TOLERANCE:
                    raise SimulationError(
                        f"The vehicle model {self._fmu.path.name} must start at {state.speed:g} m/s, got "
                        f"{first['speed']:g}; map a parameter of it to `speed`."
                    )
                self._offset = {name: getattr(state, name) - first[name] for name in ("x", "y", "heading")}
            found = self._fmu.step(signals, self._time, step)
        except SimulationError:
            raise
        except Exception as error:
            raise SimulationError(f"The vehicle model {self._fmu.path.name} failed: {said(error)}.") from error
        self._time += step
        if not all(math.isfinite(value) for value in found.values()):
            raise SimulationError(f"The vehicle model {self._fmu.path.name} must give finite numbers, got {found}.")
        pose = {name: found[name] + self._offset[name] for name in ("x", "y", "heading")}
        gained = found.get("acceleration", (found["speed"] - state.speed) / step)
        wheel = found.get("steering_wheel_angle", command.steering)
        return EgoState(**pose, speed=found["speed"], acceleration=gained, steering_wheel_angle=wheel), ()

    def close(self) -> None:
        """Free the instance."""
        self._fmu.end()


def _number(text: str) -> float | str:
    """A number or a truth value as a locator has it; anything else is a signal's name."""
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text)
    except ValueError:
        return text.strip('"')


def _fmpy() -> Any:
    try:
        import fmpy
        import fmpy.fmi2
        import fmpy.fmi3
    except ImportError as error:
        raise InputError("An FMU needs the extra `fmu`: pip install 'sumo_eval[fmu]'.") from error
    return fmpy


_unpack_folders: list[tempfile.TemporaryDirectory[str]] = []


@functools.lru_cache(maxsize=16)
def _unpacked(path: Path, _changed: int) -> tuple[str, Any]:
    """The folder into which an FMU was unpacked, once a process, and its model description."""
    import fmpy

    folder = tempfile.TemporaryDirectory(prefix="sumo_eval_fmu_")
    _unpack_folders.append(folder)  # removed when the process ends
    fmpy.extract(str(path), unzipdir=folder.name)
    return folder.name, fmpy.read_model_description(str(path))
