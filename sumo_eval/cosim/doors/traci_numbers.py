"""Values that an ADS may write through TraCI: finite numbers, existing lanes, possible times.

SUMO takes `setMaxSpeed(nan)`, `changeLane(10**6)` and `slowDown(v, -3)` silently, with effects that
no user intends. `ARGUMENTS` names the arguments of every call that writes to a vehicle or a vehicle
type.

Users: `cosim/doors/controller.py`, `cosim/doors/json_lines.py`, `cosim/doors/traci_module.py`,
`cosim/plans.py`, `extras/wheel/tape.py`.
"""

import inspect
import numbers
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Any, NamedTuple

from sumo_eval import text
from sumo_eval.cosim.sumo.insides import VehicleDomain, VehicleTypeDomain, libsumo

shown = partial(text.shown, most=80)
"""A value as an error message about an ADS shows it."""
LONGEST = 2.0**31
"""s, the longest duration that an ADS can mean: TraCI's old default, one more than the largest
signed count of 32 bits."""
# TraCI's INVALID_DOUBLE and INVALID_INT: an optional argument that was left out
_LEFT_OUT = -1073741824
# spellings of nan, nan(...) and infinity that C++ reads
_NO_NUMBER = re.compile(r"[+-]?(nan(\(\w*\))?|inf(inity)?)", re.IGNORECASE)
_SEPARATORS = re.compile(r"[\s,;]+")

# beginnings of the names of calls that only read, or that do not change how vehicles drive
_READS = (
    "_", "get", "is", "subscribe", "unsubscribe", "addSubscriptionFilter", "could", "wants",
    "find", "convert", "has",
    "DOMAIN", "domain", "this", "updateBestLanes", "highlight", "saveState", "writeMessage",
)  # fmt: skip


def writing_calls(domain: type) -> dict[str, Callable[..., Any]]:
    """The calls of a domain of libsumo that write, by name."""
    calls = inspect.getmembers(domain, inspect.isroutine)
    return {name: call for name, call in calls if not name.startswith(_READS)}


# Parameters of each call after the vehicle's name. They come from traci, as libsumo's overloaded
# functions take `*args`.
_PARAMETERS = {
    domain: {
        call: list(inspect.signature(getattr(of_traci, call)).parameters.values())[2:]
        for call in writing_calls(getattr(libsumo, domain))
    }
    for domain, of_traci in (("vehicle", VehicleDomain), ("vehicletype", VehicleTypeDomain))
}
ARGUMENTS = {
    domain: {call: tuple(it.name for it in own) for call, own in calls.items()}
    for domain, calls in _PARAMETERS.items()
}
"""By domain and call: the names of the arguments after the vehicle's name, in their order."""
# (call, argument) pairs of arguments that may be left out
_OPTIONAL = frozenset(
    (call, it.name)
    for call, own in _PARAMETERS["vehicle"].items()
    for it in own
    if it.default is not it.empty
)

PLACING = {"moveTo", "moveToXY", "setLateralLanePosition"}
"""Calls that put a vehicle at a place."""

MOTION = PLACING | {
    "setSpeed", "slowDown", "setAcceleration", "setPreviousSpeed", "changeLane",
    "changeLaneRelative", "openGap",
}  # fmt: skip
"""Calls that move a vehicle; without effect on an ego that has a `Command` for the same step."""

WHY_IGNORED = {
    "nothing": "no case has a lateral resolution, and none draws speeds again",
    "model": "only SUMO's own model heeds it, which never drove the ego: setSpeed(ego, -1) hands "
    "it over",
    "traffic": "only vehicles that SUMO drives heed it, and there are none",
    "network": "this road has one way, no junction and no limit that the ego could heed",
    "window": "a case has no window",  # all calls of `gui` (`Guard.ignored`)
}
"""Why SUMO ignores a call, by the part of SUMO that would heed it, a value of `IGNORED`. In a
user's own network, calls of `network` may have an effect.
"""
IGNORED = {
    call: by
    for by, calls in (
        ("nothing", "changeSublane setLateralAlignment setMinGapLat setSpeedDeviation setWidth"),
        (
            "model",
            "openGap deactivateGapControl setActionStepLength setImperfection setTau setMinGap "
            "setStop insertStop",
        ),
        ("traffic", "setApparentDecel setLength"),
        (
            "network",
            "setImpatience setSpeedFactor setRoutingMode rerouteTraveltime rerouteEffort setVia "
            "setAdaptedTraveltime setEffort",
        ),
    )
    for call in calls.split()
}
"""Calls that SUMO takes and ignores under the settings of a case -> the part of SUMO that would
heed them."""
HANDS_OVER = {"setSpeed", "slowDown", "setAcceleration"}
"""Calls after which SUMO's own model drives: directly after a negative speed, or when the call's
duration has passed."""

