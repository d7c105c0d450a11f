"""Evaluation files that somebody broke: wrong types, unknown keys, nan, negative, huge, truncated, binary."""

from __future__ import annotations

import copy
import random
from typing import Any

import tomli_w

BASE: dict[str, Any] = {
    "name": "mutant",
    "seed": 3,
    "scenario": [{"use": "front_vehicle_low_speed", "sampling": {"method": "grid", "levels": 2}}],
    "ads": [{"name": "idm", "controller": "idm"}],
    "drivers": {"count": 2, "source": "synthetic"},
    "run": {
        "workers": 2, "case_timeout": 20.0, "step_timeout": 1.0, "memory_limit": 4096.0, "cases_per_child": 50,
        "engine": "processes", "incomplete": "shown",
    },
    "simulation": {"step": 0.05, "time_limit": 60.0, "vehicle": {"max_deceleration": 9.0, "wheelbase": 2.7}},
    "method": {
        "score": {"a": 50.0, "k5": 1.0}, "zones": {"deceleration": 5.0, "critical_inverse_ttc": 0.7},
        "anthropomorphic": {"centre_deviation_floor": 0.15, "field": {"k1": 0.5, "k2": 0.005}},
        "collision": {"loss": "severity"},
    },
    "report": {"reference": "careful_driver"},
}  # fmt: skip

WRONG: tuple[Any, ...] = (
    "x", "", "🚗", -1, 0, 1, 10**12, 10**30, -0.5, 0.0, 1e-300, 1e300, 0.5, float("nan"), float("inf"),
    float("-inf"), True, False, [], [1, "x"], {}, {"x": 1}, "nan", "../../etc/passwd", "a:b", "\u0000", " ",
)  # fmt: skip


def mutant(number: int) -> tuple[bytes, str]:
    """The file of that number and what was done to it; the same in every run."""
    draw = random.Random(number)
    content = copy.deepcopy(BASE)
    kind = draw.choice(("value", "value", "value", "value", "key", "missing", "truncated", "binary", "text"))
    place, key = draw.choice(list(_places(content)))
    name = f"{kind} at {key}"
    if kind == "value":
        place[key] = draw.choice(WRONG)
        name += f": {place[key]!r}"
    elif kind == "key":
        place[draw.choice((f"{key}s", "x", "", "levles", "a.b", "ключ"))] = draw.choice(WRONG)
    elif kind == "missing":
        del place[key]
    data = tomli_w.dumps(content).encode("utf-8", errors="surrogatepass")
    if kind == "truncated":
        data = data[: draw.randrange(len(data))]
    elif kind == "binary":
        at = draw.randrange(len(data))
        data = data[:at] + draw.randbytes(draw.randrange(1, 200)) + data[at:]
    elif kind == "text":
        at = draw.randrange(len(data))
        data = data[:at] + draw.choice((b"=", b"[", b'"', b"\n", b"#", b"-", b"e", b"nan", b"9" * 40)) + data[at + 1 :]
    return data, name


def _places(content: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """Every key of the file, with the table it stands in."""
    found = []
    for key, value in content.items():
        found.append((content, key))
        for table in value if isinstance(value, list) else [value]:
            if isinstance(table, dict):
                found += _places(table)
    return found
