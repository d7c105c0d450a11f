"""Following a vehicle in many cases at once: `ads.car_following` on arrays, to the last bit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.car_following import COOLNESS, EXPONENT, HEADWAY_RECOVERY, MIN_GAP, MIN_SPEED, IdmParameters
from sumo_eval.ads.elementwise import each
from sumo_eval.ads.lane_change import LanePath
from sumo_eval.ads.packed_lane_change import PackedLanePaths, PackedSteering
from sumo_eval.ads.packed_perception import bumper_gap, first_least, look, of_each
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.packed_controller import PackedCommand, PackedScene
from sumo_eval.trajectory import BoolArray, FloatArray


class PackedIdmParameters(NamedTuple):
    """`IdmParameters` of each case, (n,), and the roots that their formulas hold.

    mixed: 2 sqrt(a b), m/s2. power: 4 a / b.
    """

    headway: FloatArray
    standstill_gap: FloatArray
    acceleration: FloatArray
    deceleration: FloatArray
    mixed: FloatArray
    power: FloatArray

    @classmethod
    def of(cls, parameters: Sequence[IdmParameters]) -> PackedIdmParameters:
        """Those of the cases, in their order."""
        rows = [(each.headway, each.standstill_gap, each.acceleration, each.deceleration) for each in parameters]
        headway, standstill_gap, a, b = np.array(rows).T.copy()
        return cls(headway, standstill_gap, a, b, 2.0 * np.sqrt(a * b), EXPONENT * a / b)

    def at(self, rows: NDArray[np.intp]) -> PackedIdmParameters:
        """Those of some cases."""
        return PackedIdmParameters(*(values[rows] for values in self))


def desired_gap(
    speed: FloatArray, closing_speed: FloatArray, idm: PackedIdmParameters, headway: FloatArray
) -> FloatArray:
    """As `car_following.desired_gap`."""
    wanted = speed * headway + speed * closing_speed / idm.mixed
    return np.asarray(idm.standstill_gap + np.maximum(wanted, 0.0))


def idm_acceleration(
    speed: FloatArray, desired_speed: FloatArray, gap: FloatArray, lead_speed: FloatArray, idm: PackedIdmParameters
) -> FloatArray:
    """As `car_following.idm_acceleration`."""
    free = each(math.pow, speed / np.maximum(desired_speed, MIN_SPEED), EXPONENT)
    crowding = desired_gap(speed, speed - lead_speed, idm, idm.headway) / np.maximum(gap, MIN_GAP)
    return np.asarray(idm.acceleration * (1.0 - free - crowding * crowding))


def free_acceleration(speed: FloatArray, desired_speed: FloatArray, idm: PackedIdmParameters) -> FloatArray:
    """As `car_following.free_acceleration`."""
    wanted = np.maximum(desired_speed, MIN_SPEED)
    gains = speed <= wanted
    ratio = np.where(gains, speed, wanted) / np.where(gains, wanted, speed)
    room = 1.0 - each(math.pow, ratio, np.where(gains, EXPONENT, idm.power))
    return np.asarray(np.where(gains, idm.acceleration, -idm.deceleration) * room)


def enhanced_idm_acceleration(
    speed: FloatArray, desired_speed: FloatArray, gap: FloatArray, lead_speed: FloatArray,
    idm: PackedIdmParameters, headway: FloatArray, lead_braking: FloatArray,
) -> FloatArray:  # fmt: skip
    """As `car_following.enhanced_idm_acceleration`."""
    distance = np.maximum(gap, MIN_GAP)
    closing = speed - lead_speed
    plain = _improved(speed, desired_speed, distance, closing, idm, headway)
    needed = np.where(closing > 0.0, -closing * closing / (2.0 * distance), 0.0)
    if np.count_nonzero(lead_braking):
        behind_braking = _behind_braking(speed, lead_speed, distance, lead_braking, needed)
        needed = np.where(lead_braking > 0.0, behind_braking, needed)
    beyond = np.flatnonzero(plain < needed)
    if beyond.size:
        hard, least, b = plain[beyond], needed[beyond], idm.deceleration[beyond]
        plain[beyond] = (1.0 - COOLNESS) * hard + COOLNESS * (least + b * each(math.tanh, (hard - least) / b))
    return plain


def _improved(
    speed: FloatArray, desired_speed: FloatArray, distance: FloatArray, closing: FloatArray,
    idm: PackedIdmParameters, headway: FloatArray,
) -> FloatArray:  # fmt: skip
    """As `car_following.improved_idm_acceleration`."""
    free = free_acceleration(speed, desired_speed, idm)
    z = desired_gap(speed, closing, idm, headway) / distance
    crowded = np.where(z >= 1.0, idm.acceleration * (1.0 - z * z), 0.0)
    gains = speed <= np.maximum(desired_speed, MIN_SPEED)
    wanted = np.where(gains, crowded, free + crowded)
    roomy = np.flatnonzero(gains & (z < 1.0) & (free > 0.0))
    if roomy.size:
        left = free[roomy]
        wanted[roomy] = left * (1.0 - each(math.pow, z[roomy], 2.0 * idm.acceleration[roomy] / left))
    return wanted


def _behind_braking(
    speed: FloatArray, lead_speed: FloatArray, distance: FloatArray, lead_braking: FloatArray, steady: FloatArray
) -> FloatArray:
    """As `car_following.constant_acceleration_heuristic`; steady: what a lead that keeps its speed calls for."""
    stopping = 2.0 * distance * lead_braking
    stands_first = lead_speed * (speed - lead_speed) <= stopping
    until_it_stands = -speed * speed * lead_braking / (lead_speed * lead_speed + stopping)
    return np.where(stands_first, until_it_stands, -lead_braking + steady)


class PackedFollower:
    """`Follower` for n egos with m others each."""

    def __init__(self, parameters: PackedIdmParameters, step: float, others: int) -> None:
        self._idm = np.array(parameters)
        self._recovery = step / HEADWAY_RECOVERY
        self._accepted = np.full((others, len(parameters.headway)), np.nan)

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these cases, in this order."""
        self._idm = self._idm[:, rows]
        self._accepted = np.ascontiguousarray(self._accepted[:, rows])

    def acceleration(
        self, leads: BoolArray, speed: FloatArray, desired_speed: FloatArray, gap: FloatArray, lead_speed: FloatArray,
        lead_braking: FloatArray,
    ) -> FloatArray:  # fmt: skip
        """Acceleration behind each lead, m/s2, inf behind the others; (m, n). speed, desired_speed: (n,)."""
        wanted = np.full(leads.shape, np.inf)
        places = np.flatnonzero(leads)
        if not places.size:
            return wanted
        cases = places % len(speed)
        idm = PackedIdmParameters(*self._idm.take(cases, axis=1))
        speed, gap, accepted = speed.take(cases), gap.take(places), self._accepted.take(places)
        is_new = np.isnan(accepted)
        if np.count_nonzero(is_new):
            first = np.maximum(gap - idm.standstill_gap, 0.0) / np.maximum(speed, MIN_SPEED)
            accepted = np.where(is_new, np.minimum(idm.headway, first), accepted)
        self._accepted.put(places, accepted + (idm.headway - accepted) * self._recovery)
        behind = enhanced_idm_acceleration(
            speed, desired_speed.take(cases), gap, lead_speed.take(places), idm, accepted, lead_braking.take(places)
        )
        wanted.put(places, behind)
        return wanted


