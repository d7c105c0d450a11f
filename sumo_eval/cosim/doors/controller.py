"""The ADS door: what a controller is, and how a locator such as `idm`, `module:name` or
`exec:./my_ads` becomes a controller.

A controller with TraCI is a function `(traci, ego, time)` or an object with `step(traci, ego,
time)`; `reset(scenario, traci, ego)` and `close()` are optional. `traci` is the running simulation,
so TraCI code works unchanged; `ego` is the ego's vehicle id; `time` is s since the start of the
case (SUMO's own clock is ahead by the step that inserted the vehicles). A step returns a `Command`
for the harness's vehicle model, or None if the code has commanded SUMO itself.

A controller without TraCI is a function `(observation)`, or an object with `act(observation)`. A
`traci.StepListener` is a controller too. These calls, locators and messages are the contract with
users (docs/ads).

Users: `cli/tools.py`, `cosim/`, `record/`, `extras/studies/qualification/`.
"""

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, isnan, nan
from pathlib import Path
from typing import Any, Protocol, cast

from sumo_eval.cosim.doors.entry import (
    ENTRY_FORM,
    PLAIN,
    Entry,
    check_options,
    made,
    read_query,
    split_entry,
)
from sumo_eval.cosim.doors.traci_module import TRACI, seen_as_traci
from sumo_eval.cosim.doors.traci_numbers import finite_number, shown
from sumo_eval.cosim.plans import Wanted
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import (
    ControllerError,
    InputError,
    check_known,
    did_you_mean,
    must_be,
    said,
    unknown,
)
from sumo_eval.frozen import frozen
from sumo_eval.scenario.concrete import Road, Way
from sumo_eval.settings import VehicleSettings
from sumo_eval.settings.locators import load_object
from sumo_eval.text import number_in


@frozen
class Briefing:
    """Facts that a controller receives before a case.

    scenario, values: the scenario's name and its parameters' values if `reveal_scenario` of
        `ConditionSettings` is set, else "" and None.
    vehicle: the ego's.
    step: of the simulation, s.
    step_timeout: wall time that one call may take, s.
    desired_speed: the speed that the ego wants, m/s: its initial speed.
    goal: x, y of the road's end in the lane in which the ego starts or to which it has to change,
        m.
    change: x from which the ego may change lanes and x by which it must have changed, m; None: it
        may stay in its lane.
    period: s from one call to the next.
    way: the lane change of `change` as an object; only baselines use it.
    """

    scenario: str
    road: Road
    vehicle: VehicleSettings
    step: float
    values: Mapping[str, float] | None = None
    step_timeout: float = inf
    desired_speed: float = nan
    goal: tuple[float, float] = (nan, nan)
    change: tuple[float, float] | None = None
    period: float = nan
    way: Way | None = None

    @property
    def speed_limit(self) -> float:
        """Speed limit of the road, m/s."""
        return self.road.speed_limit


class Controller(Protocol):
    """An ADS, bound to one case."""

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Called once, before the first step."""

    def step(self, traci: Any, ego: str, time: float) -> Wanted | None:
        """Called at every step; returns a request to the vehicle, or None if it has commanded SUMO
        itself.
        """

    def close(self) -> None:
        """Called once, after the last step, whatever happened."""


class Adapter:
    """Base of adapters: each gives the calls of a `Controller` to a user's object, program or file.

    target: the user's own object.
    took: wall time of the last turn, s, of a program that drives in its own time; else None.
    is_policy: whether it is called by `act`, with an `Observation` alone.
    """

    target: Any = None
    took: float | None = None
    is_policy = False

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Call the object's `reset`, if it has one."""
        if callable(reset := getattr(self.target, "reset", None)):
            reset(scenario, traci, ego)

    def step(self, traci: Any, ego: str, time: float) -> Any:
        """Does nothing: SUMO's own model or a listener drives."""

    def close(self) -> None:
        """Call the object's `close`, if it has one."""
        if callable(close := getattr(self.target, "close", None)):
            close()


