"""The motion of an ego as SUMO shows it: read after each step, and checked.

SUMO moves the ego of an ADS that drives by TraCI calls, or that is one of SUMO's own models. A call
can put an ego anywhere. Motion that no vehicle can do therefore ends the case as `ads_error`; of
SUMO's own models, and where SUMO itself shifts the ego, it is only noted. Where the harness's
vehicle model moves the ego, SUMO must show the ego where it was put.

`Stage.read_at_once` takes in an ego that drove straight ahead; this file reads all others.

Fixed: signs and order of operations, which decide the last bits of recorded values; tolerances,
which decide what ends a case; names of clips, which recordings hold.

Users: `cosim/on_traci.py`.
"""

import cmath
from collections.abc import Sequence
from math import cos, dist, hypot, radians, remainder, sin, sqrt, tau
from typing import Any

import numpy as np

from sumo_eval.cosim.doors.traci_module import GUARD
from sumo_eval.cosim.impossible import (
    FASTEST,
    JUMP_TOLERANCE,
    LIMIT_TOLERANCE,
    LOST,
    LOWEST_SPEED,
    LeftTheRoadError,
    impossible,
    leaves_the_lanes,
)
from sumo_eval.cosim.records import MAP, NEXT, STRAIGHT, SUMO, first_number
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.sumo.sections import vehicle_edges
from sumo_eval.cosim.sumo.sumo_files import EGO, gripped
from sumo_eval.cosim.world import World
from sumo_eval.errors import ControllerError, SimulationError
from sumo_eval.scenario.road.reference_line import curvatures, end_curvatures, frame_places
from sumo_eval.scenario.touch import Body

_SIDEWAYS_SPEED = 3.0  # m/s across, the fastest lane change that counts as driving
_SHARPEST = 25.0  # m/s2 across, which no vehicle exceeds at `_SIDEWAYS_SPEED` or above
_ALONG = 0.5  # rad, largest heading at which SUMO finds a vehicle's lane
_PLACE_TOLERANCE = 1e-3  # m
_NEAR_END = 20.0  # m, more than a vehicle drives in two steps
_AT_END = 0.1  # m before the end of a lane, where SUMO stops a vehicle
# share of speed * step by which motion in a curve may differ: SUMO's lanes are stretched polylines
_CHORD_SHARE = 0.03

# indices among the numbers of an ego; `stale` has two meanings, see `records.EGO`
X, Y, HEADING = (first_number(name) for name in ("x", "y", "heading"))
SPEED, ACCELERATION = first_number("speed"), first_number("acceleration")
_FRONT_X, _FRONT_Y = first_number("front_x"), first_number("front_y")
PLACED, STALE = first_number("placed"), first_number("stale")
# The ego's speed along its lane, as SUMO counts it, after the last step. A plant (the vehicle's
# FMU) keeps the speed of its next state here, from its step until the ego is moved.
_LANE_SPEED = NEXT.start + 3


