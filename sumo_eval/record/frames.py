"""Frames: messages in which a child process of the pool, which runs users' code, sends a result.

A frame is a header and plain values as `marshal` writes them; nothing in it executes. The header
has the number of the item that the frame answers, so that no other item accepts it, and a checksum,
so that only a whole frame is read. `FrameReader` takes the bytes as they arrive.

Users: `record/pool.py`.
"""

import marshal
import struct
import zlib
from typing import Any

_MAGIC = b"sevl"
_HEADER = struct.Struct("<4sQQI")  # magic, item number, length of the values, their checksum


class FrameError(Exception):
    """Bytes that are not the expected frame.

    Its text continues "the process that ran the case ...".
    """


def frame(values: Any, number: int) -> bytes:
    """Bytes of the frame that answers an item.

    values: lists, texts, bytes, numbers and None, but not None alone.
    number: of the item.
    """
    body = marshal.dumps(values)
    return _HEADER.pack(_MAGIC, number, len(body), zlib.crc32(body)) + body


class FrameReader:
    """Joins the bytes that arrive to the one frame that answers an item.

    received: bytes of the frame that are here.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self.received = bytearray()

    def feed(self, data: bytes) -> Any:
        """The values of the frame once it is complete, before that None.

        Raises FrameError as soon as the bytes cannot become the frame.
        """
        self.received += data
        if len(self.received) < _HEADER.size:
            return None
        magic, number, *rest = _HEADER.unpack_from(self.received)
        size, checksum = rest
        if magic != _MAGIC:
            raise FrameError("wrote something that is not a result to the pipe for results")
        if number != self._number:
            raise FrameError("answered for another case than its own")
        missing = _HEADER.size + size - len(self.received)
        if missing < 0:
            raise FrameError("wrote more than one result for the case")
        if missing:
            return None
        body = bytes(self.received[_HEADER.size :])
        if zlib.crc32(body) != checksum:
            raise FrameError("gave a result that does not fit its checksum")
        return marshal.loads(body)  # noqa: S302 - cannot execute, and is whole
