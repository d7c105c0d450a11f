"""Frames: messages in which a child process of the pool, which runs users' code, sends a result.

A frame is a header and plain values as `marshal` writes them; reading it executes nothing. The
header has the number of the item that the frame answers, so that no frame answers another item; the
length of the values, so that a frame that is too long is refused before it fills the reader's
memory; and their checksum, so that only whole values are read.

Users: `record/pool.py`.
"""

import marshal
import struct
import zlib
from collections.abc import Callable
from typing import Any

from sumo_eval.errors import said

_MAGIC = b"sevl"
_HEADER = struct.Struct("<4sQQI")  # magic, item number, length of the values, their checksum


class FrameError(Exception):
    """Bytes that are not the expected frame.

    Its text continues "the process that ran the case ...".
    """


def frame(values: Any, number: int) -> bytes:
    """Bytes of the frame that answers an item.

    values: lists, dicts, texts, bytes, numbers and None. Numbers and arrays of numpy would come
        back as bytes.
    number: of the item.
    """
    body = marshal.dumps(values)
    return _HEADER.pack(_MAGIC, number, len(body), zlib.crc32(body)) + body


class FrameReader:
    """Joins the bytes that arrive to the one frame that answers an item.

    number: of the item.
    longest: most bytes that the values may have.
    read: makes the result of the values, not None; if it fails, the bytes are not the frame.
    received: bytes of the frame that have arrived.
    """

    def __init__(
        self, number: int, longest: float, read: Callable[[Any], Any] = lambda values: values
    ) -> None:
        self._number, self._longest, self._read = number, longest, read
        self.received = bytearray()

    def feed(self, data: bytes) -> Any:
        """Result of the frame once it is complete, before that None.

        Raises FrameError if the header, once it has arrived, is not that of the frame, and if the
        complete values are not valid.
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
        if size > self._longest:
            raise FrameError(f"announced a result of {size} bytes, over {self._longest:.0f}")
        missing = _HEADER.size + size - len(self.received)
        if missing < 0:
            raise FrameError("wrote more than one result for the case")
        if missing:
            return None
        body = memoryview(self.received)[_HEADER.size :]
        if zlib.crc32(body) != checksum:
            raise FrameError("gave a result that does not fit its checksum")
        try:
            # cannot execute anything, and is whole
            return self._read(marshal.loads(body))  # noqa: S302
        except Exception as error:
            raise FrameError(f"gave a result that cannot be read: {said(error)}") from error
