"""What a child says became of its cases: as a message, and what of it is believed.

A child that runs users' code may say anything. Every field is looked at here before it goes on: its type, its range,
that it fits the others and the case. Whatever does not is a FrameError, and the child's word counts for nothing.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple, get_args

from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.record.cases import Case, Setup, Status, on_its_own
from sumo_eval.record.frames import FrameError, Message
from sumo_eval.record.kept import EGO, KeptRecording, samples, unpack
from sumo_eval.record.reads import Reads, Told, chained
from sumo_eval.settings import SimulationSettings
from sumo_eval.text import clean, clean_log, words_of
from sumo_eval.trajectory import Alone, AloneReason, Clip, Collision, EndReason, Latency, Side

STATUS: dict[EndReason, Status] = {
    "contact": "collision",
    "standstill": "ok",
    "road_end": "ok",
    "time_limit": "ok",
    "decided": "ok",
    "off_road": "off_road",
    "ads_error": "ads_error",
    "ads_timeout": "ads_timeout",
    "sim_error": "sim_error",
}
"""The status of a case by the reason why its drive ended."""

OURS = ""
"""The home of everything that runs no users' code."""

_LONGEST_NAME = 200
_MOST_CLIPS = 1_000
_SPARE_SAMPLES = 100


class Result(NamedTuple):
    """An `Outcome` without its case, which whoever asked for it has."""

    status: Status
    recording: KeptRecording | None
    error: str | None
    log: str
    error_place: str = ""
    reads: Reads | None = None


Results = list[Result | Alone] | None
"""Of the cases of a pack. `Alone`: why that case has to run alone. None: cases of this kind always have to."""


def home(case: Case, setup: Setup) -> str:
    """Which cases may share a process: those of one locator of a user's, and all of our own drivers."""
    return home_of_ads(case.controller, setup) if case.role == "ads" else OURS


def home_of_ads(locator: str, setup: Setup) -> str:
    """The home of an ADS under test. A vehicle model of the user's drives with each, and makes ours the user's."""
    ours = locator in SHIPPED or locator.startswith("sumo:")
    return OURS if ours and setup.simulation.plant is None else f"ADS `{locator}`"


def as_message(results: Results, read: Told | None = None) -> Message:
    """Results as a child sends them. read: the files that it has read meanwhile."""
    if results is None:
        return Message([read, None])
    blobs: list[bytes] = []
    plain: list[Any] = []
    for result in results:
        if isinstance(result, Alone):
            plain.append([result.why, clean(result.detail)])
            continue
        error = None if result.error is None else clean(result.error)
        kept = result.recording
        if kept is None:
            plain.append([result.status, error, clean_log(result.log), result.error_place, None])
            continue
        collision = kept.collision
        drive = [
            kept.end_reason,
            None if collision is None else [getattr(collision, name) for name in Collision.__slots__],
            [[getattr(clip, name) for name in Clip.__slots__] for clip in kept.clips],
            list(kept.controller_latency),
            kept.wall_time,
            kept.simulated_time,
            list(kept.drives),
        ]
        blobs += kept.drives.values()
        plain.append([result.status, error, clean_log(result.log), result.error_place, drive])
    return Message([read, plain], tuple(blobs))


def believed(message: Message, cases: Sequence[Case], setup: Setup) -> Results:
    """The results in a child's message about these cases. Raises FrameError for anything that cannot be."""
    try:
        return _Reading(message, setup, users=home(cases[0], setup) != OURS).results(cases)
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, struct.error, zlib.error) as error:
        raise FrameError(f"gave a result that cannot be: {words_of(error)}") from error


