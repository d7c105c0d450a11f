"""Frames: how a process that runs users' code hands a result up. Bounded, numbered, checked, and nothing that executes.

A frame is a header, a JSON text and any number of byte strings. The header carries a nonce that was drawn for this one
item and the item's number, so that what was meant for another item, or never meant as a frame, is not taken for one.
Reading is incremental: bytes are fed as they come, and no length that a frame claims is believed beyond the bound.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass
from typing import Any

_MAGIC = b"sevl"
_HEADER = struct.Struct("<4s16sQIQI")  # magic, nonce, item number, length of the text, length of the rest, checksum

NONCE_BYTES = 16
LONGEST_TEXT = 4 << 20
"""Bytes of a frame's JSON at most: reading it takes up to forty times as much memory here. A pack with more to say is
lost, and its cases run alone."""


class FrameError(Exception):
    """What came is not the frame that was due. Its text goes on from "the process that ran the case ..."."""


@dataclass(frozen=True, slots=True)
class Ticket:
    """What a frame must carry to be the result of one item, and how long it may be, bytes."""

    nonce: bytes
    number: int
    bound: int


@dataclass(frozen=True, slots=True)
class Message:
    """What a frame says: plain values, as JSON has them, and byte strings beside them."""

    plain: Any
    blobs: tuple[bytes, ...] = ()


def frame(message: Message, nonce: bytes, number: int) -> bytes:
    """A message as the bytes that answer the item with this nonce and number."""
    text = json.dumps([message.plain, [len(blob) for blob in message.blobs]], separators=(",", ":")).encode()
    rest = b"".join(message.blobs)
    checksum = zlib.crc32(rest, zlib.crc32(text))
    return _HEADER.pack(_MAGIC, nonce, number, len(text), len(rest), checksum) + text + rest


class FrameReader:
    """Puts the one frame that answers an item together from the bytes that come."""

    def __init__(self, ticket: Ticket) -> None:
        self._ticket = ticket
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
        magic, nonce, number, text, rest, checksum = _HEADER.unpack_from(self._came)
        if magic != _MAGIC:
            raise FrameError("wrote something that is no result to the pipe for results")
        if number != self._ticket.number or nonce != self._ticket.nonce:
            raise FrameError("answered for another case than its own")
        if text + rest > self._ticket.bound:
            raise FrameError(f"gave a result of {text + rest} bytes, at most {self._ticket.bound} are one")
        if text > LONGEST_TEXT:
            raise FrameError(f"gave a result of {text} bytes of text, at most {LONGEST_TEXT} are one")
        self._size, self._text, self._checksum = _HEADER.size + text + rest, text, checksum

    def _message(self) -> Message:
        text = bytes(self._came[_HEADER.size : _HEADER.size + self._text])
        rest = memoryview(self._came)[_HEADER.size + self._text :]
        if zlib.crc32(rest, zlib.crc32(text)) != self._checksum:
            raise FrameError("gave a result that does not fit its checksum")
        try:
            plain, sizes = json.loads(text)
            blobs, begin = [], 0
            for size in sizes:
                if type(size) is not int or not 0 <= size <= len(rest) - begin:
                    raise ValueError("a length")
                blobs.append(bytes(rest[begin : begin + size]))
                begin += size
            if begin != len(rest):
                raise ValueError("bytes that belong to nothing")
        except (ValueError, TypeError, RecursionError) as error:
            raise FrameError("gave a result that cannot be read") from error
        return Message(plain, tuple(blobs))
