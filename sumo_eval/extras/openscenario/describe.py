"""Sentences on an OpenSCENARIO file as it was read, for the command `import`.

Users: `extras/openscenario/command.py`, `extras/openscenario/written.py`.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.acts import changes_nothing
from sumo_eval.extras.openscenario.collections import uses_of
from sumo_eval.extras.openscenario.logical import Read, concrete, concrete_points
from sumo_eval.report.words import count
from sumo_eval.scenario import played
from sumo_eval.scenario.concrete import Actor, Numbers
from sumo_eval.scenario.file import leaving

_SHOWN = 5  # reasons that are listed, at most: the most frequent
_MOST = 5_000  # points; in a space with more, only those along each axis are tried
VERBS = {
    played.SMOOTH: "moves across smoothly", played.CONSTANT: "moves across evenly",
    played.SINUS: "swings", played.COSINE: "moves across along half a cosine",
    played.SPEED: "changes its speed", played.KEEP: "keeps its speed",
    played.BY_TIME: "drives a speed by time", played.BY_PLACE: "drives a speed by place",
    played.PATH: "drives a path", played.MATCH: "keeps a speed relative to another vehicle's",
    played.FOLLOW: "is driven by SUMO's model",
}  # fmt: skip
"""Kind of an act -> words for it."""
Points = Sequence[tuple[dict[str, float], str | None]]
"""Points of a space, each with the reason why it does not play; None: it plays."""


def described(read: Read) -> Iterator[str]:
    """Sentences on the space, the road, the points, and the vehicles at the first that plays."""
    logical, space = read.logical, read.space
    yield f"{logical.name}: {space.about} (OpenSCENARIO {space.version}, {space.file.name})"
    for item in logical.parameters if space.axes else ():
        values = ", ".join(f"{value:g}" for value in item.values)
        values = values or f"{item.low:g}..{item.high:g}"
        yield f"  parameter {item.name} = {values}{item.unit_suffix} {item.about}".rstrip()
    road = logical.road
    yield (
        f"  road {read.frame.name}: {count(road.lanes, 'lane')} of {road.lane_width:g} m, "
        f"evaluated to {road.length:g} m"
    )
    if len(read.roads) > 1:
        yield (
            f"  this is road {read.road + 1} of {len(read.roads)} ({', '.join(read.roads)}); "
            "`?road=NUMBER` behind the file's name chooses one"
        )
    points = list(concrete_points(read, _MOST))
    playing, words, reasons = _counted(read, points)
    yield f"  {words}"
    for why, number in reasons.most_common(_SHOWN):
        yield f"  {number} do not: {why}"
    if len(reasons) > _SHOWN:
        yield f"  and {len(reasons) - _SHOWN} more reasons"
    yield from (f"  {note}" for note in read.notes)
    if playing:
        first = next(point for point, why in points if why is None)
        # a file without parameters has a single point, without values
        yield "  at the first point that plays:" if first else "  its scene:"
        yield from _scene(read, first)


def _scene(read: Read, point: Numbers) -> Iterator[str]:
    """Sentences on the vehicles at a point."""
    case = concrete(read, point)
    yield (
        f"    the ego at x = {case.ego.x:.3f} m, y = {case.ego.y:.3f} m with "
        f"{case.ego.speed:.3f} m/s"
    )
    for actor in case.actors:
        yield from _actor_lines(actor)
    values = [case.values[name] for name in read.logical.names]
    yield from (f"    {it}" for it in leaving(read.logical, np.array([values])))


def listed(name: str, paths: Sequence[Path]) -> Iterator[str]:
    """A line for each road of each file of a catalogue: how many of its points play, and why others
    do not; for a file that cannot be read, why. Then the sums.

    name: of the catalogue.
    paths: of its files.

    Raises InputError after the last line where no point of any file plays.
    """
    tried = playing = files = 0
    for file in paths:
        try:
            reads = [read for _, read in uses_of(file, file.name)]
        except InputError as error:
            yield f"{file.stem}: does not play: {error}"
            continue
        files += 1
        for read in reads:
            points = list(concrete_points(read, _MOST))
            own, words, reasons = _counted(read, points)
            tried += len(points)
            playing += own
            why = "; ".join(f"{number} {why}" for why, number in reasons.most_common(_SHOWN))
            yield f"{read.logical.name}: {words}{why and '; not: '}{why}"
    yield f"{name}: {files} of {len(paths)} files play, {playing} of {tried} points tried"
    if not playing:
        raise InputError(f"A file of catalogue `{name}` must play, got none: see the lines above.")


def _counted(read: Read, points: Points) -> tuple[int, str, Counter[str]]:
    """Number of the points that play, words for it, and reason -> number of those that do not."""
    # `= ` is before a reason that the file intends, see `logical.refusal`
    reasons = Counter(why.removeprefix("= ") for _, why in points if why is not None)
    playing = len(points) - reasons.total()
    words = f"{playing} of {len(points)} points play"
    if len(points) < read.space.size:
        words += f" that were tried along each axis, of {read.space.size}"
    return playing, words, reasons


def _actor_lines(actor: Actor) -> Iterator[str]:
    """Sentences on an actor: its start, then each move."""
    start = actor.start
    heading = f", heading {math.degrees(actor.heading):.1f} deg" if actor.heading else ""
    size = f"{actor.body} of {actor.length:g} x {actor.width:g} m"
    yield (
        f"    {actor.name}, a {size}, at x = {start.x:.3f} m, y = {start.y:.3f} m{heading} with "
        f"{start.speed:.3f} m/s"
    )
    for act in actor.acts:
        if changes_nothing(act):
            continue
        when = (
            f"{act.begin:.3f} s after its condition holds"
            if act.program
            else f"at {act.begin:.3f} s"
        )
        how = ""
        if act.kind <= played.COSINE:  # a move across
            how = f" by {act.offset:.3f} m in {act.duration:.3f} s"
        elif act.kind == played.SPEED:
            # a step takes `moments.AT_ONCE`, so its acceleration is millions of m/s2
            rate = f"{act.acceleration:.3g} m/s2" if act.acceleration < 1e3 else "once"
            how = f" to {act.speed:.3f} m/s at {rate}"
        elif act.kind == played.BY_TIME:
            how = ": " + ", ".join(f"{speed:.3f} m/s at {time:.3f} s" for time, speed in act.table)
        yield f"      {VERBS[act.kind]} {when}{how}"
