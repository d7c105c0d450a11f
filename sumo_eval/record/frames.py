"""Frames: how a process that runs users' code hands a result up. Numbered, checked, and nothing that executes.

A frame is a header, a JSON text and any number of byte strings. The header carries the item's number, so that what was
never meant as its result is not taken for it. Reading is incremental: bytes are fed as they come.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

_MAGIC = b"sevl"
_HEADER = struct.Struct("<4sQQQI")  # magic, item number, length of the text, length of the rest, checksum


class FrameError(Exception):
    """What came is not the frame that was due. Its text goes on from "the process that ran the case ..."."""


@dataclass(frozen=True, slots=True)
class Message:
    """What a frame says: plain values, as JSON has them, and byte strings beside them."""

    plain: Any
    blobs: tuple[bytes, ...] = ()


def frame(message: Message, number: int) -> bytes:
    """A message as the bytes that answer the item with this number."""
    text = json.dumps([message.plain, [len(blob) for blob in message.blobs]], separators=(",", ":")).encode()
    rest = b"".join(message.blobs)
    checksum = zlib.crc32(rest, zlib.crc32(text))
    return _HEADER.pack(_MAGIC, number, len(text), len(rest), checksum) + text + rest


class FrameReader:
    """Puts the one frame that answers an item together from the bytes that come."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._came = bytearray()
        self._size = 0  # of the whole frame; known when its header is here
        self._text = 0
        self._checksum = 0

    @property
    def has_begun(self) -> bool:
        """Whether anything of the frame is here."""
        return bool(self._came)

    def feed(self, data: bytes) -> Message | None:
        """The message when the frame is complete. Raises FrameError as soon as it cannot become one."""
        self._came += data
        if not self._size:
            if len(self._came) < _HEADER.size:
                if not _MAGIC.startswith(self._came[: len(_MAGIC)]):
                    raise FrameError("wrote something that is no result to the pipe for results")
                return None
            self._read_header()
        if len(self._came) < self._size:
            return None
        if len(self._came) > self._size:
            raise FrameError("wrote more than one result for the case")
        return self._message()

    def _read_header(self) -> None:
        magic, number, text, rest, checksum = _HEADER.unpack_from(self._came)
        if magic != _MAGIC:
            raise FrameError("wrote something that is no result to the pipe for results")
        if number != self._number:
            raise FrameError("answered for another case than its own")
        self._size, self._text, self._checksum = _HEADER.size + text + rest, text, checksum

    def _message(self) -> Message:
        text = bytes(self._came[_HEADER.size : _HEADER.size + self._text])
        rest = memoryview(self._came)[_HEADER.size + self._text :]
        if zlib.crc32(rest, zlib.crc32(text)) != self._checksum:
            raise FrameError("gave a result that does not fit its checksum")
        plain, sizes = json.loads(text)
        ends = [0, *accumulate(sizes)]
        return Message(plain, tuple(bytes(rest[begin:end]) for begin, end in pairwise(ends)))