class EgoMotion:
    """The motion of the ego of one case.

    native: whether SUMO's own model drives, whose impossible motion is only noted.
    mine: the ego's record in the world, as an array of one.
    state: the numbers of an `EGO` (`records.numbers_of`), by the indices of this file and of
        `records.py`.
    flags: the same bytes as whole numbers, for the fields of `records.flags`.
    curvature: 1/m, of the road's line beside the ego.
    """

    def __init__(self, world: World, stage: Stage, case: int, *, native: bool) -> None:
        self._world, self._case, self._native = world, case, native
        self._stage, self._calls = stage, stage.calls
        self.ego = stage.names[case][0]
        self.limits = gripped(world.each[case].vehicle)
        self._half = 0.5 * self.limits.length
        self._step = world.settings.step
        self.road = world.cases[case].road
        self._bent = self.road.bent
        # 1/m, at both ends of the pieces of the road's line, and 0
        self._curvatures = {0.0, *end_curvatures(self.road.line)}
        self.curvature = 0.0
        # of the last motion that was read here: the value of the world's `steps` before it, and its
        # direction relative to the road, rad
        self._course = 0, 0.0
        # x of its lane's end, m; in a curve the error is smaller than `_NEAR_END`
        self._lane_end = 0.0
        self._lanes = 0, 0  # on a curved road: its lane before and after the last step

    def watch(self, world: World, row: int) -> None:
        """Use this row of the world's arrays from now on."""
        self.mine = world.egos[row : row + 1]
        # memory views: to read one number of them takes a tenth as long as of an array
        self.state: Any = self.mine.view(np.float64).reshape(-1).data
        self.flags: Any = self.mine.view(np.int64).reshape(-1).data

    def lead_along_lane(self) -> None:
        """Reroute an ego along its lane where its route leaves the lane: SUMO would stop it there.

        The route stays if the ego brakes at least as hard as SUMO's own model would.
        """
        vehicle = self._stage.traci.vehicle
        ego = self.ego
        if not self._may_pass_lane_end():
            return
        ending = ego[len(EGO) :]  # of all names of its case in SUMO, `_3` of `ego_3`
        edges = tuple(f"{it}{ending}" for it in vehicle_edges(self.road, self.state[Y]))
        route = vehicle.getRoute(ego)
        index = vehicle.getRouteIndex(ego)
        following = slice(index + 1, index + 2)  # the next edge, none after the last one
        too_fast = vehicle.getSpeed(ego) > vehicle.getSpeedWithoutTraCI(ego)
        if too_fast and edges[following] != route[following]:
            vehicle.setRoute(ego, edges[index:])

    def _may_pass_lane_end(self) -> bool:
        """Whether SUMO may move the ego past the end of its lane in this step."""
        front_x = self.state[X] + self._half
        step = self._step
        if front_x < self._lane_end - _NEAR_END:  # the common case, without a call of SUMO
            return False
        self._lane_end = front_x + _to_lane_end(self._stage, self.ego)
        reach = step * (self.state[_LANE_SPEED] + self.limits.max_acceleration * step)
        return bool(self._lane_end <= front_x + reach)

    def read(self, now: float) -> None:
        """Read the ego that SUMO moved; where the vehicle model moves it, SUMO must show the same.

        now: time at the end of the step, s.
        """
        state = self.state
        if self.flags[PLACED] != SUMO:
            self._check_placed_ego(now)
        else:
            self._read_driven_ego(now)
        on_lanes = (
            self.road.right_edge <= state[Y] <= self.road.left_edge and abs(state[HEADING]) < _ALONG
        )
        if GUARD.shared and not on_lanes:  # the row leaves its batch
            raise SimulationError("An ego off its lanes may lie on another case's road.")

    def _check_placed_ego(self, now: float) -> None:
        """Raise SimulationError unless SUMO shows the ego where the vehicle model has put it."""
        state = self.state
        # without a speed in `GUARD`, calls for the ego's speed and position ask SUMO again
        GUARD.speeds.pop(self.ego, None)
        state[_LANE_SPEED] = state[SPEED]
        self._course = self._world.steps, state[HEADING]
        front_x, front_y = state[_FRONT_X], state[_FRONT_Y]
        x, y = self._stage.fronts[self.ego]
        # `not <=`: true of nan as well
        if not (abs(x - front_x) <= _PLACE_TOLERANCE and abs(y - front_y) <= _PLACE_TOLERANCE):
            raise SimulationError(
                f"SUMO put the ego's front bumper at ({x:.3f}, {y:.3f}) m instead of "
                f"({front_x:.3f}, {front_y:.3f}) m at {now:.2f} s."
            )

    def _read_driven_ego(self, now: float) -> None:
        """Take in the ego as SUMO moved it.

        SUMO gives the speed along the lane, on a curved road along the road's line, and the speed
        across. Both make the speed over the ground.
        """
        state = self.state
        half = self._half
        (front_x, front_y), heading, lane_speed = self._shown(now)
        last_speed = state[SPEED]
        last_x, last_y, last_heading = state[MAP : MAP + 3]
        # SUMO inserts the ego along its lane, whatever its heading in the case
        heading_before = last_heading
        if not self._world.steps:
            heading_before = last_heading - state[HEADING]
            state[HEADING] = 0.0
        # motion of the front bumper
        moved_x = front_x - last_x - half * cos(heading_before)
        moved_y = front_y - last_y - half * sin(heading_before)
        pose: tuple[float, ...] = (
            front_x - half * cos(heading), front_y - half * sin(heading), heading
        )  # fmt: skip
        state[MAP], state[MAP + 1], state[MAP + 2] = pose
        if self._bent:
            pose, moved_x, moved_y = self._along_curve(pose, moved_x, moved_y, lane_speed)
        self._check_motion(moved_x, moved_y, lane_speed, now)
        self._check_course(pose, now)
        acceleration = (lane_speed - state[_LANE_SPEED]) / self._step
        state[_LANE_SPEED] = lane_speed
        if self.flags[STALE]:  # the first step in which SUMO moves the ego
            self.flags[STALE] = 0
            self._note_turn(heading, last_heading, last_speed)
        speed = lane_speed * (1.0 - self.curvature * pose[1]) if self._bent else lane_speed
        if self._bent or moved_y != 0.0 or heading != 0.0:
            speed = _over_ground(speed, self._calls.getLateralSpeed(self.ego), now)
        state[X], state[Y], state[HEADING] = pose
        state[SPEED], state[ACCELERATION] = speed, acceleration

    def _shown(self, now: float) -> tuple[tuple[float, float], float, float]:
        """Front bumper of the ego on the map, m, heading, rad, and speed along its lane, m/s, as
        SUMO shows them.

        Raises LeftTheRoadError if SUMO has lost the ego beside its lanes; ControllerError or
        SimulationError for other impossible values.
        """
        calls, ego = self._calls, self.ego
        front_x, front_y = self._stage.fronts[ego]
        speed = self._stage.speeds[ego]
        angle = calls.getAngle(ego)
        if not (
            -LOST < front_x < LOST
            and -LOST < front_y < LOST
            and LOWEST_SPEED < speed < FASTEST
            and 0.0 <= angle <= 360.0
        ):
            sizes = self.limits.length, self.limits.width
            x, y, heading = self.state[:3]
            last = Body(x, y, heading, self.state[SPEED], *sizes)
            if front_x <= -LOST and leaves_the_lanes(last, self.road, self._step):
                raise LeftTheRoadError
            x, y, heading = self.state[MAP : MAP + 3]
            front = last._replace(x=x, y=y, heading=heading).moved(self._half)[:2]
            fault = impossible(calls, ego, front, now)
            raise ControllerError(f"The ADS is responsible: {fault}") if GUARD.moved else fault
        return (front_x, front_y), remainder(radians(STRAIGHT - angle), tau), speed

    def _along_curve(
        self, on_map: Sequence[float], moved_x: float, moved_y: float, speed: float
    ) -> tuple[tuple[float, ...], float, float]:
        """The ego relative to the line of a curved road: x, y and heading, and the motion of its
        front bumper along and across the line in this step, m.

        on_map: x, y and heading on the map. moved_x, moved_y: motion on the map, m.
        speed: along the line, m/s.
        """
        state, line = self.state, self.road.line
        x, y, heading = on_map
        pose = tuple(float(it) for it in frame_places(line, x, y, heading, near=state[X]))
        self.curvature = float(curvatures(line, pose[0]))
        self._lanes = self._lanes[1], self._calls.getLaneIndex(self.ego)
        across = pose[1] - state[Y] + self._half * (sin(pose[2]) - sin(state[HEADING]))
        moved = sqrt(max(moved_x**2 + moved_y**2 - across**2, 0.0))
        # SUMO stretches each lane evenly over its whole length, so a motion on the map has no exact
        # length along the line. It is between those at the road's curvatures: take the length in
        # this range that is nearest to speed * step.
        lengths = [moved / (1.0 - k * pose[1]) for k in self._curvatures]
        return pose, min(max(speed * self._step, min(lengths)), max(lengths)), across

    def _note_turn(self, heading: float, last_heading: float, last_speed: float) -> None:
        """Note that SUMO turned the ego into its lane, if it did so by more than rounding and the
        road's own curve.
        """
        turned = abs(remainder(heading - last_heading, tau))
        if turned > 1e-3 + abs(last_speed * self._step * self.curvature):
            self._world.note(self._case, "heading", last_heading, heading)

    def _check_motion(self, ahead: float, across: float, speed: float, now: float) -> None:
        """Refuse motion that no vehicle can do, as TraCI calls may cause it.

        ahead, across: motion of the front bumper in the step, m.
        speed: along the lane, m/s.
        now: time, s.
        """
        step = self._step
        sideways = _SIDEWAYS_SPEED * step
        lane_speed = self.state[_LANE_SPEED]  # a step ago
        self._check_acceleration((speed - lane_speed) / step, now, stands=speed == 0.0)
        # the motion must fit a speed between the old and the new one
        slower, faster = (speed, lane_speed) if speed < lane_speed else (lane_speed, speed)
        tolerance = JUMP_TOLERANCE + (_CHORD_SHARE * faster * step if self._bent else 0.0)
        least, most = slower * step - tolerance, faster * step + tolerance
        fits_ahead = least <= ahead <= most
        if fits_ahead and -sideways <= across <= sideways:
            return
        moved = hypot(ahead, across)
        possible = min(max(moved, least), most)
        # SUMO itself moves an ego to a lane's centre, and shifts it ahead or back where it changes
        # lanes in a curve
        by_sumo = fits_ahead and self._put_on_centre()
        if not by_sumo and self._lanes[0] != self._lanes[1]:
            apart = _lanes_apart(self._stage, self.ego, self._lanes, self.road.lane_width)
            by_sumo = abs(moved - possible) <= apart
        if by_sumo:
            self._world.note(self._case, "jump", moved, possible)
        elif moved != possible:  # if equal, only the direction is odd: `_check_course` checks it
            self._unphysical(
                "jump", moved, possible,
                f"The ADS moved its vehicle {moved:.2f} m in a step that its speed limits to "
                f"{max(least, 0.0):.2f}..{most:.2f} m, at {now:.2f} s (moveToXY needs a setSpeed "
                "to go with it).",
            )  # fmt: skip

    def _check_acceleration(self, acceleration: float, now: float, *, stands: bool) -> None:
        """Refuse an acceleration that no vehicle can have, m/s2; note one at a limit.

        stands: whether the ego stands at the end of the step.
        """
        lowest, highest = -self.limits.max_deceleration, self.limits.max_acceleration
        if not lowest - LIMIT_TOLERANCE <= acceleration <= highest + LIMIT_TOLERANCE:
            # SUMO stops a vehicle at once where its lane ends: the ego has left the road, unless a
            # call put it there. Of SUMO's own model the stop is only noted, by `_unphysical`.
            at_end = stands and _to_lane_end(self._stage, self.ego) < _AT_END
            if at_end and not (GUARD.placed or self._native):
                raise LeftTheRoadError
            self._unphysical(
                "unphysical_acceleration", acceleration, min(max(acceleration, lowest), highest),
                f"The ADS must drive its vehicle within {lowest:g}..{highest:g} m/s2, "
                f"got {acceleration:.1f} m/s2 at {now:.2f} s.",
            )  # fmt: skip
        # at a limit: SUMO may have held the vehicle back
        elif not lowest + LIMIT_TOLERANCE <= acceleration <= highest - LIMIT_TOLERANCE:
            self._world.note(self._case, "vtype_limit", acceleration, acceleration)

    def _put_on_centre(self) -> bool:
        """Whether SUMO moved the ego to its lane's centre within the step, as at the end of a lane
        change that did not begin at a centre.

        False in a batch, and after a call that has placed the ego. If an error follows in a batch,
        the case leaves it and is driven alone.
        """
        placed = GUARD.shared or GUARD.placed
        return not placed and self._calls.getLateralLanePosition(self.ego) == 0.0

    def _check_course(self, pose: Sequence[float], now: float) -> None:
        """Refuse fast sideways motion into which no vehicle can turn.

        pose: the new x, y and heading, relative to the road.
        """
        old, new = (
            complex(x, y) + cmath.rect(self._half, heading)  # the front bumper, x + y i, m
            for x, y, heading in (self.state[:3], pose)
        )
        moved = new - old
        step = self._step
        course = cmath.phase(moved)
        last_step, last_course = self._course
        if last_step < self._world.steps - 1:  # since then it drove straight ahead
            last_course = 0.0
        self._course = self._world.steps, course
        # lateral acceleration, m/s2: speed times rate of turning
        sharp = abs(moved * remainder(course - last_course, tau)) / step**2
        too_sharp = abs(moved.imag) > _SIDEWAYS_SPEED * step and sharp > _SHARPEST
        if too_sharp and not self._put_on_centre():
            self._unphysical(
                "unphysical_turn", sharp, _SHARPEST,
                f"The ADS must turn its vehicle within {_SHARPEST:g} m/s2, got {sharp:.1f} m/s2 "
                f"at {now:.2f} s.",
            )  # fmt: skip

    def _unphysical(self, what: str, requested: float, possible: float, sentence: str) -> None:
        """Raise ControllerError for impossible motion; if SUMO's own model drives, only record it.

        what: name of the clip. requested, possible: its values.
        """
        if not self._native:
            raise ControllerError(sentence)
        if what == "jump" and not requested < FASTEST * self._step:  # `not <`: true of nan as well
            raise SimulationError(
                f"SUMO moved vehicle `{EGO}` {requested:g} m in the step after "
                f"{self._world.time:.2f} s."
            )
        self._world.note(self._case, what, requested, possible)