DURATIONS = {
    "duration", "until", "leadTime", "actionStepLength", "boardingDuration", "time", "begTime",
    "endTime"
}  # fmt: skip
"""Names of arguments that are durations or times, s."""
# names of arguments that are texts with numbers in them
_NUMBERS_IN_TEXT = {"value", "depart", "departPos", "departSpeed", "arrivalPos", "arrivalSpeed"}


class Breach(NamedTuple):
    """An impossible argument of a call.

    argument: its name. given: its value. must_be: the rule that the value breaks, for the message.
    """

    argument: str
    given: object
    must_be: str


def breach(
    domain: str, call: str, name: object, args: Sequence[object], kwargs: Mapping[str, object]
) -> Breach | None:
    """The impossible argument of a call that writes; None: there is none.

    name: of the vehicle or type. args, kwargs: the call's arguments after the name.
    """
    names = ARGUMENTS.get(domain, {}).get(call, ())
    given = {
        names[index] if index < len(names) else f"argument {index + 2}": each
        for index, each in enumerate(args)
    }
    given |= kwargs
    for argument, value in given.items():
        if not _is_finite(value, in_text=argument in _NUMBERS_IN_TEXT):
            return Breach(argument, value, "a finite number")
        seconds = finite_number(value, truth=True)
        if argument not in DURATIONS or seconds is None:
            continue  # not a duration, or not a number: libsumo itself refuses the latter
        if not (
            0.0 <= seconds <= LONGEST or ((call, argument) in _OPTIONAL and seconds == _LEFT_OUT)
        ):
            return Breach(argument, value, f"within 0..{LONGEST:.0f} s")
    return _no_such_lane(call, str(name), given) if domain == "vehicle" else None


def _is_finite(value: object, *, in_text: bool) -> bool:
    """Whether every number in a value is finite; True if it holds no number."""
    if isinstance(value, str):
        return not in_text or not any(map(_reads_as_no_number, _SEPARATORS.split(value)))
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, numbers.Real):
        return finite_number(value, truth=True) is not None
    if isinstance(value, list | tuple | set | frozenset):
        return all(_is_finite(each, in_text=in_text) for each in value)
    return True


def _reads_as_no_number(word: str) -> bool:
    """Whether SUMO would read a word as nan or infinity."""
    if _NO_NUMBER.fullmatch(word):
        return True
    try:
        return not isfinite(float(word))  # 1e999
    except ValueError:
        return False


def _no_such_lane(call: str, name: str, given: Mapping[str, object]) -> Breach | None:
    """The argument of a call that names no lane, or a position beyond a lane's end; None: none.

    SUMO ignores such a lane, and removes a vehicle that is put on it.

    name: of the vehicle. given: the call's arguments by name.
    """
    try:
        if call in ("changeLane", "moveToXY"):
            lowest = -1 if call == "moveToXY" else 0  # -1: SUMO looks for the lane
            return _no_such_index("laneIndex", given, lowest, _lanes(name) - 1)
        if call == "changeLaneRelative":
            current = libsumo.vehicle.getLaneIndex(name)
            if current >= 0:
                return _no_such_index("indexOffset", given, -current, _lanes(name) - 1 - current)
        if call == "moveTo" and isinstance(given.get("laneID"), str):
            return _no_such_place(str(given["laneID"]), given.get("pos"))
    except libsumo.TraCIException:  # an unknown name: the call itself reports it
        return None
    return None


def _no_such_place(lane: str, pos: object) -> Breach | None:
    """The argument of a `moveTo` to an unknown lane or beyond its end; None: none."""
    if lane not in libsumo.lane.getIDList():
        return Breach("laneID", lane, "the id of a lane of the network")
    position = finite_number(pos, truth=True)
    length = libsumo.lane.getLength(lane)
    if position is None or 0.0 <= position <= length:
        return None
    return Breach("pos", position, f"within 0..{length:g} m, the length of lane `{lane}`")


def _no_such_index(
    argument: str, given: Mapping[str, object], low: int, high: int
) -> Breach | None:
    """The argument, if it is a number that is not within low..high."""
    index = finite_number(given.get(argument), truth=True)
    if index is None or low <= index <= high:
        return None
    return Breach(argument, given[argument], f"within {low}..{high}, the lanes of its road")


def _lanes(name: str) -> int:
    """Number of lanes of a vehicle's road; of a route of several edges, where it is widest."""
    return max(int(libsumo.edge.getLaneNumber(edge)) for edge in libsumo.vehicle.getRoute(name))


def finite_number(value: Any, *, truth: bool = False) -> float | None:
    """A real number as a finite float; None for any other value.

    truth: accept a truth value as a number, too.
    """
    if not isinstance(value, numbers.Real) or (isinstance(value, bool) and not truth):
        return None
    try:
        number = float(value)
    except Exception:  # noqa: BLE001 - 10**400, and whatever a type of the user's own may raise
        return None
    return number if isfinite(number) else None