@dataclass(slots=True)
class ObjectController(Adapter):
    """A function (traci, ego, time), or an object with such a `step`; its `reset` and `close` are
    optional.
    """

    target: Any

    def step(self, traci: Any, ego: str, time: float) -> Any:
        """Call the object's `step`, or the function."""
        own = getattr(self.target, "step", None)  # may be a number: a callable's own step, s
        return (own if callable(own) else self.target)(traci, ego, time)


@dataclass(slots=True)
class ListenerController(Adapter):
    """A `traci.StepListener` as a controller: the harness calls its `step` after every step, and
    removes it.
    """

    target: Any

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Register the listener, as a TraCI script would."""
        traci.addStepListener(self.target)

    def close(self) -> None:
        """Does nothing: the harness removes all listeners (`Guard.end`)."""


@dataclass(slots=True)
class PolicyController(Adapter):
    """A policy: a function `(observation)`, or an object with `act(observation)`; its `reset` and
    `close` are optional.
    """

    target: Any
    is_policy = True

    def act(self, seen: Any) -> Any:
        """Call the object's `act`, or the function."""
        own = getattr(self.target, "act", None)  # asked at every step, as the object may change it
        return (own if callable(own) else self.target)(seen)

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Call the object's `reset` with the briefing, if it has one."""
        if callable(reset := getattr(self.target, "reset", None)):
            reset(scenario)


def takes_arrays(policy: Any) -> bool:
    """Whether an object or a class with `act` asks for arrays of observations by `batch = True`."""
    own = policy.target if isinstance(policy, PolicyController) else policy
    return getattr(own, "batch", False) is True and callable(getattr(own, "act", None))


def as_command(action: Any) -> Wanted:
    """An action of an ADS as a request.

    A Command, pedals or a Plan is a request as it is. A number is an acceleration, m/s2; a pair
    also has the steering wheel angle, rad.
    """
    # the usual action, in a quick way; `step_rules.move_rows` checks that it is finite
    if type(action) is float:
        return Command(action)
    if isinstance(action, Wanted):
        return action
    if hasattr(action, "tolist"):
        action = action.tolist()
    values = list(action) if isinstance(action, list | tuple) else [action]
    numbers = [finite_number(value) for value in values] if len(values) <= 2 else []
    if not numbers or None in numbers:
        raise ControllerError(
            "The action of the ADS must be a Command, an acceleration or (acceleration, steering), "
            f"of finite numbers, or a Plan, got {shown(action)}"
            + (": it must give a plan before one can hold" if action is None else "")
        )
    return Command(*cast(list[float], numbers))


# SUMO's lane change mode, bits 0 and 9 (1 + 512): it changes lanes only where its route needs it
# (strategic changes), and leaves safe gaps to other vehicles
_WHERE_THE_ROUTE_ASKS = 513
SUMO_ATTRIBUTES = (
    "accel", "decel", "apparentDecel", "emergencyDecel", "minGap", "tau", "sigma", "sigmaStep",
    "startupDelay", "speedFactor", "speedDev", "desiredMaxSpeed", "maxSpeed", "actionStepLength",
    "delta", "stepping", "adaptFactor", "adaptTime", "tpreview", "tPersDrive", "tPersEstimate",
    "tReaction", "treaction", "ccoolness", "sigmaleader", "sigmagap", "sigmaerror", "jerkmax",
    "epsilonacc", "taccmax", "Mflatness", "Mbegin", "speedControlGain",
    "gapClosingControlGainSpeed", "gapClosingControlGainSpace", "gapControlGainSpeed",
    "gapControlGainSpace", "collisionAvoidanceGainSpeed", "collisionAvoidanceGainSpace",
    "speedControlMinGap", "applyDriverState", "tauLastStep", "k", "phi", "security", "estimation",
    "tmp1", "tmp2", "tmp3", "tmp4", "tmp5", "cc1", "cc2", "cc3", "cc4", "cc5", "cc6", "cc7",
    "cc8", "cc9", "lanesCount", "ccAccel", "ccDecel", "tauEngine", "c1", "xi", "omegaN",
    "constSpacing", "kp", "lambda", "ploegKp", "ploegKd", "ploegH", "flatbedKa", "flatbedKv",
    "flatbedKp", "flatbedD", "flatbedH", "speedControlGainCACC", "gapClosingControlGainGap",
    "gapClosingControlGainGapDot", "gapControlGainGap", "gapControlGainGapDot",
    "collisionAvoidanceGainGap", "collisionAvoidanceGainGapDot", "collisionAvoidanceOverride",
)  # fmt: skip
"""Attributes of a vType that describe how it follows; `VehicleSettings` describe the body."""
_ABOVE_ZERO = (
    "accel", "decel", "apparentDecel", "emergencyDecel", "tau", "speedFactor", "desiredMaxSpeed",
    "maxSpeed", "stepping",
)  # fmt: skip
_FROM_ZERO = ("minGap", "speedDev", "startupDelay", "actionStepLength", "sigma")
PARAMETER = "carFollowModel."
"""Beginning of the name of a parameter that a model receives at the start: Plexe's
`carFollowModel.ccac=1`."""


