"""Following or changing lane in many cases at once: `ads.overtaking` on arrays, to the last bit.

What nearly every step holds is computed for all cases together; a lane change that may begin is decided by the plain
`Overtaking` of its case.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

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
from sumo_eval.ads.packed_perception import (
    PackedEgos,
    PackedMovers,
    PackedNeighbours,
    bumper_gap,
    first_least,
    gap_behind,
    neighbours,
    of_each,
)
from sumo_eval.cosim.controller import Briefing
from sumo_eval.trajectory import BoolArray, FloatArray


class _View(NamedTuple):
    """A step as the drivers know it.

    known: which of the others each one knows, (m, n). rank: (m, n), the order in which the plain driver would hold
    them; where it is the same, theirs. gap, closing: m and m/s, to each of the others, (m, n).
    """

    me: PackedEgos
    others: PackedMovers
    known: BoolArray
    rank: FloatArray
    gap: FloatArray
    closing: FloatArray


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
        self._undecided = np.array([plain.has_left_lane for plain in self._plain])
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
            "passing", "_undecided", "_inclined", "_onset_headway", "_onset_ttc", "_duration", "_worth",
            "_cruising_speed",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name)[rows])

    def acceleration(
        self, me: PackedEgos, others: PackedMovers, known: BoolArray, rank: FloatArray, desired_speed: FloatArray,
        free: FloatArray,
    ) -> FloatArray:  # fmt: skip
        """As `Overtaking.acceleration`, (n,).

        known, rank: as in `_View`.
        """
        view = _View(me, others, known, rank, bumper_gap(me, others), me.along - others.along)
        leads = self._in_the_way(view, known)
        choosing = self._undecided & leads.any(axis=0)
        if np.count_nonzero(choosing):
            began, bides = self._decide(view, leads, choosing)
            if began:
                leads = self._in_the_way(view, known)
            leads &= ~bides  # nothing calls for following
        behind = self._follower.acceleration(leads, me.speed, desired_speed, view.gap, others.along, others.braking)
        wanted = free
        for behind_it in behind:
            wanted = np.where(behind_it < wanted, behind_it, wanted)
        if not self.paths.any_change:
            return wanted
        passed = known & (self.paths.offset != 0.0) & self._still_ahead(me, others)
        self.passing = np.asarray(passed.any(axis=0))
        gaining = self.passing & (wanted > 0.0)
        if np.count_nonzero(gaining):
            gaining &= self._in_the_way(view, passed, SPEED_RESERVE, CLEARANCE).any(axis=0)
            wanted = np.where(gaining, 0.0, wanted)
        return wanted

    def _in_the_way(self, view: _View, known: BoolArray, faster: float = 0.0, clearance: float = 0.0) -> BoolArray:
        """As `Overtaking._in_the_way`: which of the others, (m, n)."""
        me, others, paths = view.me, view.others, self.paths
        if paths.any_change:
            speed = me.along + faster
            closing = speed - others.along
            reached = me.x + speed * np.maximum(view.gap, 0.0) / closing
            *there, here = paths.y(np.concatenate((reached, me.x[None])))
            y = np.where(closing > 0.0, there, paths.target)
        else:
            y = here = paths.start
        off = np.abs(y + (me.y - here) - others.y)
        return np.asarray(known & (others.x > me.x) & (off < self._half_width + others.half_width + clearance))

    def _decide(self, view: _View, leads: BoolArray, choosing: BoolArray) -> tuple[bool, BoolArray]:
        """Whether a lane change began anywhere, and who bides his time, (n,). choosing: who has a lead and a choice."""
        along, closing = view.me.along, view.closing
        nearest = first_least(np.where(leads, view.gap, np.inf), view.rank)
        room = view.gap - 0.1 * closing
        needed = np.where(room > 0.0, closing * closing / (2.0 * room), np.inf)
        emergency = np.asarray((leads & (closing > 0.0) & (needed > self._emergency_braking)).any(axis=0))
        rolls = choosing & (along >= LEAST_SPEED)
        pays = rolls & self._inclined & (self._cruising_speed - of_each(view.others.along, nearest) >= self._worth)
        onset = np.maximum(self._onset_headway * along, self._onset_ttc * of_each(closing, nearest))
        is_time = of_each(view.gap, nearest) <= onset
        wants, bides = (rolls & emergency) | (pays & is_time), pays & ~is_time
        began = False
        if np.count_nonzero(wants):
            shortest = np.maximum(np.where(emergency, self._evasion, self._quickest), LEAST_LENGTH / along)
            wants &= self._are_passed(view, leads, shortest)
        if np.count_nonzero(wants | bides):
            beside = self._neighbours(view)
        if np.count_nonzero(wants):
            wants &= self._left_is_free(view, beside, shortest, emergency)
            for case in np.flatnonzero(wants).tolist():
                if self._begins(view, case):
                    began, bides[case] = True, False
        if np.count_nonzero(bides):
            bides &= self._left_is_free(view, beside, self._duration, np.zeros(len(bides), dtype=bool))
        return began, bides

    def _begins(self, view: _View, case: int) -> bool:
        """Let the plain driver of a case decide how long the lane change takes, and so whether it begins."""
        plain = self._plain[case]
        indexes = np.flatnonzero(view.known[:, case]).tolist()
        indexes.sort(key=lambda index: float(view.rank[index, case]))
        if not plain.begins(view.me.of(case), [view.others.of(index, case) for index in indexes]):
            return False
        self.paths.replace(case, plain.path)
        self._undecided[case] = False
        return True

    def _are_passed(self, view: _View, leads: BoolArray, shortest: FloatArray) -> BoolArray:
        """Where the shortest lane change would be clear of every lead: where `Overtaking._duration` is not None."""
        others, gap, closing = view.others, view.gap, view.closing
        share = (others.y + self._half_width + others.half_width + CLEARANCE - view.me.y) / self._lane_width
        late = (share > 0.0) & (closing > 0.0) & (smooth_step(gap / closing / shortest) < share)
        return np.asarray(~(leads & ((share > 1.0) | (gap <= 0.0) | late)).any(axis=0))

    def _neighbours(self, view: _View) -> PackedNeighbours:
        strip = 2.0 * (self._half_width + SIDE_CLEARANCE)
        return neighbours(view.me, view.others, view.known, view.rank, self.paths.start + self._lane_width, strip)

    def _left_is_free(
        self, view: _View, beside: PackedNeighbours, duration: FloatArray, emergency: BoolArray
    ) -> BoolArray:
        """As `Overtaking._left_is_free`, (n,); with a longer duration it is no freer."""
        my_along, others = view.me.along, view.others
        free = np.ones(len(duration), dtype=bool)
        if np.count_nonzero(beside.has_ahead):
            closing = np.maximum(my_along - of_each(others.along, beside.ahead), 0.0)
            least = np.where(emergency, EMERGENCY_GAP, AHEAD_HEADWAY * my_along)
            free &= ~(beside.has_ahead & (of_each(view.gap, beside.ahead) - closing * duration < least))
        if np.count_nonzero(beside.has_behind):
            closing = np.maximum(of_each(others.along, beside.behind) - my_along, 0.0)
            least = closing * REAR_DELAY + closing * closing / (2.0 * REAR_DECELERATION) + my_along * REAR_HEADWAY
            least = np.where(emergency, EMERGENCY_GAP + closing * duration, least)
            free &= ~(beside.has_behind & (of_each(gap_behind(view.me, others), beside.behind) < least))
        return free

    def _still_ahead(self, me: PackedEgos, others: PackedMovers) -> BoolArray:
        """As `Overtaking._still_ahead`: which of the others, (m, n)."""
        widths = self._half_width + others.half_width
        ahead = (others.x > me.x - me.half_length) & (np.abs(me.y - others.y) < widths + AT_EASE)
        return np.asarray(ahead & (np.abs(self.paths.target - others.y) >= widths))
