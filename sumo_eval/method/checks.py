"""Checks of numbers that callers give to the functions of this room, and quotients.

Users: `method/`.
"""

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import must_be
from sumo_eval.trajectory import BoolArray, FloatArray


def finite(owner: str, name: str, values: ArrayLike) -> FloatArray:
    """The values as an array.

    owner: object that has the values, for an error message.
    name: of the values.

    Raises InputError for a value that is not finite.
    """
    array = np.asarray(values, float)
    unusable = array[~np.isfinite(array)]
    if unusable.size:
        raise must_be(f"`{name}`", owner, "finite", float(unusable[0]))
    return array


def not_negative(
    owner: str, name: str, values: ArrayLike, *, above_zero: bool = False
) -> FloatArray:
    """The values as an array.

    Raises InputError as `finite`, and for a value below 0 (0 or below where `above_zero`).
    """
    array = finite(owner, name, values)
    wrong = array[array <= 0.0 if above_zero else array < 0.0]
    if wrong.size:
        wanted = "greater than 0" if above_zero else "at least 0"
        raise must_be(f"`{name}`", owner, wanted, float(wrong[0]))
    return array


def quotient(
    dividend: ArrayLike, divisor: ArrayLike, where: BoolArray, otherwise: float = np.inf
) -> FloatArray:
    """Dividend over divisor where a condition holds, `otherwise` elsewhere; all broadcast."""
    result = np.full(np.broadcast(dividend, divisor, where).shape, otherwise)
    np.divide(dividend, divisor, out=result, where=where)
    return result
