"""What an ideal sensor of the ego sees through TraCI, in road coordinates: x along the road, y to the left, m and m/s.

SUMO reports the front bumper's centre and an angle clockwise from north; `Sensor.look` turns both into body centres and
speeds along and across the road, once, so that nothing behind it knows SUMO. Everything is a plain float: a look at two
other vehicles costs about 7 us.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

_tuple = tuple.__new__  # a NamedTuple's own constructor takes twice as long, and a look makes several


class Mover(NamedTuple):
    """A vehicle at an instant.

    x, y: body centre, m. heading: rad, 0 along the road, positive to the left. along, across: speed by road axis, m/s.
    half_length, half_width: half the extent of the (turned) body along and across the road, m. braking: deceleration
    along the road that whoever looks has noticed, m/s2.
    """

    name: str
    x: float
    y: float
    heading: float
    along: float
    across: float
    half_length: float
    half_width: float
    braking: float = 0.0

    @property
    def speed(self) -> float:
        """Speed along the heading, m/s."""
        return math.hypot(self.along, self.across)

    def after(self, time: float) -> Mover:
        """The same vehicle `time` s later if it keeps its velocity, or goes on braking until it stands."""
        name, x, y, heading, along, across, half_length, half_width, braking = self
        if braking <= 0.0:
            x, y = x + along * time, y + across * time
            return _tuple(Mover, (name, x, y, heading, along, across, half_length, half_width, braking))
        rolling = min(time, max(along, 0.0) / braking)
        x += rolling * (along - 0.5 * braking * rolling)
        y += across * rolling
        return _tuple(Mover, (name, x, y, heading, along - braking * rolling, across, half_length, half_width, braking))


class Scene(NamedTuple):
    """The ego and every other vehicle at one instant."""

    me: Mover
    others: tuple[Mover, ...]


class Neighbours(NamedTuple):
    """The nearest vehicles ahead of and behind the ego in a strip of road; one beside the ego is both."""

    ahead: Mover | None
    behind: Mover | None


class Sensor:
    """Sees every vehicle of the simulation, hidden ones too: what hides what is decided by `visible`."""

    def __init__(self) -> None:
        self._sizes: dict[str, tuple[float, float]] = {}

    def look(self, traci: Any, ego: str) -> Scene:
        """The scene at the present step. `traci`: the running libsumo module; `ego`: the ego's vehicle id."""
        vehicle = traci.vehicle
        others = tuple([self._read(vehicle, name) for name in vehicle.getIDList() if name != ego])
        return Scene(self._read(vehicle, ego), others)

    def _read(self, vehicle: Any, name: str) -> Mover:
        size = self._sizes.get(name)
        if size is None:
            size = self._sizes[name] = (0.5 * vehicle.getLength(name), 0.5 * vehicle.getWidth(name))
        half_length, half_width = size
        x, y = vehicle.getPosition(name)
        angle, speed = vehicle.getAngle(name), vehicle.getSpeed(name)
        if angle == 90.0:  # along the road, exactly: nearly every vehicle nearly always
            return _tuple(Mover, (name, x - half_length, y, 0.0, speed, 0.0, half_length, half_width, 0.0))
        heading = math.radians(90.0 - angle)
        if abs(heading) < 1e-9:
            return Mover(name, x - half_length, y, 0.0, speed, 0.0, half_length, half_width)
        heading = math.remainder(heading, math.tau)
        c, s = math.cos(heading), math.sin(heading)
        return Mover(
            name,
            x - half_length * c,
            y - half_length * s,
            heading,
            speed * c,
            speed * s,
            half_length * abs(c) + half_width * abs(s),
            half_length * abs(s) + half_width * abs(c),
        )


def bumper_gap(me: Mover, other: Mover) -> float:
    """Free road from the ego's front to the rear of a vehicle ahead, m; negative when they are side by side."""
    return other.x - me.x - other.half_length - me.half_length


def gap_behind(me: Mover, other: Mover) -> float:
    """Free road from the front of a vehicle behind to the ego's rear, m; negative when they are side by side."""
    return me.x - other.x - other.half_length - me.half_length


def lateral_overlap(me: Mover, other: Mover) -> float:
    """Width of the strip along the road that both bodies share, m; negative: their distance across."""
    mine, its = me.half_width, other.half_width
    return min(mine + its - abs(me.y - other.y), 2.0 * mine, 2.0 * its)


def lead_in_path(me: Mover, others: Iterable[Mover]) -> Mover | None:
    """The nearest vehicle ahead whose body reaches into the strip of road that the ego's body sweeps straight ahead.

    A vehicle behind that lead is not the lead: it is hidden until the first one has left the strip.
    """
    nearest: Mover | None = None
    for other in others:
        if other.x > me.x and (nearest is None or other.x < nearest.x) and lateral_overlap(me, other) > 0.0:
            nearest = other
    return nearest


def neighbours(me: Mover, others: Iterable[Mover], centre: float, width: float) -> Neighbours:
    """Nearest vehicles ahead and behind whose body reaches into the strip `width` m wide around y = `centre`."""
    ahead: Mover | None = None
    behind: Mover | None = None
    for other in others:
        if abs(other.y - centre) >= 0.5 * width + other.half_width:
            continue
        beside = abs(other.x - me.x) < other.half_length + me.half_length
        if (other.x > me.x or beside) and (ahead is None or other.x < ahead.x):
            ahead = other
        if (other.x <= me.x or beside) and (behind is None or other.x > behind.x):
            behind = other
    return Neighbours(ahead, behind)


def visible(me: Mover, others: Sequence[Mover], hiding_share: float) -> tuple[Mover, ...]:
    """The vehicles that no single nearer vehicle ahead covers by more than `hiding_share` of their width.

    Lines of sight run along the road: seen from far away, a vehicle hides what lies straight behind it. With 0 a
    vehicle is seen once nothing covers any of it (a sensor that needs the whole contour), with 0.5 once half shows.
    """
    if len(others) < 2:
        return tuple(others)
    seen = []
    for other in others:
        least = 2.0 * other.half_width * hiding_share
        for nearer in others:
            if me.x < nearer.x < other.x and lateral_overlap(nearer, other) > least:
                break
        else:
            seen.append(other)
    return tuple(seen)
