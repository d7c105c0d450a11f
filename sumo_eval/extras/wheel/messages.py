"""Messages of a browser: each bounded, of a known kind, its numbers finite; else an error."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from sumo_eval.extras.wheel.hands import KEYS, Given
from sumo_eval.extras.wheel.seat import Input
from sumo_eval.text import clean

LARGEST = 8192  # bytes of a message: the answers of a form with a remark
MOST_A_SECOND = 400
REMARK = 1000  # characters of a text that a person types

Count = Annotated[int, Field(strict=True, ge=0, le=1 << 40)]
Frames = Annotated[int, Field(strict=True, ge=0, le=100_000)]
Number = Annotated[float, Field(strict=True, ge=-1e6, le=1e6)]
Pedal = Annotated[float, Field(strict=True, ge=0.0, le=1.0)]
Steer = Annotated[float, Field(strict=True, ge=-30.0, le=30.0)]
Wish = Annotated[bool, Field(strict=True, ge=True)]
Remark = Annotated[str, AfterValidator(lambda text: clean(text, REMARK))]
Sent = tuple[
    Count, Annotated[int, Field(strict=True, ge=-1)], Literal["keys", "wheel", "stick"],
    Annotated[int, Field(strict=True, ge=0, le=sum(KEYS.values()))], Steer, Pedal, Pedal,
]  # fmt: skip
"""An input: number, state seen, kind, keys, steer, throttle, brake."""


def _input(sent: Sent) -> Input:
    if sent[2] != "wheel" and abs(sent[4]) > 1.0:
        raise ValueError("keys and sticks steer within -1..1")
    return Input(sent[0], sent[1], Given(*sent[2:]))


class Telling(TypedDict):
    """Figures that the page measured since its last message of this kind: frames drawn, late ones,
    how often it drew more cheaply by itself, latencies in ms, resolution.
    """

    frames: Frames
    dropped: Frames
    stepped: Frames
    latency: Annotated[
        list[Annotated[float, Field(strict=True, ge=0.0, le=1e9)]], Field(max_length=200)
    ]
    resolution: Annotated[float, Field(strict=True, ge=0.0, le=10.0)]
    renderer: Annotated[str, AfterValidator(lambda text: clean(text, 100))]


class Message(TypedDict, total=False):
    """One message; it has one of these keys."""

    # pydantic's own form
    __pydantic_config__ = {"extra": "forbid"}  # type: ignore[misc]  # noqa: RUF012

    token: str
    input: Annotated[Sent, AfterValidator(_input)]
    ready: Wish
    pause: Literal["hidden", "key"]
    quit: Wish
    answers: Annotated[dict[str, bool | Number | Remark], Field(max_length=50)]
    telling: Telling


_MESSAGE = TypeAdapter(Message)


class MessageError(Exception):
    """A message that our page does not send; its text is the error message."""


def read(text: object) -> dict[str, Any]:
    """The content of a message, with exactly one of the keys of `Message`."""
    if not isinstance(text, str):
        raise MessageError("A message must be text.")
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        raise MessageError("A message must be JSON.") from None
    if not isinstance(value, dict) or len(value) != 1:
        raise MessageError("A message must be an object with one key.")
    try:
        return dict(_MESSAGE.validate_python(value))
    except ValidationError as error:
        fault = error.errors()[0]
        place = clean(".".join(map(str, fault["loc"])), 40)
        raise MessageError(
            f"A message must be one of the page's; `{place}`: {fault['msg']}."
        ) from None