@frozen
class NativeModel(Adapter):
    """The ego driven by one of SUMO's own car-following models: `sumo:MODEL?tau=1.2&minGap=2`.

    It keeps its lane; where its route needs a lane change, SUMO's lane-changing model changes.

    attributes: of the vType, and parameters (`PARAMETER`).
    """

    model: str
    attributes: Mapping[str, str]

    def vtype_on(self, road: Road) -> dict[str, str]:
        """Attributes of the ego's vehicle type on this road: the model's, else SUMO's defaults of a
        passenger car. Plexe's `CC` needs the number of lanes.
        """
        attributes = {"lanesCount": str(road.lanes)} if self.model == "CC" else {}
        attributes |= {
            "carFollowModel": self.model, "minGap": "2.5", "accel": "2.6", "decel": "4.5"
        }  # fmt: skip
        return attributes | {
            name: value for name, value in self.attributes.items() if not name.startswith(PARAMETER)
        }

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Let SUMO drive: all its safety checks are on, and it changes lanes only where the route
        needs it.
        """
        traci.vehicle.setSpeedMode(ego, 31)  # bits 0 to 4: all checks
        traci.vehicle.setLaneChangeMode(
            ego, 0 if scenario.change is None else _WHERE_THE_ROUTE_ASKS
        )
        for name, value in self.attributes.items():
            if name.startswith(PARAMETER):
                traci.vehicle.setParameter(ego, name, value)


SHIPPED = {
    "ideal_braking": "sumo_eval.ads.known_answers:IdealBraking",
    "no_reaction": "sumo_eval.ads.known_answers:no_reaction",
    "idm": "sumo_eval.ads.car_following:Idm",
    "attentive": "sumo_eval.ads.car_following:Attentive",
    "lane_changer": "sumo_eval.ads.lane_changer:LaneChanger",
    "careful_driver": "sumo_eval.ads.r157_careful_driver:CarefulDriver",
    "careful_driver_aeb": "sumo_eval.ads.r157_careful_driver:CarefulDriverWithAeb",
    "fsm": "sumo_eval.ads.fuzzy_safety_model:FuzzySafetyModel",
    "rss": "sumo_eval.ads.rss:ResponsibilitySensitiveSafety",
    "reg157": "sumo_eval.ads.reg157:Reg157",
    "eu_2022_1426": "sumo_eval.ads.eu_2022_1426:Eu20221426",
    "eu_2022_1426_bus": "sumo_eval.ads.eu_2022_1426:Eu20221426Bus",
}
"""Locators of the controllers that ship, by name."""

DOORS = {
    "exec": "sumo_eval.cosim.doors.json_lines:JsonLinesProgram.from_command",
    "traci": "sumo_eval.cosim.doors.traci_program:TraciProgram.from_command",
    "fmu": "sumo_eval.cosim.doors.fmu:FmuController.from_locator",
    "given": "sumo_eval.cosim.doors.given:load_given",
    "onnx": "sumo_eval.cosim.doors.onnx:from_locator",
}
"""Maker of a controller from the rest of a locator and the folder where its paths start, by the
locator's scheme.