def _to_lane_end(stage: Stage, ego: str) -> float:
    """Distance from the ego's front bumper to the end of its lane, m; `ego`: its name in SUMO."""
    vehicle, lane = stage.traci.vehicle, stage.traci.lane
    return float(lane.getLength(vehicle.getLaneID(ego)) - vehicle.getLanePosition(ego))


def _lanes_apart(stage: Stage, ego: str, lanes: tuple[int, int], width: float) -> float:
    """Distance along a curve, m, between the places of the ego's position on its old and on its new
    lane.

    SUMO stretches each lane evenly, so equal positions on two lanes are not side by side.

    ego: its name in SUMO. lanes: numbers of the old and the new one. width: of a lane, m.
    """
    vehicle = stage.traci.vehicle
    edge, at = vehicle.getRoadID(ego), vehicle.getLanePosition(ego)
    old, new = lanes
    apart = dist(*(stage.traci.simulation.convert2D(edge, at, lane) for lane in lanes))
    return sqrt(max(apart**2 - (width * (new - old)) ** 2, 0.0))


def _over_ground(speed: float, sideways: float, now: float) -> float:
    """Speed over the ground of a speed along the lane and SUMO's speed across it, all in m/s."""
    if not -FASTEST < sideways < FASTEST:
        raise SimulationError(
            f"SUMO gave vehicle `{EGO}` the speed {sideways:g} m/s across at {now:.2f} s."
        )
    return hypot(speed, sideways) if sideways else speed
