"""Recordings of ended cases, made of the samples, contacts and clips that the world holds.

Users: `cosim/loop.py`, `cosim/simulation.py`.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from sumo_eval.cosim.contact import describe
from sumo_eval.cosim.records import REASONS, TO_ITS_END, WHATS
from sumo_eval.cosim.world import World
from sumo_eval.scenario.concrete import Actor, departures
from sumo_eval.scenario.played import BEGUN, FOLLOW, WAITS
from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.touch import Body
from sumo_eval.settings import VehicleSettings
from sumo_eval.text import clean, clean_log
from sumo_eval.trajectory import Alone, Clip, Collision, Recording, Trajectory


def end_case(world: World, row: int) -> None:
    """Keep the recording and the notes of a case that has ended."""
    ego = world.egos[row]
    case = world.case_of(row)
    world.egos["live"][row] = 0
    world.going -= 1
    reason = REASONS[ego["reason"]]
    assert reason is not None
    if reason in TO_ITS_END:
        _note_waiting(world, row, case)
    _note_missed_goal(world, row, case)
    if world.cases[case].ego.recorded:
        _note_departure(world, row, case)
        _note_reactions(world, row, case)
    actors = world.cases[case].actors
    hit = _collision(world, row, actors) if reason == "contact" else None
    # Only an actor with a SUMO model is at fault: it reacts to the ego. A script sees no ego.
    if hit is not None and hit.side == "rear" and actors[ego["struck"]].model is not None:
        # m/s, and for how long, s, the ego was in its lane
        world.note(case, "struck_from_behind", hit.relative_speed, _in_its_lane_for(world, row))
    counts = world.others["samples"][row].tolist()
    world.ended[case] = partial(
        Recording,
        _trajectory(world, row, 0, ego["samples"], world.settings.vehicle),
        {it.name: _trajectory(world, row, 1 + j, counts[j], it) for j, it in enumerate(actors)},
        hit,
        reason,
        _clips(world, row, case),
        commands=None if hit is None else world.commands[row, : world.steps].copy(),
    )


def make_recordings(world: World, wall_time: float, batched: str = "") -> list[Recording | Alone]:
    """The recording of each case, or why it has to be driven alone.

    wall_time: of all cases together, s.
    batched: `Recording.batched` of each.
    """
    latencies = world.latencies.of_cases()
    recordings: list[Recording | Alone] = []
    for case in range(len(world.cases)):
        if case in world.left:
            recordings.append(world.left[case])
            continue
        error = world.errors.get(case)
        # the fields of a `Recording` after those that `end_case` has given
        recordings.append(world.ended[case](
            None if error is None else clean(error), clean_log(world.logs[case]),
            latencies[case], wall_time / len(world.cases), world.places[case],
            batched,
        ))  # fmt: skip
    return recordings


def _note_waiting(world: World, row: int, case: int) -> None:
    """Record how many acts still wait for their conditions."""
    acts = world.players.acts[row]
    # a `FOLLOW`, by which SUMO takes over an actor, may wait to the end: not all actors must react
    waiting = (acts["state"] == WAITS) & (acts["kind"] != FOLLOW)
    # an actor with fewer acts than the array has columns uses the first ones
    used = np.arange(waiting.shape[1]) < world.players.plays["acts"][row][:, None]
    if count := int((waiting & used).sum()):
        # acts that still wait, and how many should: none
        world.note(case, "trigger_never_fired", count, 0.0, count=count)


def _note_missed_goal(world: World, row: int, case: int) -> None:
    """Record an ego that is beyond the x by which it had to change lanes, and has not."""
    ego = world.egos[row]
    way = ego["way"]
    # m from the ego to the middle of the lane that it had to change to
    aside = abs(ego["y"] - (way["start"] + way["offset"]))
    half_lane = 0.5 * world.cases[case].road.lane_width
    if way["asked"] and aside > half_lane and ego["x"] >= way["by"]:
        # m: x by which the ego had to be in the lane, y where it is
        world.note(case, "goal_missed", way["by"], ego["y"])


def _note_departure(world: World, row: int, case: int) -> None:
    """Record how far the ego was from the recorded ego."""
    # time, x and y are the first of `CHANNELS`
    time, x, y = world.samples[row, 0, : world.egos["samples"][row], :3].T
    apart = departures(world.cases[case].ego.recorded, time, x, y)  # m, at each time
    most = apart.argmax()
    # m: largest distance, distance at the end
    world.note(case, "departed", apart[most], apart[-1], first=float(time[most]))


def _note_reactions(world: World, row: int, case: int) -> None:
    """Record when SUMO took over actors of a recorded scene, which react from then on."""
    acts = world.players.acts[row]
    begins = acts["begin"][(acts["kind"] == FOLLOW) & (acts["state"] == BEGUN)]
    if len(begins):
        first, last = float(begins.min()), float(begins.max())
        # s: first and last time
        world.note(case, "handed_over", first, last, count=len(begins), first=first)


def _collision(world: World, row: int, actors: Sequence[Actor]) -> Collision:
    """The contact by which a row has ended."""
    ego = world.egos[row]
    x = float(ego["x"])
    struck = int(ego["struck"])
    # the last sample is the instant of the contact
    time = float(world.samples[row, 0, ego["samples"] - 1, 0])
    vehicles = ego, world.others[row, struck]
    bodies = [_in_straight_axes(world, vehicle, x) for vehicle in vehicles]
    return describe(time, actors[struck].name, *bodies)


def _in_straight_axes(world: World, vehicle: Any, x: float) -> Body:
    """A vehicle in the axes that touch the road's line at x, m.

    In a curve, distances between bodies do not follow from their places along and across the line.
    Straight axes keep the distances of the map. At x, both kinds of axes agree.
    """
    # the first fields of a vehicle's record are those of a `Body`
    body = Body(*vehicle.tolist()[:7])
    if not len(world.cast.line):
        return body
    # all cases of a batch have equal roads
    origin = Pose(0.0, 0.0, 0.0).along(world.cases[0].road.line, x)
    ahead, left, turned = Pose(*vehicle["map"].tolist()).seen_from(origin)
    return body._replace(x=x + ahead, y=left, heading=turned)


def _in_its_lane_for(world: World, row: int) -> float:
    """Time since the ego's centre entered its present lane, s."""
    count = world.egos["samples"][row]
    width = world.scenario["road"]["lane_width"][0]
    time, y = world.samples[row, 0, :count, 0], world.samples[row, 0, :count, 2]
    lane = np.round(y / width)  # y = 0 is the middle of lane 0
    elsewhere = np.flatnonzero(lane != lane[-1])
    return float(time[-1] - time[elsewhere[-1]] if len(elsewhere) else time[-1])


def _trajectory(
    world: World, row: int, vehicle: int, count: int, body: VehicleSettings | Actor
) -> Trajectory:
    """The first `count` samples of a vehicle: 0 the ego, then the actors."""
    block = world.samples[row, vehicle, :count].T.copy()
    return Trajectory.of_block(block, length=body.length, width=body.width)


def _clips(world: World, row: int, case: int) -> tuple[Clip, ...]:
    """The clips that kernels counted in a row, and the notes of its case, by their names."""
    counted = np.flatnonzero(world.clips["count"][row])
    clips = [Clip(WHATS[what], *world.clips[row, what].tolist()) for what in counted]
    # a note has the fields of a clip after `what`, in their order
    clips += [Clip(what, *vars(note).values()) for what, note in world.notes[case].items()]
    return tuple(sorted(clips, key=lambda clip: clip.what))