Texts, because these modules import this one.
"""


def has_scheme(locator: str) -> bool:
    """Whether a locator begins with a scheme that has a door of its own: `exec:python
    my_ads.py`.
    """
    return locator.partition(":")[0] in ("sumo", *DOORS)


_IN_THEIR_OWN_TIME = ("sumo", "traci")  # schemes that take no `period`

SUMO_MODELS = (
    "Krauss", "KraussOrig1", "KraussPS", "PWagner2009", "BKerner", "IDM", "IDMM", "EIDM",
    "SmartSK", "Wiedemann", "W99", "Daniel1", "ACC", "CACC", "CC",
)  # fmt: skip
"""Car-following models of SUMO that can drive the ego by themselves."""

ControllerLike = str | Callable[..., Any] | Any


def load_controller(controller: ControllerLike, folder: Path | None = None) -> Adapter:
    """A fresh controller from a locator, a class, a function or an object.

    folder: where relative paths of a locator start; None: the working directory.

    Raises InputError if there is no such controller.
    """
    target, name, entry = located(controller, folder)
    return adapted(target, name, entry.options)


def located(controller: ControllerLike, folder: Path | None) -> tuple[Any, str, Entry]:
    """Of a controller, which is a locator or a user's object: the target, its name, its entry."""
    if isinstance(controller, str):
        return find_controller(controller, folder), controller, split_entry(controller)[1]
    return controller, repr(controller), PLAIN


@seen_as_traci()
def find_controller(locator: str, folder: Path | None = None) -> Any:
    """Target of a locator, not yet made into a controller: a class stays a class."""
    locator, entry = split_entry(locator)
    scheme, colon, rest = locator.partition(":")
    if entry.period and (scheme in _IN_THEIR_OWN_TIME or locator in SHIPPED):
        raise InputError(f"ADS `{locator}` drives at every step; it takes no `period`.")
    if colon and scheme == "sumo":
        return _native_model(locator, rest)
    if colon and scheme in DOORS:
        return load_object(DOORS[scheme], None, "ADS")(rest, folder or Path.cwd())
    target = SHIPPED.get(locator, locator)
    _check_form(target)
    loaded = load_object(target, folder, "ADS")
    if inspect.isclass(loaded):
        _refuse_foreign(loaded, locator)
        check_options(loaded, entry.options, locator)
    return loaded


def _check_form(locator: str) -> None:
    """Raise InputError unless a locator is of the form `module:name` or `file.py:name`."""
    name, mark, pairs = (locator.partition(":")[2] or locator).partition("?")
    # a name of Python has no `?`: these are pairs that `split_entry` did not know
    if mark and "=" in pairs and "/" not in name:
        raise must_be("The options", f"ADS `{locator}`", f"of the form {ENTRY_FORM}", pairs)
    if hint := _other_way(locator):
        raise InputError(
            f"ADS `{locator}` must be one that ships, or of the form `module:name` or "
            f"`file.py:name`: {hint}."
        )
    if ":" not in locator:
        raise InputError(
            f"Unknown ADS `{locator}`: not one that ships, and not of the form `module:name` or "
            f"`file.py:name`.{did_you_mean(locator, (*SHIPPED, 'sumo:IDM'))}"
        )


# endings of files of weights
_WEIGHTS = (".zip", ".pt", ".pth", ".pkl", ".npz", ".h5", ".keras", ".safetensors")
_ADAPTERS = {
    "carla": "carla_agent.py:CarlaAgent",
    "smarts": "smarts_agent.py:SmartsAgent",
    "nuplan": "nuplan_planner.py:NuPlanPlanner",
    "commonroad": "commonroad_planner.py:CommonRoadPlanner",
}
"""Locators of the adapters of docs/examples/adapters, by the tool whose ADSs they drive."""


