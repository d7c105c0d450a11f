"""Checks of arguments of the functions in `method/`, and a quotient with a condition.

Users: `method/`. Free to change: the words of the messages.
"""

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import must_be
from sumo_eval.trajectory import BoolArray, FloatArray


def finite(owner: str, name: str, values: ArrayLike) -> FloatArray:
    """The values as an array of any shape. Raises InputError for a value that is not finite.

    owner: object that has the values, for the error message, e.g. "an approach".
    name: of the values, e.g. "gap".
    values: numbers or arrays of any shape.
    """
    array = np.asarray(values, float)
    unusable = array[~np.isfinite(array)]
    if unusable.size:
        raise must_be(f"`{name}`", owner, "finite", float(unusable[0]))
    return array


def not_negative(
    owner: str, name: str, values: ArrayLike, *, above_zero: bool = False
) -> FloatArray:
    """The values as an array of any shape. Raises InputError for a value that is negative or not
    finite.

    owner, name, values: as in `finite`.
    above_zero: whether 0 is refused as well.
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
    """Dividend over divisor where `where` is true, `otherwise` elsewhere.

    All arguments broadcast. Without numpy's warnings on divisors of 0, which `where` leaves out.
    """
    result = np.full(np.broadcast(dividend, divisor, where).shape, otherwise)
    np.divide(dividend, divisor, out=result, where=where)
    return result
