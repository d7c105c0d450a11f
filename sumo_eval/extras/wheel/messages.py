"""Messages of a browser, checked before `wheel/window.py` acts on them.

A message must be of a known kind, with numbers within bounds. Anything else is a `MessageError`.

Users: `extras/wheel/window.py`.
"""

import json
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from sumo_eval.extras.wheel.hands import EVERY_KEY, Given
from sumo_eval.extras.wheel.seat import Input
from sumo_eval.text import clean

LARGEST = 8192  # bytes of a message; the longest holds a form's answers and a remark
MOST_A_SECOND = 400  # messages
REMARK = 1000  # characters of a text that a person types

_strict = partial(Field, strict=True)
Count = Annotated[int, _strict(ge=0, le=1 << 40)]
Frames = Annotated[int, _strict(ge=0, le=100_000)]
Number = Annotated[float, _strict(ge=-1e6, le=1e6)]
Pedal = Annotated[float, _strict(ge=0.0, le=1.0)]
# 1 is full deflection of a key or stick; a wheel turns further
Steer = Annotated[float, _strict(ge=-30.0, le=30.0)]
# only `true`, as ge=True rules out false; Literal[True] would also accept 1
Wish = Annotated[bool, _strict(ge=True)]
Remark = Annotated[str, AfterValidator(lambda text: clean(text, REMARK))]
Sent = tuple[
    Count, Annotated[int, _strict(ge=-1, le=1 << 40)], Literal["keys", "wheel", "stick"],
    Annotated[int, _strict(ge=0, le=EVERY_KEY)], Steer, Pedal, Pedal
]  # fmt: skip
"""An input: its running number, number of the state that the person saw (-1: none yet), and kind,
keys, steer, throttle, brake as in `hands.Given`.
"""


def _input(sent: Sent) -> Input:
    """The input as `seat` takes it."""
    given = Given(*sent[2:])
    if given.kind != "wheel" and abs(given.steer) > 1.0:
        raise ValueError("keys and sticks steer within -1..1")
    return Input(*sent[:2], given)


class Telling(TypedDict):
    """Figures that the page measured since its last message of this kind.

    frames, dropped: pictures drawn, and those of them that came late.
    stepped: how often the page changed to a cheaper drawing by itself.
    latency: times from input to picture, ms.
    resolution: drawn pixels per screen pixel, along each axis.
    renderer: how the road was drawn, in words.
    """

    frames: Frames
    dropped: Frames
    stepped: Frames
    latency: Annotated[list[Annotated[float, _strict(ge=0.0, le=1e9)]], Field(max_length=200)]
    resolution: Annotated[float, _strict(ge=0.0, le=10.0)]
    renderer: Annotated[str, AfterValidator(lambda text: clean(text, 100))]


class Message(TypedDict, total=False):
    """One message: exactly one of these keys, which `read` checks."""

    # how pydantic forbids other keys in a TypedDict
    __pydantic_config__ = {"extra": "forbid"}  # type: ignore[misc]  # noqa: RUF012

    token: str
    input: Annotated[Sent, AfterValidator(_input)]
    ready: Wish
    pause: Literal["hidden", "key"]
    quit: Wish
    answers: Annotated[dict[str, bool | Number | Remark], Field(max_length=50)]
    telling: Telling
    finished: Wish


_MESSAGE = TypeAdapter(Message)


class MessageError(Exception):
    """A message that our page does not send."""


def read(text: object) -> dict[str, Any]:
    """The content of a message: a dictionary with one of the keys of `Message`.

    Raises MessageError.
    """
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
        key = clean(".".join(map(str, fault["loc"])), 40)
        raise MessageError(
            f"A message must be one of the page's; `{key}`: {fault['msg']}."
        ) from None
