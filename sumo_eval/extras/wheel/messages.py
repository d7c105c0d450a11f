"""What a browser may say: each message bounded, of a known kind, its numbers finite; else a sentence."""

from __future__ import annotations

import json
from typing import Any, Final

from sumo_eval.extras.wheel.hands import KEYS, KINDS, Given
from sumo_eval.extras.wheel.seat import Input
from sumo_eval.text import clean

LARGEST: Final = 8192  # bytes of a message: the answers of a form with a remark
MOST_A_SECOND: Final = 400
REMARK: Final = 1000  # characters of a text that a person types
_ALL_KEYS: Final = sum(KEYS.values())
_SAMPLES: Final = 200  # latencies in one message
_WHOLE: Final = 1 << 40
_TOLD: Final = frozenset({"frames", "dropped", "stepped", "latency", "resolution", "renderer"})


class MessageError(Exception):
    """A message that no page of ours sends; its text is a sentence."""


def read(text: object) -> dict[str, Any]:
    """A message as a dict of what it says, with exactly one of the keys of `_READERS`."""
    if not isinstance(text, str):
        raise MessageError("A message must be text.")
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        raise MessageError("A message must be JSON.") from None
    if not isinstance(value, dict) or len(value) != 1:
        raise MessageError("A message must be an object with one key.")
    ((name, content),) = value.items()
    if name not in _READERS:
        raise MessageError(f"A message must be one of {', '.join(_READERS)}, got {clean(str(name), 40)}.")
    return {name: _READERS[name](content)}


def _number(value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _WHOLE:
        raise MessageError(f"A number of a message must be finite, and at most {_WHOLE:.2g}.")
    if not low <= value <= high:
        raise MessageError(f"A number of a message must be within {low:g}..{high:g}, got {value:g}.")
    return float(value)


def _whole(value: Any, low: int, high: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise MessageError(f"A number of a message must be whole and within {low}..{high}.")
    return value


def _input(content: Any) -> Input:
    """[number, state seen, kind, keys, steer, throttle, brake]."""
    if not isinstance(content, list) or len(content) != 7:
        raise MessageError("An input must be a list of 7.")
    number, seen, kind, keys, steer, throttle, brake = content
    end = 30.0 if kind == "wheel" else 1.0
    if kind not in KINDS:
        raise MessageError(f"The kind of an input must be one of {', '.join(KINDS)}.")
    return Input(
        _whole(number, 0, _WHOLE), _whole(seen, -1, _WHOLE),
        Given(
            kind, _whole(keys, 0, _ALL_KEYS), _number(steer, -end, end), _number(throttle, 0, 1), _number(brake, 0, 1)
        ),
    )  # fmt: skip


def _token(content: Any) -> str:
    if not isinstance(content, str):
        raise MessageError("A token must be text.")
    return content


def _flag(content: Any) -> bool:
    if content is not True:
        raise MessageError("A wish must be true.")
    return True


def _why(content: Any) -> str:
    if content not in ("hidden", "key"):
        raise MessageError("A pause must say `hidden` or `key`.")
    return str(content)


def _answers(content: Any) -> dict[str, Any]:
    if not isinstance(content, dict) or len(content) > 50:
        raise MessageError("Answers must be an object of at most 50.")
    found: dict[str, Any] = {}
    for name, value in content.items():
        if isinstance(value, bool):
            found[name] = value
        elif isinstance(value, str):
            found[name] = clean(value, REMARK)
        else:
            found[name] = _number(value, -1e6, 1e6)
    return found


def _telling(content: Any) -> dict[str, Any]:
    """What the page measured since it told last: frames drawn, late ones, how often it drew more cheaply by itself,
    latencies in ms, resolution.
    """
    if not isinstance(content, dict) or set(content) != _TOLD:
        raise MessageError(f"What a page tells of itself must be {', '.join(sorted(_TOLD))}.")
    latency = content["latency"]
    if not isinstance(latency, list) or len(latency) > _SAMPLES:
        raise MessageError(f"Latencies must be a list of at most {_SAMPLES}.")
    return {
        "frames": _whole(content["frames"], 0, 100_000), "dropped": _whole(content["dropped"], 0, 100_000),
        "stepped": _whole(content["stepped"], 0, 100_000),
        "latency": [_number(it, 0.0, 1e9) for it in latency],
        "resolution": _number(content["resolution"], 0.0, 10.0), "renderer": clean(str(content["renderer"]), 100),
    }  # fmt: skip


_READERS: Final = {
    "token": _token, "input": _input, "ready": _flag, "pause": _why, "quit": _flag, "answers": _answers,
    "telling": _telling,
}  # fmt: skip
