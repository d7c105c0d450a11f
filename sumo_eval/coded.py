"""Records as plain values, as JSON too, and back to the last bit: nothing that is read can execute
anything.

Users: `case_table.py`, `cosim/openscenario.py`, `record/claims.py`, `record/human_reference.py`,
`record/points.py`, `scoring/drive_results.py`, `scoring/kept_scores.py`. Fixed: the form,
because files that `sumo-eval export` wrote hold it. Caches do not outlive a change of this file.
"""

import json
from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

Classes = Mapping[str, Any]
"""Name of a record's class -> the class, or a function that makes the record from its fields."""
# Keys in JSON. A record: {"is": name of its class, "of": values of its fields}.
_CLASS, _VALUES = "is", "of"
_MAP, _ARRAY = "map", "array"  # {"map": pairs of key and value}, {"array": dtype, shape, bytes}


def encoded(value: object) -> bytes:
    """The bytes of a value, for `decoded`.

    value: made of records, tuples, mappings, arrays, texts, numbers and None. Lists and named
        tuples come back as tuples, numpy's numbers as Python's.
    """
    return json.dumps(plain(value), separators=(",", ":")).encode()


def decoded(data: bytes, classes: Classes) -> Any:
    """The value that `encoded` received.

    classes: those of its records, by name.
    """
    return record_of(json.loads(data), classes)


def plain(value: Any) -> Any:
    """The value as lists, texts, numbers, None and dicts of these, for `record_of`."""
    if is_dataclass(value):
        return {
            _CLASS: type(value).__name__,
            _VALUES: [plain(getattr(value, field.name)) for field in fields(value)],
        }
    if isinstance(value, Mapping):
        return {_MAP: [[plain(key), plain(item)] for key, item in value.items()]}
    if isinstance(value, np.ndarray):
        return {_ARRAY: [value.dtype.str, value.shape, b64encode(value.tobytes()).decode()]}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def record_of(value: Any, classes: Classes) -> Any:
    """The value that `plain` received.

    classes: those of its records, by name.
    """
    if isinstance(value, list):
        return tuple(record_of(item, classes) for item in value)
    if not isinstance(value, dict):
        return value
    if _ARRAY in value:
        kind, shape, data = value[_ARRAY]
        return np.frombuffer(b64decode(data), kind).reshape(shape).copy()
    if _MAP in value:
        return {record_of(key, classes): record_of(item, classes) for key, item in value[_MAP]}
    return classes[value[_CLASS]](*(record_of(item, classes) for item in value[_VALUES]))