class PackedIdm:
    """The ADS `idm` at the wheel of n egos."""

    def __init__(self, parameters: IdmParameters, scenario: Briefing) -> None:
        self._parameters = parameters
        self._scenario = scenario
        self._began = False
        self._idm: PackedIdmParameters
        self._desired_speed: FloatArray
        self._speeds: FloatArray

    def settled(self) -> BoolArray:
        """Like the plain one, it never says that it is."""
        return np.zeros(len(self._desired_speed), dtype=bool)

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these cases, in this order."""
        self._idm = self._idm.at(rows)
        self._desired_speed = self._desired_speed[rows]
        self._speeds = self._speeds[:, rows]
        self._paths.keep(rows)
        self._steering.keep(rows)

    def step(self, scene: PackedScene, time: float) -> PackedCommand:
        """IDM behind the lead in each path, steering along the lane's centre."""
        with np.errstate(all="ignore"):
            return self._step(scene)

    def _step(self, scene: PackedScene) -> PackedCommand:
        me, others = look(scene)
        if not self._began:
            self._began = True
            road = self._scenario.road
            lanes = [min(max(round(y / road.lane_width), 0), road.lanes - 1) for y in me.y.tolist()]
            self._paths = PackedLanePaths([LanePath(road.lane_centre(lane)) for lane in lanes])
            self._steering = PackedSteering(self._scenario, len(lanes))
            self._idm = PackedIdmParameters.of([self._parameters] * len(lanes))
            self._desired_speed = me.speed
            self._speeds = others.along
        overlap = me.half_width + others.half_width - np.abs(me.y - others.y)
        overlap = np.minimum(np.minimum(overlap, 2.0 * me.half_width), 2.0 * others.half_width)
        ahead = (others.x > me.x) & (overlap > 0.0)
        distance = np.where(ahead, others.x, np.inf)
        lead, there_is_one = first_least(distance, np.zeros(distance.shape)), ahead.any(axis=0)
        gap = np.where(there_is_one, of_each(bumper_gap(me, others), lead), np.inf)
        lead_speed = np.where(there_is_one, of_each(others.along, lead), 0.0)
        strongest, step = self._scenario.vehicle.max_deceleration, self._scenario.step
        braking = np.where(there_is_one, of_each((self._speeds - others.along) / step, lead), 0.0)
        self._speeds = others.along
        now = np.maximum(idm_acceleration(me.speed, self._desired_speed, gap, lead_speed, self._idm), -strongest)
        half = 0.5 * step  # from here on `in_half_a_step`
        later_gap = gap + (lead_speed - me.speed) * half - 0.5 * (braking + now) * half * half
        speed = np.maximum(me.speed + now * half, 0.0)
        lead_speed = np.maximum(lead_speed - braking * half, 0.0)
        wanted = idm_acceleration(speed, self._desired_speed, later_gap, lead_speed, self._idm)
        steering = self._steering.angle(me, self._paths.at(self._steering.rear_axle_next(me)))
        return PackedCommand(np.maximum(wanted, -strongest), steering)
