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
from sumo_eval.settings import SimulationSettings
from sumo_eval.settings.checked import about

KNOWN = ("1", "m", "s", "m/s", "m/s2", "m/s3", "deg", "rad", "1/s", "1/m", "1/km", "kg")
"""Units of numbers in this package; `1` for a number without a unit."""
# other spellings of known units
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
"""Other units, in lower case: the known unit that each becomes, and the factor for its numbers."""

# the number that a text begins with, as `30` or `1e3`
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")


def spelt(unit: str) -> str:
    """A unit in the spelling of `KNOWN`; a unit that is unknown, as it is."""
    return _SPELT.get(unit.strip(), unit.strip())


def factor_to(own: str, unit: str, column: str) -> float:
    """The factor from numbers in `unit` to numbers in `own`.

    column: name of the numbers' column in errors.
    """
    others = {name: factor for name, (known, factor) in _CONVERSIONS.items() if known == spelt(own)}
    factors = {spelt(own).lower(): 1.0, **others}
    if (factor := factors.get(spelt(unit.lower()))) is None:
        raise unknown(f"unit of {column}:", unit, (own, *others))
    return factor


@functools.cache
def si_factor(unit: str) -> float | None:
    """The factor from numbers in a unit to the SI unit; None: the unit is unknown."""
    factors = {name: factor for name, (_, factor) in _CONVERSIONS.items()}
    # the units of `KNOWN` are SI units, except these two
    factors |= dict.fromkeys(KNOWN, 1.0) | {"deg": math.radians(1.0), "1/km": 0.001}
    return factors.get(spelt(unit.lower()))


def in_own_unit(value: float, factor: float) -> float:
    """A number converted by a factor. Where the product differs from a decimal of at most 9 places
    only by rounding, it is that decimal.

    35 cm are 0.35 m, not the product 0.35000000000000003, which is beyond a bound of 0.35 m.
    """
    product = value * factor
    decimal = round(product, 9)
    is_decimal = factor != 1.0 and math.isclose(decimal, product, rel_tol=1e-15)
    return decimal if is_decimal else product


def refuse_unit(formula: str | float, owner: str) -> None:
    """Refuse a number with a unit where a formula should be: `30 km/h`."""
    text = str(formula)
    match = _NUMBER.match(text)
    if not match:
        return
    value, unit = match[1], text[match.end() :].strip()
    own, factor = _CONVERSIONS.get(unit.lower(), (spelt(unit), 1.0))
    # spellings of `1` are not units here: `30`, an unfinished `30 -`
    if own in KNOWN and unit not in ("", "-", "1"):
        raise InputError(
            f"{owner} must be a number without a unit, got {formula}: as {own} write "
            f"{factor * float(value):.6g}."
        )


def check_unit(unit: str, owner: str, numbers: Mapping[str, float | None]) -> None:
    """Refuse a unit of a parameter or option that is not one of `KNOWN`.

    numbers: its numbers in the file by key; the message converts them.
    """
    if spelt(unit) in KNOWN:
        return
    conversion = _CONVERSIONS.get(unit.strip().lower())
    if conversion is None:
        raise unknown(f"unit of {owner}:", unit, KNOWN)
    own, factor = conversion
    written = ", ".join(
        f"{key} = {factor * value:.6g}" for key, value in numbers.items() if value is not None
    )
    raise InputError(
        f"The unit of {owner} must be {own}, got {unit}: expressions and scripts take its numbers "
        f"as {own}. Write them so{f' ({written})' if written else ''}."
    )


def check_uses(table: Any, units: Mapping[str, str], where: str) -> None:
    """Refuse a key that is set to the name of a parameter or option with another unit than the
    key's, and a parameter that is a setting of the drive in another unit than the setting's.

    table: a table of the scenario file, with the tables in it.
    units: of parameters and options by name; `1` always fits.
    where: name of the file in errors.
    """
    for item, key, name in _texts_in(table):
        if "." in name and name in units:  # the parameter is itself a setting of the drive
            group, key = name.split(".")
            item = getattr(SimulationSettings(), group)
        wanted = about(type(item), key).unit
        unit = spelt(units.get(name, "1"))
        if wanted and unit not in ("1", wanted):
            raise InputError(
                f"`{key}` in {where} must be in {wanted}, got `{name}`, which is in {unit}."
            )


def _texts_in(table: Any) -> Iterator[tuple[Any, str, str]]:
    """Every text in a table and in the tables that it holds: (its table, its key, the text).

    Keys may hold tuples of texts or of tables, and tuples of these.
    """
    for field in fields(table):
        values = [getattr(table, field.name)]
        for value in values:
            if isinstance(value, tuple):
                values += value  # this loop comes to them later
            elif is_dataclass(value):
                yield from _texts_in(value)
            elif isinstance(value, str):
                yield table, field.name, value.strip()