class _Reading:
    """One message on its way to results. users: whether users' code ran where it comes from."""

    def __init__(self, message: Message, setup: Setup, *, users: bool) -> None:
        read, self._plain = _list(message.plain, "the answer", 2)
        self._reads = chained(read)
        self._blobs = iter(message.blobs)
        self._users = users
        self._most = _most_samples(setup.simulation)

    def results(self, cases: Sequence[Case]) -> Results:
        if self._plain is None and not on_its_own(cases):
            return None
        results = [
            _alone(one)
            if isinstance(one, list) and len(one) == 2 and not on_its_own(cases)
            else self._result(one, case)
            for one, case in zip(_list(self._plain, "the results", len(cases)), cases, strict=True)
        ]
        if next(self._blobs, None) is not None:
            raise ValueError("more trajectories than vehicles")
        return with_reads(results, self._reads)

    def _result(self, plain: Any, case: Case) -> Result:
        status, error, log, place, drive = _list(plain, "a result", 5)
        said = None if error is None else clean(_text(error, "the error"))
        printed, error_place = clean_log(_text(log, "the log")), clean(_text(place, "the place of the error"))
        if drive is None:
            if status not in ("rejected", "ads_error") or said is None:  # the ADS was never made
                raise ValueError("no recording")
            return Result(status, None, said, printed, error_place)
        end_reason, collision, clips, latency, wall_time, simulated_time, names = _list(drive, "a drive", 7)
        if not isinstance(end_reason, str) or end_reason not in STATUS or STATUS[end_reason] != status:
            raise ValueError(f"the status {status!r} after {end_reason!r}")
        expected = [EGO, *(actor.name for actor in case.concrete.actors)]
        if sorted(map(repr, _list(names, "the vehicles", len(expected)))) != sorted(map(repr, expected)):
            raise ValueError("other vehicles than the case has")
        if (collision is not None) != (end_reason == "contact"):
            raise ValueError(f"a collision does not go with {end_reason!r}" if collision else "no collision")
        times = _list(latency, "the latency", len(Latency._fields))
        recording = KeptRecording(
            {name: self._drive(name, simulated_time) for name in names},
            None if collision is None else _collision(collision, expected),
            end_reason,
            tuple(_clip(clip) for clip in _list(clips, "the clips", range(_MOST_CLIPS))),
            Latency(*map(_positive, times)),
            _positive(wall_time),
            _positive(simulated_time),
        )
        return Result(status, recording, said, printed, error_place)

    def _drive(self, name: str, simulated_time: Any) -> bytes:
        data = next(self._blobs, None)
        if data is None:
            raise ValueError(f"no trajectory of {name}")
        if not self._users:
            return data
        if not 1 <= samples(data) <= self._most:
            raise ValueError(f"{samples(data)} samples of {name}, at most {self._most} are possible")
        drive = unpack(data)
        if not (0.0 < drive.length < math.inf and 0.0 < drive.width < math.inf):
            raise ValueError(f"the size of {name}")
        if name == EGO and drive.time[-1] != simulated_time:
            raise ValueError("a drive that is not as long as it says")
        return data


def with_reads(results: Results, reads: Reads | None) -> Results:
    """The results with what their process had read by then."""
    if results is None or reads is None:
        return results
    return [one if isinstance(one, Alone) else one._replace(reads=reads) for one in results]


def _most_samples(simulation: SimulationSettings) -> int:
    return int(simulation.time_limit / min(simulation.step, simulation.record_interval)) + _SPARE_SAMPLES


def _alone(plain: list[Any]) -> Alone:
    why, detail = plain
    if why not in get_args(AloneReason):
        raise ValueError("a case that has to run alone for no reason")
    return Alone(why, clean(_text(detail, "a reason")))


def _collision(plain: Any, vehicles: Sequence[str]) -> Collision:
    time, other, ego_velocity, other_velocity, overlap, side, ego_pose, other_pose = _list(plain, "the collision", 8)
    if other not in vehicles or side not in get_args(Side):
        raise ValueError("a collision with nobody or on no side")
    return Collision(
        _number(time), other, _numbers(ego_velocity, 2), _numbers(other_velocity, 2), _number(overlap), side,
        _numbers(ego_pose, 3), _numbers(other_pose, 3),
    )  # fmt: skip


def _clip(plain: Any) -> Clip:
    what, count, first_time, requested, applied = _list(plain, "a clip", 5)
    if type(count) is not int or count < 1:
        raise ValueError("a clip that was counted no times")
    if not isinstance(what, str) or not what.isidentifier() or len(what) > _LONGEST_NAME:
        raise ValueError("a clip of no name")
    return Clip(what, int(_number(count)), _number(first_time), _number(requested), _number(applied))


def _list(value: Any, what: str, length: int | range) -> list[Any]:
    if not isinstance(value, list) or (len(value) != length if isinstance(length, int) else len(value) not in length):
        raise ValueError(f"{what} must be {length} values" if isinstance(length, int) else f"{what} are no list")
    return value


def _numbers(value: Any, length: int) -> Any:
    return tuple(_number(one) for one in _list(value, "a vector", length))


def _number(value: Any) -> Any:
    """The number as it is: an integer stays one, so that it is stored as it would have been."""
    if type(value) not in (int, float) or not math.isfinite(value):
        raise ValueError(f"{str(value)[:40]!r} for a finite number")
    return value


def _positive(value: Any) -> Any:
    if _number(value) < 0:
        raise ValueError(f"{value} for a time")
    return value


def _text(value: Any, what: str) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{what} is no text")
    return value
