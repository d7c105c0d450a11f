"""`careful_driver` in many cases at once: the same decisions as in `r157_careful_driver`, on arrays, to the last bit.

Arrays are (n, m) for n cases with m other vehicles each, nan where the plain driver holds None.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.r157 import FOLLOWING_HEADWAY, HEADWAY_ROUNDING
from sumo_eval.ads.r157_careful_driver import CUT_IN_TTC, DRIVER_BRAKES, CarefulDriver
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.packed import PackedCommand, PackedScene
from sumo_eval.trajectory import BoolArray, FloatArray

Moved = tuple[FloatArray, FloatArray]
"""`braking.Braked` of many cases: speed taken off, m/s, and deceleration at the end, m/s2."""

_MEMORIES = (
    "_lane", "_offset", "_speed", "_braking", "_strayed", "_braked", "_evaluated", "_necessary", "_level", "_brakes",
    "_owed",
)  # fmt: skip


class PackedCarefulDriver:
    """Performance model 1 of UN R157 at the wheel of n egos."""

    def __init__(self, driver: CarefulDriver, scenario: Briefing) -> None:
        self._driver = driver
        self._step = scenario.step
        self._lane_width = scenario.road.lane_width
        self._rate = scenario.vehicle.brake_jerk
        strongest = scenario.vehicle.max_deceleration
        self._strongest = min(DRIVER_BRAKES.level, strongest) if DRIVER_BRAKES.rise < self._rate else strongest
        self._began = False

    def settled(self) -> BoolArray:
        """Where it brakes for nothing, nor is about to, (n,)."""
        return np.asarray(np.isnan(self._necessary).all(axis=1))

    def step(self, scene: PackedScene, time: float) -> PackedCommand:
        """Braking for the vehicle that made it necessary first, else none; the wheel stays straight."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return PackedCommand(self._wanted(scene, time), np.zeros(len(scene.x)))

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Remember these cases alone."""
        for name in _MEMORIES:
            setattr(self, name, getattr(self, name)[rows])

    def _begin(self, scene: PackedScene, time: float) -> None:
        cases = len(scene.x)
        self._level, self._brakes, self._owed = np.zeros(cases), np.zeros(cases), np.zeros(cases)
        nothing = np.full(scene.other_x.shape, np.nan)
        self._lane = self._lane_width * np.round(scene.other_y / self._lane_width)
        self._offset = np.zeros(scene.other_x.shape)
        self._time = time
        self._speed = scene.other_along.copy()
        self._strayed, self._braked = nothing.copy(), nothing.copy()
        self._evaluated, self._necessary = nothing.copy(), nothing.copy()

    def _wanted(self, scene: PackedScene, time: float) -> FloatArray:
        if not self._began:
            self._begin(scene, time)
        driver, step = self._driver, self._step
        self._look(scene, time)

        x, y, speed = scene.x[:, None], scene.y[:, None], scene.along[:, None]
        half_length, half_width = scene.half_length[:, None], scene.half_width[:, None]
        gap = scene.other_x - x - scene.other_half_length - half_length
        widths = np.minimum(2.0 * half_width, 2.0 * scene.other_half_width)
        overlap = np.minimum(half_width + scene.other_half_width - np.abs(y - scene.other_y), widths)
        ahead = scene.other_x > x
        closing = speed - scene.other_along
        own_lane = np.abs(self._lane - y) < 0.5 * self._lane_width
        towards = ~np.isnan(self._strayed) & ~own_lane & (self._offset * (y - self._lane) > 0.0)

        over = ~ahead | ((overlap <= 0.0) & ~towards) | ((speed <= scene.other_along) & (self._braking <= 0.0))
        over &= ~np.isnan(self._necessary)
        for memory in (self._braked, self._evaluated, self._necessary):
            memory[over] = np.nan

        left = np.where(closing > 0.0, gap / closing, np.inf)
        evaluated = self._strayed + driver.evaluation
        cut_in = ahead & np.isnan(self._necessary) & towards & (left > 0.0) & (left < CUT_IN_TTC)
        cut_in &= time >= evaluated - 0.5 * step
        necessary = np.maximum(evaluated, time - np.minimum(CUT_IN_TTC - left, step))
        self._necessary = np.where(cut_in, necessary, self._necessary)

        near = np.where(speed > 0.0, gap / speed, np.inf) <= FOLLOWING_HEADWAY + HEADWAY_ROUNDING
        late = self._seen_late(scene, time, gap, speed)
        self._judge_path(scene, time, ahead, overlap > 0.0, towards, own_lane, closing > 0.0, near, late)
        self._began = True

        first = np.min(np.where(ahead & ~np.isnan(self._necessary), self._necessary, np.inf), axis=1)
        ends = np.minimum(self._brakes_end(ahead, closing), step)
        begins = (first + driver.reaction) - time
        lost = _lost(ends - begins) - _lost(-begins)
        released, level = self._moved(_at(ends - begins), 0.0, step - ends)
        earlier, earlier_level = self._moved(self._level, 0.0, step)
        self._level = np.maximum(level, earlier_level)
        return -self._command(np.maximum(lost + released, earlier), np.isinf(first) | (ends < step))

    def _brakes_end(self, ahead: BoolArray, closing: FloatArray) -> FloatArray:
        """`CarefulDriver._brakes_end`, (n,)."""
        calls = ahead & ~np.isnan(self._necessary)
        never = (calls & (self._braking > 0.0)).any(axis=1) | (self._level <= 0.0) | ~calls.any(axis=1)
        ends = np.maximum(np.where(calls, closing / self._level[:, None], 0.0), 0.0).max(axis=1)
        ends = np.where(never | (ends >= self._step), np.inf, ends)
        over = calls & np.isfinite(ends)[:, None]
        for memory in (self._braked, self._evaluated, self._necessary):
            memory[over] = np.nan
        return np.asarray(ends)

    def _moved(self, level: FloatArray, target: FloatArray | float, duration: FloatArray | float) -> Moved:
        """`braking.moved` at the brakes' rate."""
        change = target - level
        reach = self._rate * duration
        end = np.where(change > 0.0, level + reach, level - reach)
        whole = target * duration - 0.5 * change * np.abs(change) / self._rate
        under_way = np.abs(change) >= reach
        return np.where(under_way, 0.5 * (level + end) * duration, whole), np.where(under_way, end, target)

    def _command(self, lost: FloatArray, releases: BoolArray) -> FloatArray:
        """`BrakePath.command`, (n,)."""
        before, step, rate = self._brakes, self._step, self._rate
        open_ = releases & (before == 0.0) & (lost == 0.0)
        spare = step - before / rate
        until_open = lost + self._owed + 0.5 * self._level * self._level / rate
        square = spare * spare + 4.0 * (until_open - 0.5 * before * before / rate) / rate
        releasing = np.where(square > 0.0, 0.5 * rate * (np.sqrt(np.maximum(square, 0.0)) - spare), 0.0)
        releasing = np.minimum(np.maximum(releasing, 0.0), before)
        mean = (lost + self._owed) / step
        change = np.abs(mean - before)
        square = step * step - 2.0 * change * step / rate
        told = np.where(square > 0.0, rate * (step - np.sqrt(np.maximum(square, 0.0))), rate * step)
        braking = np.where(change == 0.0, before, np.where(mean > before, before + told, before - told))
        braking = np.minimum(np.maximum(braking, 0.0), self._strongest)
        told = np.where(open_, 0.0, np.where(releases, releasing, braking))
        takes, after = self._moved(before, told, step)
        self._brakes = np.where(open_, before, after)
        self._owed = np.where(open_, 0.0, self._owed + (lost - takes))
        return np.asarray(told)

    def _look(self, scene: PackedScene, time: float) -> None:
        driver = self._driver
        self._braking = (self._speed - scene.other_along) / self._step
        self._speed = scene.other_along.copy()
        offset = scene.other_y - self._lane
        strays = np.isnan(self._strayed) & (np.abs(offset) > driver.wander)
        share = (driver.wander - np.abs(self._offset)) / (np.abs(offset) - np.abs(self._offset))
        self._strayed = np.where(strays, self._time + share * (time - self._time), self._strayed)
        brakes = np.isnan(self._braked) & (self._braking > driver.lead_braking)
        self._braked = np.where(brakes, time - self._step, self._braked)
        self._offset, self._time = offset, time

    def _seen_late(self, scene: PackedScene, time: float, gap: FloatArray, speed: FloatArray) -> FloatArray:
        """When approaching a vehicle in the path came to need too much, s; nan where it does not."""
        limit, step = self._driver.in_path_limit, self._step
        needed = self._needed(gap, speed, scene.other_along)
        share = np.ones(needed.shape)
        if self._began:
            x, my_speed = _after(scene.x, scene.along, self._level, -step)
            other_x, other_speed = _after(scene.other_x, scene.other_along, self._braking, -step)
            earlier_gap = other_x - x[:, None] - scene.other_half_length - scene.half_length[:, None]
            earlier = self._needed(earlier_gap, my_speed[:, None], other_speed)
            share = np.where(earlier < limit, (limit - earlier) / (needed - earlier), 0.0)
        return np.where(needed > limit, time - (1.0 - share) * step, np.nan)

    def _needed(self, gap: FloatArray, speed: FloatArray, lead_speed: FloatArray) -> FloatArray:
        """`needed_deceleration` with the evaluation and the reaction still to come."""
        delay = self._driver.evaluation + self._driver.reaction
        closing = speed - lead_speed
        room = gap - np.maximum(closing, 0.0) * delay
        needed = np.where(closing <= 0.0, 0.0, np.where(room > 0.0, closing * closing / (2.0 * room), np.inf))
        room = gap + lead_speed * lead_speed / (2.0 * self._braking) - speed * delay
        stopping = np.maximum(needed, np.where(room > 0.0, speed * speed / (2.0 * room), np.inf))
        return np.where(self._braking <= 0.0, needed, stopping)

    def _judge_path(
        self, scene: PackedScene, time: float, ahead: BoolArray, in_path: BoolArray, towards: BoolArray,
        own_lane: BoolArray, closing: BoolArray, near: BoolArray, late: FloatArray,
    ) -> None:  # fmt: skip
        """The vehicles in each ego's lane, nearest first, down to the first that hides what is beyond it."""
        driver = self._driver
        order = np.argsort(np.where(ahead, scene.other_x, np.inf), axis=1, kind="stable")
        rows = np.arange(len(order))
        going = np.ones(len(order), dtype=bool)
        leaves = np.full(len(order), -1, dtype=np.intp)
        for rank in range(order.shape[1]):
            at: tuple[NDArray[np.intp], NDArray[np.intp]] = (rows, order[:, rank])
            going &= ahead[at]
            strayed_lead = np.where(leaves >= 0, self._strayed[rows, leaves], np.nan)
            near_lead = (leaves >= 0) & near[rows, leaves]
            revealed = (leaves >= 0) & closing[at] & ~np.isnan(strayed_lead) & (near_lead | near[at])
            braked = self._braked[at]
            perceived = late[at]
            seen_braking = ~np.isnan(braked) & near[at]
            perceived = np.where(seen_braking, np.maximum(braked, time - driver.evaluation), perceived)
            perceived = np.where(revealed, np.maximum(strayed_lead, time - driver.evaluation), perceived)
            judged = going & in_path[at] & np.isnan(self._necessary[at]) & ~towards[at]
            evaluated = self._evaluated[at]
            evaluated = np.where(judged & np.isnan(evaluated), perceived + driver.evaluation, evaluated)
            self._evaluated[at] = evaluated
            acts = judged & (time >= evaluated - 0.5 * self._step)
            self._necessary[at] = np.where(acts, evaluated, self._necessary[at])
            leaving = ~np.isnan(self._strayed[at]) & own_lane[at]
            leaves = np.where(going & leaving & (leaves < 0), order[:, rank], leaves)
            going &= leaving | ~in_path[at]


def _lost(since: FloatArray) -> FloatArray:
    """`BrakeRamp.lost` of the driver's brakes."""
    level, build_up = DRIVER_BRAKES.level, DRIVER_BRAKES.build_up
    held = level * (since - 0.5 * build_up)
    return np.where(since <= 0.0, 0.0, np.where(since < build_up, 0.5 * level * since * since / build_up, held))


def _at(since: FloatArray) -> FloatArray:
    """`BrakeRamp.at` of the driver's brakes."""
    return np.where(since <= 0.0, 0.0, DRIVER_BRAKES.level * np.minimum(since / DRIVER_BRAKES.build_up, 1.0))


def _after(x: FloatArray, along: FloatArray, braking: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
    """`Mover.after`: x and speed `time` s later."""
    brakes = braking > 0.0
    rolling = np.minimum(time, np.maximum(along, 0.0) / braking)
    slowed = x + rolling * (along - 0.5 * braking * rolling)
    return np.where(brakes, slowed, x + along * time), np.where(brakes, along - braking * rolling, along)
