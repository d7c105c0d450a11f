"""Records of plain values as JSON, and back to the last bit: nothing that is read can execute anything."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

Classes = Mapping[str, type]
_IS, _OF, _MAP = "is", "of", "map"


def encoded(value: object) -> bytes:
    """A value made of records, tuples, mappings, texts, numbers and None. Lists come back as tuples."""
    return json.dumps(_plain(value), separators=(",", ":")).encode()


def decoded(data: bytes, classes: Classes) -> Any:
    """What `encoded` wrote. classes: those of its records, by name."""
    return _value(json.loads(data), classes)


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {_IS: type(value).__name__, _OF: [_plain(getattr(value, field.name)) for field in fields(value)]}
    if isinstance(value, Mapping):
        return {_MAP: [[_plain(key), _plain(item)] for key, item in value.items()]}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _value(plain: Any, classes: Classes) -> Any:
    if isinstance(plain, list):
        return tuple(_value(item, classes) for item in plain)
    if not isinstance(plain, dict):
        return plain
    if _MAP in plain:
        return {_value(key, classes): _value(item, classes) for key, item in plain[_MAP]}
    return classes[plain[_IS]](*(_value(item, classes) for item in plain[_OF]))
