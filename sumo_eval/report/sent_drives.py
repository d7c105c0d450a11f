"""Choice of the recorded drives that a page contains, and their form: small enough for one file.

Trajectories keep their recorded samples. Every channel is rounded to its step in `CHANNEL_STEPS`,
written as differences of whole numbers, and deflated; values outside their range travel unchanged
in a list. `decodeTrajectories` in templates/field.js is the other half.

Users: `extras/wheel/page.py`, `report/html.py`, `report/page_data.py`, `report/replay.py`.
"""

import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.cases import Role
from sumo_eval.record.store import EGO, Store, open_store
from sumo_eval.report.page import LEVEL, Json, packed_bytes
from sumo_eval.scoring.contact_cause import cause_of_contact
from sumo_eval.trajectory import BoolArray, Collision, FloatArray, Trajectory

CHANNEL_STEPS = {
    "time": 1e-3, "x": 1e-2, "y": 1e-3, "heading": 1e-4, "speed": 1e-2, "acceleration": 5e-2,
    "steering_wheel_angle": 5e-3
}  # fmt: skip
"""Channels of an embedded trajectory and what they are rounded to: s, m, m, rad, m/s, m/s2, rad.

1 / step is whole: templates/field.js divides by it.
"""

MOST_WHOLE = 2**30 - 1
"""The largest number of steps that is packed: the difference of two such numbers fits in 32 bits.
Larger ones go to `beyond`."""

Point = tuple[str, int]
"""A concrete scenario: the logical scenario's name and the point's number."""


class Embedded(NamedTuple):
    """Points whose trajectories travel in the page.

    points: those of the ADSs and of the other vehicles.
    with_drivers: some of these, with the trajectories of the drivers too.
    """

    points: frozenset[Point]
    with_drivers: frozenset[Point]


MOST_BYTES = 4_500_000  # of embedded trajectories; the whole page stays below 10 MB at 5,000 cases
BYTES_OF_A_TRAJECTORY = 900  # first guess for one trajectory, before the chosen ones are packed
BYTES_BEYOND = 40  # about, of an entry of `beyond` (`encode_trajectories`)


class Drives(NamedTuple):
    """The recorded drives that travel in a page of one scenario.

    trajectories: as the page reads them.
    rows: point, vehicles, contact and number of drivers of each case, in the order of the cases.
    drivers: by point, the indices of its drivers' trajectories in `trajectories`.
    """

    trajectories: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]
    drivers: Mapping[int, Sequence[int]]

    @property
    def size(self) -> int:
        """About the bytes of the trajectories in the page."""
        return len(self.trajectories["data"]) + BYTES_BEYOND * len(self.trajectories["beyond"])


class SentDrives(NamedTuple):
    """The recorded drives that travel in a page, by scenario."""

    embedded: Embedded
    scenarios: Mapping[str, Drives]


def sent_drives(run: Path, cases_of: Mapping[str, Sequence[CaseResult]]) -> SentDrives:
    """The drives that a page of these cases, by scenario, has room for.

    run: folder in whose facts they are recorded.

    Reading, rounding and deflating hold the interpreter's lock for a quarter of the time, so this
    is for a thread.
    """
    most = MOST_BYTES // BYTES_OF_A_TRAJECTORY  # trajectories
    with open_store(run) as store:
        # by scenario and case, in the order given, the number of its point; -1: not recorded
        points = {
            name: dict.fromkeys((case.case for case in cases), -1)
            for name, cases in cases_of.items()
        }
        # facts of other cases, of which there may be millions, are not kept in memory
        for name, own in points.items():
            own |= {case: at for case, at, _ in store.names("ads", name) if case in own}
        while True:
            embedded = worth_embedding(cases_of, points, store, most)
            scenarios = {
                name: _drives(name, store, embedded, of_cases) for name, of_cases in points.items()
            }
            size = sum(drives.size for drives in scenarios.values())
            if size <= MOST_BYTES or not embedded.points:
                return SentDrives(embedded, scenarios)
            # too large: scale by the size measured now, less 5 % so that the next choice fits
            most = int(most * 0.95 * MOST_BYTES / size)


def _drives(scenario: str, store: Store, embedded: Embedded, points: Mapping[str, int]) -> Drives:
    """The drives of a page's cases, by their points."""
    trajectories: list[Trajectory] = []
    rows = []
    shown = set(points.values())
    driver_counts = {
        at: drives for at, drives, _ in store.drivers_at_points(scenario) if at in shown
    }
    for case, number in points.items():
        is_embedded = (scenario, number) in embedded.points
        recorded = store.trajectories(case) if is_embedded else {}
        vehicles = {name: len(trajectories) + index for index, name in enumerate(recorded)}
        trajectories += recorded.values()
        fact = store.fact(case) if EGO in recorded else None
        rows.append({
            "point": number,
            # a drive that never began has no trajectories to miss; a discarded one has lost them
            "embedded": is_embedded and (bool(recorded) or not store.is_discarded(case)),
            "vehicles": vehicles,
            "contact": fact and contact_of(fact, recorded[EGO]),
            "drivers": driver_counts.get(number, 0)
        })  # fmt: skip
    drivers: dict[int, list[int]] = {}
    for number in sorted(number for name, number in embedded.with_drivers if name == scenario):
        for driver in store.driven_at(scenario, number, "human"):  # D_i is made of these
            drivers.setdefault(number, []).append(len(trajectories))
            trajectories.append(store.trajectory(driver.case))
    return Drives(encode_trajectories(trajectories), rows, drivers)


