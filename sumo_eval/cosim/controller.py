"""The ADS door: what a controller is, and how a locator such as `idm`, `module:name` or `my_ads.py:MyAds` becomes one.

A controller is a function `(traci, ego, time)` or an object with `step(traci, ego, time)` and, if it likes,
`reset(scenario, traci, ego)` and `close()`. `traci` is the running libsumo module, so TraCI code works as it is; `ego`
is the ego's vehicle id; `time` is seconds since the start of the case (SUMO's own clock is one step ahead of it, the
step that inserted the vehicles). A step returns a `Command` for the harness's vehicle model, or None when it has
commanded SUMO itself.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, cast

from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import InputError, did_you_mean, said, unknown
from sumo_eval.locators import load_object
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import VehicleSettings


@dataclass(frozen=True, slots=True)
class Briefing:
    """What a controller is told before a case: the scenario's name, the road, its own vehicle and the step, s."""

    scenario: str
    road: Road
    vehicle: VehicleSettings
    step: float


class Controller(Protocol):
    """An ADS, bound to one case."""

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Called once, before the first step."""

    def step(self, traci: Any, ego: str, time: float) -> Command | None:
        """Called every step; returns a command, or None after commanding SUMO itself."""

    def close(self) -> None:
        """Called once, after the last step, whatever happened."""


@dataclass(slots=True)
class FunctionController:
    """A controller that is a plain function."""

    function: Callable[[Any, str, float], Command | None]

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """A function keeps nothing between cases."""

    def step(self, traci: Any, ego: str, time: float) -> Command | None:
        """Ask the function."""
        return self.function(traci, ego, time)

    def close(self) -> None:
        """A function holds nothing."""


@dataclass(slots=True)
class ObjectController:
    """A controller that is an object; `reset` and `close` are optional."""

    target: Any

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Pass on, when the object has one."""
        if hasattr(self.target, "reset"):
            self.target.reset(scenario, traci, ego)

    def step(self, traci: Any, ego: str, time: float) -> Command | None:
        """Ask the object."""
        return cast("Command | None", self.target.step(traci, ego, time))

    def close(self) -> None:
        """Pass on, when the object has one."""
        if hasattr(self.target, "close"):
            self.target.close()


@dataclass(frozen=True, slots=True)
class NativeModel:
    """The ego driven by one of SUMO's own car-following models, in its lane: `sumo:MODEL`."""

    model: str
    attributes: Mapping[str, str] = field(default_factory=dict)

    @property
    def vtype(self) -> dict[str, str]:
        """Attributes of the ego's vehicle type: SUMO's own defaults of a passenger car, within what the vehicle can."""
        return {"carFollowModel": self.model, "minGap": "2.5", "accel": "2.6", "decel": "4.5", **self.attributes}

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Give SUMO the wheel: all its safety checks on, no lane changes."""
        traci.vehicle.setSpeedMode(ego, 31)
        traci.vehicle.setLaneChangeMode(ego, 0)

    def step(self, traci: Any, ego: str, time: float) -> None:
        """SUMO drives."""

    def close(self) -> None:
        """Nothing is held."""


SHIPPED = {
    "ideal_braking": "sumo_eval.ads.known_answers:IdealBraking",
    "no_reaction": "sumo_eval.ads.known_answers:no_reaction",
    "idm": "sumo_eval.ads.car_following:Idm",
    "lane_changer": "sumo_eval.ads.lane_changer:LaneChanger",
    "careful_driver": "sumo_eval.ads.r157_careful_driver:CarefulDriver",
    "careful_driver_aeb": "sumo_eval.ads.r157_careful_driver:CarefulDriverWithAeb",
    "fsm": "sumo_eval.ads.fuzzy_safety_model:FuzzySafetyModel",
    "rss": "sumo_eval.ads.rss:ResponsibilitySensitiveSafety",
    "reg157": "sumo_eval.ads.reg157:Reg157",
}
"""Controllers that ship, by name."""

SUMO_MODELS = (
    "Krauss", "KraussOrig1", "KraussPS", "PWagner2009", "BKerner", "IDM", "IDMM", "EIDM", "SmartSK", "Wiedemann", "W99",
    "Daniel1", "ACC", "CACC",
)  # fmt: skip
"""Car-following models of SUMO that can drive the ego by themselves."""

ControllerLike = str | Callable[..., Any] | Any


def load_controller(controller: ControllerLike, folder: Path | None = None) -> Controller:
    """A fresh controller from a locator, a class, a function or an object. Paths are relative to `folder`.

    Raises InputError with one sentence when it cannot be found or is no controller.
    """
    if isinstance(controller, str):
        return _adapt(find_controller(controller, folder), controller)
    return _adapt(controller, repr(controller))


def find_controller(locator: str, folder: Path | None = None) -> Any:
    """What a locator names, not yet made into a controller: a class stays a class."""
    if locator.startswith("sumo:"):
        model = locator.removeprefix("sumo:")
        by_lower_case = {name.lower(): name for name in SUMO_MODELS}
        if model.lower() not in by_lower_case:
            raise unknown("SUMO car-following model", model, SUMO_MODELS)
        return NativeModel(by_lower_case[model.lower()])
    target = SHIPPED.get(locator, locator)
    if ":" not in target:
        raise InputError(
            f"Unknown ADS `{locator}`: not one that ships, and not of the form `module:name` or `file.py:name`."
            f"{did_you_mean(locator, (*SHIPPED, 'sumo:IDM'))}"
        )
    return load_object(target, folder, "ADS")


def _adapt(found: Any, described: str) -> Controller:
    if isinstance(found, NativeModel | FunctionController | ObjectController):
        return found
    if inspect.isclass(found):
        try:
            found = found()
        except (Exception, SystemExit) as error:
            raise InputError(f"ADS `{described}`: making one without arguments failed: {said(error)}.") from error
    if callable(getattr(found, "step", None)):
        return ObjectController(found)
    if callable(found):
        return FunctionController(found)
    raise InputError(
        f"ADS `{described}` must be a function (traci, ego, time), a class or an object with a `step` method, "
        f"got {type(found).__name__}."
    )