def _other_way(locator: str) -> str | None:
    """Hint at the locator that the user probably meant; None: no hint."""
    scheme, colon, rest = locator.partition(":")
    if colon:
        return _other_scheme(scheme.lower(), rest)
    plain = locator.partition("?")[0]
    suffix = Path(plain).suffix
    if suffix in (".onnx", ".fmu"):
        return f"`{suffix[1:]}:{locator}` drives it"
    if suffix == ".py" and " " not in plain:
        return f"`{locator}:NAME` names what it holds, `sumo-eval check {locator}` lists it"
    if suffix == ".xosc":
        return f"it is an OpenSCENARIO scenario, `sumo-eval import {plain}` checks it"
    if suffix in _WEIGHTS:
        return (
            "weights alone do not drive; as ONNX they do (docs/ads/onnx.md), or in a class with "
            "`act(observation)` that loads them"
        )
    if " " in locator or "/" in locator:
        return f"`exec:{locator}` runs it as a program (docs/ads/exec.md)"
    return None


def _other_scheme(scheme: str, rest: str) -> str | None:
    """Hint for a locator whose scheme is none of `DOORS`; None: no hint."""
    if scheme in _ADAPTERS and ":" in rest:
        return _driven_by(scheme, rest)
    if scheme in ("ros2", "ros"):
        return "a node that `exec:` starts drives a ROS 2 stack (docs/ads/ros2.md)"
    if scheme in ("grpc", "http", "https", "tcp", "zmq"):
        return (
            "a class with `act(observation)` that asks the server drives it "
            "(docs/ads/observation.md)"
        )
    return None


def _driven_by(tool: str, agent: str) -> str:
    """Hint at the adapter that drives an agent of another tool.

    agent: its locator.
    """
    locator = f"{_ADAPTERS[tool]}?options.agent={agent}"
    return f"`{locator}` with the files of docs/examples/adapters drives it"


def knows_the_scripts(driver: Any) -> bool:
    """Whether `driver` is the ideal vehicle of Eq. 17. It alone knows what other vehicles will do;
    ADSs and subclasses of it do not.
    """
    return type(driver) is load_object(SHIPPED["ideal_braking"], None, "ADS")


def _native_model(locator: str, text: str) -> NativeModel:
    """The model of `sumo:`.

    text: the locator after the scheme.
    """
    model, _, query = text.partition("?")
    by_lower_case = {name.lower(): name for name in SUMO_MODELS}
    if model.lower() not in by_lower_case:
        raise unknown("SUMO car-following model", model, SUMO_MODELS)
    attributes = read_query(query, f"ADS `{locator}`", "name=value&name=value")
    _check_attributes(attributes, f"ADS `{locator}`")
    return NativeModel(by_lower_case[model.lower()], attributes)


def own_vehicle_type(target: Any, road: Road) -> dict[str, str] | None:
    """The vType that TraCI code names for its ego, `vehicle_type = {"carFollowModel": "CC", ...}`;
    None: it names none.

    Raises InputError for attributes that do not describe how the vehicle follows.
    """
    model = _own_model(target)
    return None if model is None else model.vtype_on(road)


def _own_model(target: Any) -> NativeModel | None:
    """The checked `vehicle_type` of TraCI code as a model; None: it names none."""
    own_type = getattr(target, "vehicle_type", None)
    if own_type is None:
        return None
    owner = f"`vehicle_type` of {type(target).__name__}"
    if not isinstance(own_type, Mapping):
        raise must_be("The attributes", owner, "a dict", own_type)
    attributes = {str(name): str(value) for name, value in own_type.items()}
    model = attributes.pop("carFollowModel", "Krauss")
    check_known(f"SUMO car-following model in {owner}", SUMO_MODELS, model)
    for name in attributes:
        if name.startswith(PARAMETER):
            raise InputError(
                f"`{name}` is not an attribute of {owner}: set it with traci.vehicle.setParameter."
            )
    _check_attributes(attributes, owner)
    return NativeModel(model, attributes)