def worth_embedding(
    cases_of: Mapping[str, Sequence[CaseResult]],
    points_of: Mapping[str, Mapping[str, int]],
    store: Store,
    most: int,
) -> Embedded:
    """The points whose trajectories travel in the page: all, or those with the greatest weights.

    The order of points: first those with a case that could not be evaluated or with an incident, by
    severity, then by their least human-like case. Room is given in two rounds in this order. The
    first gives points up to the last incident room for their ADSs. The second gives these points
    room for their drivers, and further points room for ADSs and drivers.

    cases_of: the cases that the page has, by scenario.
    points_of: their points, by scenario and case.
    most: trajectories that the page may have.
    """
    # imported here because it imports scipy, which the animation of one case does not need
    from sumo_eval.scoring.shown_cases import HIT, case_weights

    # trajectories at each point, by role
    counts: dict[Role, Counter[Point]] = {"ads": Counter(), "human": Counter()}
    for name in cases_of:
        shown = set(points_of[name].values())
        for role, at_point in counts.items():
            at_point.update((name, at) for _, at, _ in store.names(role, name) if at in shown)
    weights: dict[Point, float] = {}  # of each point, the greatest of its cases
    every = [case for cases in cases_of.values() for case in cases]
    for case, weight in zip(every, case_weights(CaseTable.of(every)).tolist(), strict=True):
        point = case.scenario, points_of[case.scenario][case.case]
        weights[point] = max(weights.get(point, 0.0), weight)
    order = sorted(weights, key=lambda point: (-weights[point], point))
    # trajectories at the points in this order, (n,)
    ads, drivers = (np.array([at_point[point] for point in order]) for at_point in counts.values())
    hits = sum(weight >= HIT for weight in weights.values())
    # first round: the first `with_ads` points have room for their ADSs
    with_ads = int(np.searchsorted(np.cumsum(ads[:hits]), most, side="right"))
    # second round: the first `with_drivers` points have room for both; of these the first
    # `with_ads` need it for their drivers only
    drivers[with_ads:] += ads[with_ads:]
    room = most - ads[:with_ads].sum()
    with_drivers = int(np.searchsorted(np.cumsum(drivers), room, side="right"))
    points = order[: max(with_ads, with_drivers)]
    return Embedded(frozenset(points), frozenset(order[:with_drivers]))


def contact(
    hit: Collision | None, ego: Trajectory | None, last: float | None = None
) -> Json | None:
    """Contact as the replay shows it: name of the other vehicle, touched side, relative speed, m/s,
    and, in s since the recording began, its time and the last moment.

    last: the last moment at which full braking avoids it, s.
    """
    if hit is None or ego is None:
        return None
    time, last = (
        None if it is None else round(it - float(ego.time[0]), 4) for it in (hit.time, last)
    )
    return {
        "time": time, "last": last, "other": hit.other, "side": hit.side,
        "speed": round(hit.relative_speed, 3)
    }  # fmt: skip


def contact_of(fact: Fact, ego: Trajectory) -> Json | None:
    """Contact of a recorded case as the replay shows it."""
    return contact(fact.collision, ego, cause_of_contact(fact).no_return_time)


def encode_trajectories(trajectories: Sequence[Trajectory]) -> Json:
    """Many trajectories in one string, with their sample counts, lengths and widths.

    `time` starts where the recording did.

    beyond: samples that differences of 32 bits cannot hold, as they are: [channel, the first's
        place among all samples, how many, their value].
    """
    counts = [len(trajectory) for trajectory in trajectories]
    planes = []
    beyond = []
    unsteered = [
        not np.isfinite(trajectory.steering_wheel_angle).all() for trajectory in trajectories
    ]
    unknown = np.repeat(np.array(unsteered, bool), counts)  # of each sample of all trajectories
    for name, step in CHANNEL_STEPS.items():
        channel = np.concatenate(
            [np.zeros(0), *(getattr(trajectory, name) for trajectory in trajectories)]
        )
        if name == "steering_wheel_angle":
            channel = np.where(unknown, 0.0, channel)
        differences, fits = _differences(channel, step)
        planes.append(differences)
        beyond += [[name, *run] for run in _runs_of_one_value(channel, ~fits)]
    return {
        "counts": counts,
        "lengths": [trajectory.length for trajectory in trajectories],
        "widths": [trajectory.width for trajectory in trajectories],
        "noSteering": np.flatnonzero(unsteered).tolist(),
        "beyond": beyond,
        "data": packed_bytes(zlib.compress(b"".join(planes), LEVEL)),
    }


def _differences(channel: FloatArray, step: float) -> tuple[bytes, BoolArray]:
    """A channel (n,) as differences of whole steps, 4 n bytes, and which samples these can hold."""
    with np.errstate(over="ignore"):
        whole = np.round(channel / step)
    fits = np.abs(whole) <= MOST_WHOLE
    change = np.diff(np.where(fits, whole, 0.0).astype("<i4"), prepend=np.int32(0))
    # Zigzag: c >= 0 becomes 2 c, c < 0 becomes -2 c - 1, so small changes are small numbers. Then
    # the lowest bytes of all samples stand together, the second ones, and so on.
    folded = (change << 1) ^ (change >> 31)
    return folded.astype("<i4").view(np.uint8).reshape(-1, 4).T.tobytes(), fits


def _runs_of_one_value(channel: FloatArray, chosen: BoolArray) -> Iterator[tuple[int, int, float]]:
    """(index of the first, how many, value) of chosen samples, equal neighbours together."""
    # index - rank among the chosen is the same for neighbours
    for (value, _), run in groupby(
        enumerate(np.flatnonzero(chosen).tolist()),
        key=lambda ranked: (float(channel[ranked[1]]), ranked[1] - ranked[0]),
    ):
        indices = [index for _, index in run]
        yield indices[0], len(indices), value
