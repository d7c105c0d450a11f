"""Following or changing lane in many cases at once: `ads.overtaking` on arrays, to the last bit.

What nearly every step holds is computed for all cases together; a lane change that may begin is decided by the plain
`Overtaking` of its case.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.car_following import IdmParameters
from sumo_eval.ads.overtaking import (
    AHEAD_HEADWAY,
    AT_EASE,
    CLEARANCE,
    EMERGENCY_GAP,
    LEAST_LENGTH,
    LEAST_SPEED,
    REAR_DECELERATION,
    REAR_DELAY,
    REAR_HEADWAY,
    SIDE_CLEARANCE,
    SPEED_RESERVE,
    Overtaking,
    OvertakingHabits,
)
from sumo_eval.ads.packed_car_following import PackedFollower, PackedIdmParameters
from sumo_eval.ads.packed_lane_change import PackedLanePaths, smooth_step
from sumo_eval.ads.packed_perception import PackedEgos, PackedMovers, bumper_gap, first_least
from sumo_eval.cosim.controller import Briefing
from sumo_eval.trajectory import BoolArray, FloatArray


class PackedOvertaking:
    """`Overtaking` for n egos.

    paths: where to drive. passing: as of the plain one, (n,).
    """

    def __init__(
        self, habits: Sequence[OvertakingHabits], parameters: Sequence[IdmParameters], scenario: Briefing,
        me: PackedEgos, others: int,
    ) -> None:  # fmt: skip
        n = len(me.x)
        self._plain = [Overtaking(habits[i], parameters[i], scenario, me.of(i)) for i in range(n)]
        self.paths = PackedLanePaths([plain.path for plain in self._plain])
        self.passing = np.zeros(n, dtype=bool)
        self._changing = np.zeros(n, dtype=bool)
        self._stays = ~np.array([plain.has_left_lane for plain in self._plain])  # there is no lane to change to
        self._inclined = np.array([each.inclined for each in habits])
        self._onset_headway, self._onset_ttc, self._duration, self._worth = np.array(
            [(each.onset_headway, each.onset_ttc, each.duration, each.worth) for each in habits]
        ).T.copy()
        self._cruising_speed = me.speed
        self._lane_width = scenario.road.lane_width
        self._half_width = 0.5 * scenario.vehicle.width
        self._emergency_braking = self._plain[0].emergency_braking
        self._quickest, self._evasion = self._plain[0].quickest, self._plain[0].evasion
        self._follower = PackedFollower(PackedIdmParameters.of(parameters), scenario.step, others)

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these cases, in this order."""
        self._plain = [self._plain[row] for row in rows.tolist()]
        self.paths.keep(rows)
        self._follower.keep(rows)
        for name in (
            "passing", "_changing", "_stays", "_inclined", "_onset_headway", "_onset_ttc", "_duration", "_worth",
            "_cruising_speed",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name)[rows])

    def acceleration(
        self, me: PackedEgos, others: PackedMovers, known: BoolArray, rank: FloatArray, desired_speed: FloatArray,
        free: FloatArray,
    ) -> FloatArray:  # fmt: skip
        """As `Overtaking.acceleration`, (n,).

        known: which of the others, (m, n). rank: (m, n), the order in which the plain driver would hold them; where it
        is the same, theirs.
        """
        gap, closing = bumper_gap(me, others), me.along - others.along
        leads = self._in_the_way(me, others, known)
        deciding = np.flatnonzero(leads.any(axis=0) & ~(self._changing | self._stays))
        if deciding.size:
            began, bides = self._decide(me, others, known, rank, leads, gap, closing, deciding)
            if began:
                leads = self._in_the_way(me, others, known)
            leads[:, bides] = False  # nothing calls for following
        behind = self._follower.acceleration(leads, me.speed, desired_speed, gap, others.along, others.braking)
        wanted = free
        for behind_it in behind:
            wanted = np.where(behind_it < wanted, behind_it, wanted)
        if not self._changing.any():
            return wanted
        passed = known & self._changing & self._still_ahead(me, others)
        self.passing = np.asarray(passed.any(axis=0))
        if (self.passing & (wanted > 0.0)).any():
            hindered = self._in_the_way(me, others, passed, SPEED_RESERVE, CLEARANCE).any(axis=0)
            wanted = np.where(hindered & (wanted > 0.0), 0.0, wanted)
        return wanted

    def _in_the_way(
        self, me: PackedEgos, others: PackedMovers, known: BoolArray, faster: float = 0.0, clearance: float = 0.0
    ) -> BoolArray:
        """As `Overtaking._in_the_way`: which of the others, (m, n)."""
        paths, speed = self.paths, me.along + faster
        y = paths.target
        if self._changing.any():
            closing = speed - others.along
            reached = paths.y(me.x + speed * np.maximum(bumper_gap(me, others), 0.0) / closing)
            y = np.where(closing > 0.0, reached, y)
        off = np.abs(y + (me.y - paths.y(me.x)) - others.y)
        return known & (others.x > me.x) & (off < self._half_width + others.half_width + clearance)

    def _decide(
        self, me: PackedEgos, others: PackedMovers, known: BoolArray, rank: FloatArray, leads: BoolArray,
        gap: FloatArray, closing: FloatArray, cases: NDArray[np.intp],
    ) -> tuple[bool, NDArray[np.intp]]:  # fmt: skip
        """Whether a lane change began in any of `cases` (each has a lead), and which of them bide their time."""
        leads, gap, closing, along = leads[:, cases], gap[:, cases], closing[:, cases], me.along[cases]
        nearest = first_least(np.where(leads, gap, np.inf), rank[:, cases]), np.arange(len(cases))
        room = gap - 0.1 * closing
        needed = np.where(room > 0.0, closing * closing / (2.0 * room), np.inf)
        emergency = np.asarray((leads & (closing > 0.0) & (needed > self._emergency_braking)).any(axis=0))
        pays = self._cruising_speed[cases] - others.along[:, cases][nearest] >= self._worth[cases]
        pays &= self._inclined[cases]
        onset = np.maximum(self._onset_headway[cases] * along, self._onset_ttc[cases] * closing[nearest])
        is_time = gap[nearest] <= onset
        rolls = along >= LEAST_SPEED
        began = np.zeros(len(cases), dtype=bool)
        wants = np.flatnonzero(rolls & (emergency | (pays & is_time)))
        if wants.size:
            least = np.where(emergency[wants], self._evasion, self._quickest)
            shortest = np.maximum(least, LEAST_LENGTH / along[wants])
            there = cases[wants]
            able = self._are_passed(me, others, leads[:, wants], gap[:, wants], closing[:, wants], shortest, there)
            able &= self._left_is_free(me, others, known, rank, there, shortest, emergency[wants])
            for index in wants[able].tolist():
                began[index] = self._begins(me, others, known, rank, int(cases[index]))
        bides = np.flatnonzero(rolls & pays & ~is_time & ~began)
        if bides.size:
            there = cases[bides]
            ordinary = np.zeros(len(bides), dtype=bool)
            bides = bides[self._left_is_free(me, others, known, rank, there, self._duration[there], ordinary)]
        return bool(began.any()), cases[bides]

    def _begins(self, me: PackedEgos, others: PackedMovers, known: BoolArray, rank: FloatArray, case: int) -> bool:
        """Let the plain driver of a case decide how long the lane change takes, and so whether it begins."""
        plain = self._plain[case]
        indexes = sorted(np.flatnonzero(known[:, case]).tolist(), key=lambda index: float(rank[index, case]))
        if not plain.begins(me.of(case), [others.of(index, case) for index in indexes]):
            return False
        self.paths.replace(case, plain.path)
        self._changing[case] = True
        return True

    def _are_passed(
        self, me: PackedEgos, others: PackedMovers, leads: BoolArray, gap: FloatArray, closing: FloatArray,
        shortest: FloatArray, cases: NDArray[np.intp],
    ) -> BoolArray:  # fmt: skip
        """Where the shortest lane change would be clear of every lead: where `Overtaking._duration` is not None."""
        widths = others.y[:, cases] + self._half_width + others.half_width[:, cases]
        share = (widths + CLEARANCE - me.y[cases]) / self._lane_width
        late = (share > 0.0) & (closing > 0.0) & (smooth_step(gap / closing / shortest) < share)
        return np.asarray(~(leads & ((share > 1.0) | (gap <= 0.0) | late)).any(axis=0))

    def _left_is_free(
        self, me: PackedEgos, others: PackedMovers, known: BoolArray, rank: FloatArray, cases: NDArray[np.intp],
        duration: FloatArray, emergency: BoolArray,
    ) -> BoolArray:  # fmt: skip
        """As `Overtaking._left_is_free` for some cases; with a longer duration it is no freer."""
        centre = self.paths.start[cases] + self._lane_width
        half_strip = 0.5 * (2.0 * (self._half_width + SIDE_CLEARANCE))
        half_width = others.half_width[:, cases]
        inside = known[:, cases] & (np.abs(others.y[:, cases] - centre) < half_strip + half_width)
        free = np.ones(len(cases), dtype=bool)
        if not inside.any():
            return free
        x, my_x, my_along, rank = others.x[:, cases], me.x[cases], me.along[cases], rank[:, cases]
        along, lengths = others.along[:, cases], others.half_length[:, cases]
        my_length, columns = me.half_length[cases], np.arange(len(cases))
        beside = np.abs(x - my_x) < lengths + my_length
        ahead = inside & ((x > my_x) | beside)
        nearest = first_least(np.where(ahead, x, np.inf), rank), columns
        gap = x[nearest] - my_x - lengths[nearest] - my_length
        left = gap - np.maximum(my_along - along[nearest], 0.0) * duration
        free &= ~(ahead[nearest] & (left < np.where(emergency, EMERGENCY_GAP, AHEAD_HEADWAY * my_along)))
        behind = inside & ((x <= my_x) | beside)
        nearest = first_least(np.where(behind, -x, np.inf), rank), columns
        gap = my_x - x[nearest] - lengths[nearest] - my_length
        closing = np.maximum(along[nearest] - my_along, 0.0)
        least = closing * REAR_DELAY + closing * closing / (2.0 * REAR_DECELERATION) + my_along * REAR_HEADWAY
        free &= ~(behind[nearest] & (gap < np.where(emergency, EMERGENCY_GAP + closing * duration, least)))
        return free

    def _still_ahead(self, me: PackedEgos, others: PackedMovers) -> BoolArray:
        """As `Overtaking._still_ahead`: which of the others, (m, n)."""
        widths = self._half_width + others.half_width
        ahead = (others.x > me.x - me.half_length) & (np.abs(me.y - others.y) < widths + AT_EASE)
        return np.asarray(ahead & (np.abs(self.paths.target - others.y) >= widths))