def _check_attributes(attributes: Mapping[str, str], owner: str) -> None:
    """Raise InputError unless each attribute is one of `SUMO_ATTRIBUTES`, or a parameter, and a
    number that SUMO's models can have.
    """
    for name, value in attributes.items():
        if name not in SUMO_ATTRIBUTES and not name.startswith(PARAMETER):
            raise unknown(f"vType parameter of {owner}", name, SUMO_ATTRIBUTES)
        number = number_in(value)
        demand = ""
        if isnan(number):
            demand = "a finite number"
        elif name in _ABOVE_ZERO and number <= 0.0:
            demand = "greater than 0"
        elif name in _FROM_ZERO and number < 0.0:
            demand = "at least 0"
        elif name == "sigma" and number > 1.0:
            demand = "at most 1"
        if demand:
            raise must_be(f"`{name}`", owner, demand, value)


@seen_as_traci()
def adapted(target: Any, described: str, options: Mapping[str, Any]) -> Adapter:
    """A fresh controller from a class, function or object, loaded by a locator or a user's own.

    described: the ADS, for messages.
    options: of its entry.
    """
    try:
        _refuse_foreign(target, described)
        kind: Any = target if inspect.isclass(target) else type(target)
        name = _async_method(kind)
        if inspect.iscoroutinefunction(target):
            name = getattr(target, "__name__", described)
        if name:
            raise InputError(
                f"`{name}` of ADS `{described}` must not be `async`, as nothing awaits it: it may "
                "call `asyncio.run`."
            )
        if inspect.isclass(target):
            target = made(target, options, described)
        elif options and isinstance(target, Adapter) and hasattr(target, "options"):  # a program
            target.options = dict(options)
            _own_model(target)  # an error of its options shows before the first case
        elif options:
            raise InputError(
                f"ADS `{described}` takes no `options`: they are for a class or a program of "
                "`exec:`."
            )
        # read here too, where an error of the user's property becomes a message
        for name in ("batch", "settled", "vehicle_type"):
            getattr(target, name, None)
        if adapter := _adapter_of(target):
            return adapter
        arguments = f" {inspect.signature(target)}" if callable(target) else ""
    except InputError:
        raise
    except Exception as error:  # a property of the user's class
        raise InputError(f"ADS `{described}` cannot be loaded: {said(error)}.") from error
    raise InputError(
        f"ADS `{described}` must be a function (traci, ego, time), a class or an object with a "
        f"`step` method, got {type(target).__name__}{arguments}. Or, without TraCI, a function "
        "(observation) or one with `act`."
    )


_CALLED = ("reset", "act", "step", "close", "__call__")  # methods that an ADS may have


@functools.lru_cache(maxsize=64)  # asked for every case
def _async_method(kind: type) -> str:
    """Name of a class's first method that is `async` although it is called, "" if none is."""
    methods = ((name, getattr(kind, name, None)) for name in _CALLED)
    return next((name for name, it in methods if inspect.iscoroutinefunction(it)), "")


def _adapter_of(target: Any) -> Adapter | None:
    """The adapter of a function or object; None: it is not a controller."""
    if isinstance(target, Adapter):
        return target
    if isinstance(target, TRACI.StepListener):
        return ListenerController(target)
    if (call := called_by(target)) == "act":
        return PolicyController(target)
    if call == "step":
        return ObjectController(target)
    if not callable(target):
        return None
    # once for a function, which is asked for every case; another callable need not be hashable
    door = _door_of if inspect.isfunction(target) else _door_of.__wrapped__
    adapter = door(target)
    return adapter(target) if adapter else None


