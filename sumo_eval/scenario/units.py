"""Units of parameters, options and columns of scenario files and CSV files: the known units, and
conversions of others into them.

Users: `cosim/doors/fmu.py`, `scenario/file_tables.py`, `scenario/formulas.py`,
`scenario/number_table.py`.
"""

import functools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from sumo_eval.errors import InputError, unknown
from sumo_eval.settings.checked import about

KNOWN = ("1", "m", "s", "m/s", "m/s2", "m/s3", "deg", "rad", "1/s", "1/m", "1/km", "kg")
"""Units of numbers in this package; `1` for a number without a unit."""
_SPELT = {
    "m/s^2": "m/s2",
    "m/s²": "m/s2",
    "m/s^3": "m/s3",
    "m/s³": "m/s3",
    "°": "deg",
    "-": "1",
    "": "1",
}
_FOOT, _HOUR = 0.3048, 3600.0  # m, s
_CONVERSIONS = {
    **dict.fromkeys(("km/h", "kmh", "kph", "kmph"), ("m/s", 1.0 / 3.6)),
    "mph": ("m/s", 5280.0 * _FOOT / _HOUR), "kn": ("m/s", 1852.0 / _HOUR), "ft/s": ("m/s", _FOOT),
    "km": ("m", 1000.0), "cm": ("m", 0.01), "mm": ("m", 0.001), "ft": ("m", _FOOT),
    "mi": ("m", 5280.0 * _FOOT),
    "ms": ("s", 0.001), "min": ("s", 60.0), "h": ("s", _HOUR),
    "g": ("m/s2", 9.80665), "%": ("1", 0.01),
}  # fmt: skip
"""Other units: the known unit that each becomes, and the factor for its numbers."""

_WITH_UNIT = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*([^\s\d.][^()]*?)\s*")


def spelt(unit: str) -> str:
    """A unit as it stands in `KNOWN`, where it is one of them in another spelling."""
    return _SPELT.get(unit.strip(), unit.strip())


def factor_to(own: str, unit: str, column: str) -> float:
    """The factor from numbers in a unit to the unit `own`.

    column: what errors name.
    """
    others = {name: factor for name, (meant, factor) in _CONVERSIONS.items() if meant == spelt(own)}
    factors = {own.lower(): 1.0, spelt(own).lower(): 1.0, **others}
    if (factor := factors.get(spelt(unit).lower())) is None:
        raise unknown(f"unit of {column}:", unit, (own, *others))
    return factor


@functools.cache
def si_factor(unit: str) -> float | None:
    """The factor from numbers in a unit to the SI unit; None: the unit is unknown."""
    factors = {name: factor for name, (_, factor) in _CONVERSIONS.items()}
    factors |= dict.fromkeys(KNOWN, 1.0) | {"deg": math.radians(1.0)}
    return factors.get(spelt(unit).lower())


def in_own_unit(value: float, factor: float) -> float:
    """A number converted by a factor; the result of a short decimal is a short decimal.

    35 cm are 0.35 m, not the product 0.35000000000000003, which is beyond a bound of 0.35 m.
    """
    product = value * factor
    short = round(product, 9)
    is_short = factor != 1.0 and math.isclose(short, product, rel_tol=1e-15)
    return short if is_short else product


def refuse_unit(formula: str | float, owner: str) -> None:
    """Refuse a number with a unit where a formula should be: `30 km/h`."""
    match = _WITH_UNIT.fullmatch(str(formula))
    if not match:
        return
    own, factor = _CONVERSIONS.get(match[2].lower(), (spelt(match[2]), 1.0))
    if own in KNOWN:
        raise InputError(
            f"{owner} must be a number without a unit, got {formula}: as {own} write "
            f"{factor * float(match[1]):.6g}."
        )


def check_unit(unit: str, owner: str, numbers: Mapping[str, float | None]) -> None:
    """Refuse a unit that the numbers of a parameter cannot be in.

    numbers: its low, high and the like.
    """
    if spelt(unit) in KNOWN:
        return
    if unit.strip().lower() not in _CONVERSIONS:
        raise unknown(f"unit of {owner}:", unit, KNOWN)
    own, factor = _CONVERSIONS[unit.strip().lower()]
    written = ", ".join(
        f"{key} = {factor * value:.6g}" for key, value in numbers.items() if value is not None
    )
    raise InputError(
        f"The unit of {owner} must be {own}, got {unit}: expressions and scripts take its numbers "
        f"as {own}. Write them so{f' ({written})' if written else ''}."
    )


def check_uses(table: Any, units: Mapping[str, str], where: str) -> None:
    """Refuse keys of a table or its tables that are set to parameters in a wrong unit.

    units: of parameters by name; `1` always fits.
    """
    for item, key, name in _names_in(table):
        wanted = about(type(item), key).unit
        unit = spelt(units.get(name, "1"))
        if wanted and unit not in ("1", wanted):
            raise InputError(
                f"`{key}` in {where} must be in {wanted}, got `{name}`, which is in {unit}."
            )


def _names_in(table: Any) -> Iterator[tuple[Any, str, str]]:
    """Every text in a table and in the tables that it holds: its table, its key, and the text.

    Keys may hold tuples of texts or of tables, and tuples of these.
    """
    for field in fields(table):
        found = [getattr(table, field.name)]
        for one in found:
            if isinstance(one, tuple):
                found += one  # looked at later in this loop
            elif is_dataclass(one):
                yield from _names_in(one)
            elif isinstance(one, str):
                yield table, field.name, one.strip()
