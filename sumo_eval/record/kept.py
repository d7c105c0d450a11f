"""A recording in the form in which the store keeps it: trajectories as bytes.

The process that drives a case makes the bytes, so that the process that collects cases need not.

Users: `extras/studies/trials.py`, `record/case_rows.py`, `record/cases.py`, `record/claims.py`,
`record/recording.py`, `record/store.py`, `record/worker.py`.
"""

import struct
import zlib
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.trajectory import (
    CHANNELS,
    Clip,
    Collision,
    EndReason,
    Latency,
    Recording,
    Trajectory,
)

EGO = "ego"

# Bytes of a value, by channel. Single precision (4 bytes) has a relative error of 1e-7: negligible
# for a lane's width, a speed or an angle, but 0.1 mm for each km of x.
_VALUE_BYTES = {name: 8 if name in ("time", "x") else 4 for name in CHANNELS}
_SAMPLE_BYTES = sum(_VALUE_BYTES.values())
_HEADER = struct.Struct("<Idd")  # number of samples, length and width of the vehicle


class KeptRecording(NamedTuple):
    """A `Recording` whose trajectories are bytes.

    drives: vehicle -> its trajectory as `packed` makes it; the ego's is under `ego`.
    """

    drives: Mapping[str, bytes]
    collision: Collision | None
    end_reason: EndReason
    clips: tuple[Clip, ...]
    controller_latency: Latency
    wall_time: float
    simulated_time: float

    @property
    def ego(self) -> Trajectory:
        """Trajectory of the ego."""
        return unpack(self.drives[EGO])


def keep(recording: Recording) -> KeptRecording:
    """The recording as it is stored; its error and its log stand in the outcome."""
    drives = {EGO: recording.ego, **recording.actors}
    return KeptRecording(
        {name: packed(drive) for name, drive in drives.items()},
        *(getattr(recording, name) for name in KeptRecording._fields[1:]),  # all but `drives`
    )


def packed(trajectory: Trajectory) -> bytes:
    """A trajectory as bytes: time and x in double, the rest in single precision, deflated.

    A channel stands as planes: the first bytes of all its samples, then the second bytes, and so
    on, which deflates better than sample after sample.
    """
    body = b"".join(
        np.ascontiguousarray(getattr(trajectory, name), f"<f{value_bytes}")
        .view(np.uint8)
        .reshape(len(trajectory), -1)
        .T.tobytes()
        for name, value_bytes in _VALUE_BYTES.items()
    )
    return _HEADER.pack(len(trajectory), trajectory.length, trajectory.width) + zlib.compress(
        body, 6
    )


def unpack(data: bytes) -> Trajectory:
    """The trajectory that `packed` wrote."""
    inflating = zlib.decompressobj()
    try:
        n, length, width = _HEADER.unpack_from(data)
        size = n * _SAMPLE_BYTES
        # inflate one byte more than expected at most: damaged bytes might inflate without end
        body = np.frombuffer(inflating.decompress(data[_HEADER.size :], size + 1), np.uint8)
    except (struct.error, zlib.error) as error:
        raise InputError(f"A recorded trajectory is damaged: {error}.") from error
    if body.size != size or not inflating.eof or inflating.unused_data:
        raise InputError(
            f"A recorded trajectory of {n} samples must inflate to {size} bytes, and does not."
        )
    block = np.empty((len(CHANNELS), n))
    begin = 0
    for row, value_bytes in enumerate(_VALUE_BYTES.values()):
        plane = body[begin : begin + n * value_bytes].reshape(value_bytes, n)
        block[row] = np.ascontiguousarray(plane.T).view(f"<f{value_bytes}").reshape(n)
        begin += n * value_bytes
    return Trajectory.of_block(block, length=length, width=width)