def called_by(target: Any) -> str:
    """The method by which a class or an object is called: `act`, `step`, or "" for neither.

    A method of its own comes before one that only its `__getattr__` gives.
    """
    names = [name for name in ("act", "step") if callable(getattr(target, name, None))]
    own = (name for name in names if inspect.getattr_static(target, name, None) is not None)
    return next(own, names[0] if names else "")


FOREIGN = {
    "run_step": ("CARLA's agents have it", "carla"),
    "compute_planner_trajectory": ("nuPlan's planners have it", "nuplan"),
    "compute_trajectory": ("nuPlan's planners have it", "nuplan"),
    "predict": ("the models of stable-baselines3 have it", ""),
    "plan": ("CommonRoad's planners have it", "commonroad"),
}
"""By method with which ADSs of other tools are called: words on whose it is, and the tool, a key of
`_ADAPTERS`; "": without an adapter."""
_SMARTS = ("SMARTS's agents have it", "smarts")


def adapter_for(target: Any) -> str:
    """Locator of the adapter that drives an agent with another tool's interface; "": there is none.

    docs/examples/adapters/other_tools.py uses it.
    """
    tools = (tool for name, (_, tool) in FOREIGN.items() if callable(getattr(target, name, None)))
    return _ADAPTERS.get(next(tools, ""), "")


def _refuse_foreign(target: Any, described: str) -> None:
    """Raise InputError for the ADS of another tool; its message names the adapter."""
    kind = target if inspect.isclass(target) else type(target)
    if any(base.__module__.partition(".")[0] == "smarts" for base in kind.__mro__):
        method, (whose, tool) = "act", _SMARTS
    elif method := _foreign_method(target, kind):
        whose, tool = FOREIGN[method]
    else:
        return
    hint = f"{_driven_by(tool, described)} (docs/ads/other_simulators.md). Or " if tool else ""
    raise InputError(
        f"ADS `{described}` must be a function (traci, ego, time), a class or an object with a "
        f"`step` method, got {kind.__name__}. It has `{method}`, as {whose}: {hint}put it in a "
        "class with `act(observation)` that calls it (docs/ads/observation.md)."
    )


def _foreign_method(target: Any, kind: type) -> str:
    """The method of `FOREIGN` by which another tool would call an ADS; "" for any other ADS.

    kind: the target's class, or the target itself if it is a class.
    """
    # a generator, to stop at the first: a property with a later name may fail before a case
    methods = (it for it in ("act", "step", *FOREIGN) if callable(getattr(target, it, None)))
    method = next(methods, "")
    if isinstance(target, Adapter) or method not in FOREIGN:
        return ""
    # a callable with arguments counts as a function; CARLA's agents are callable without any
    call = getattr(kind, "__call__", None)  # noqa: B004
    is_function = inspect.isfunction(call) and len(inspect.signature(call).parameters) > 1
    return "" if is_function else method


@functools.lru_cache(maxsize=8)  # few, as it keeps the functions alive
def _door_of(function: Callable[..., Any]) -> type[PolicyController | ObjectController] | None:
    """The adapter of a function, by its arguments; None: it is not a controller."""
    if _takes_one_argument(function):
        return PolicyController
    return ObjectController if _takes_three_arguments(function) else None


def _takes_three_arguments(function: Callable[..., Any]) -> bool:
    """Whether a function can be called with (traci, ego, time); True if that is not known."""
    try:
        # what is called, not a function that a decorator has wrapped
        inspect.signature(function, follow_wrapped=False).bind(None, "", 0.0)
    except TypeError:
        return False
    except ValueError:  # of compiled code
        pass
    return True


def _takes_one_argument(function: Callable[..., Any]) -> bool:
    """Whether a function takes an observation, and not (traci, ego, time): exactly one required
    positional argument and no `*args`.
    """
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return False
    required = [
        p
        for p in parameters
        if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
    ]
    return len(required) == 1 and not any(p.kind == p.VAR_POSITIONAL for p in parameters)
