"""Distribution of a parameter's values on the road: one of scipy.stats, by its name there, cut to
the parameter's range.

scipy.stats is imported only when a distribution is used: the import takes 0.7 s, and every child
process imports this module.

Users: `drivers/recorded/exposure.py`, `extras/openscenario/space.py`, `scenario/file_tables.py`,
`scenario/logical.py`, `scenario/sampling/drawn_points.py`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, check_known
from sumo_eval.frozen import frozen
from sumo_eval.trajectory import FloatArray


@frozen
class Distribution:
    """A continuous distribution of scipy.stats.

    name: in scipy.stats, as `norm`.
    arguments: (name, value) of its shape parameters, of `loc` and of `scale`, sorted by name.
    """

    name: str
    arguments: tuple[tuple[str, float], ...]

    @classmethod
    def of(cls, name: str, arguments: Mapping[str, float], owner: str) -> Distribution:
        """A checked distribution.

        arguments: values by name.
        owner: the parameter, for messages.
        Raises InputError for a name that scipy.stats does not have and for wrong arguments.
        """
        stats = scipy_stats()
        names = (it for it, value in vars(stats).items() if isinstance(value, stats.rv_continuous))
        check_known(f"distribution of {owner}", sorted(names), name)
        # scipy lists shape parameters in one text, as "a, b"; None: there are none
        shapes = re.findall(r"\w+", getattr(stats, name).shapes or "")
        allowed = [*shapes, "loc", "scale"]
        check_known(f"argument of distribution `{name}` of {owner}", allowed, *arguments)
        for shape in shapes:
            if shape not in arguments:
                raise InputError(f"Distribution `{name}` of {owner} must be given `{shape}`.")
        checked = cls(name, tuple(sorted((key, float(value)) for key, value in arguments.items())))
        with np.errstate(invalid="ignore"):  # a `scale` of 0
            median = checked._of_scipy().ppf(0.5)
        if not np.isfinite(median):  # wrong arguments give no median
            raise InputError(
                f"Distribution `{name}` of {owner} does not exist with {dict(checked.arguments)}."
            )
        return checked

    def density(self, values: ArrayLike, low: float, high: float) -> FloatArray:
        """Probability density at values within low..high, per unit of the parameter: the density
        of scipy, scaled so that it integrates to 1 over that range.
        """
        return np.asarray(self._of_scipy().pdf(np.asarray(values, float)) / self.inside(low, high))

    def inside(self, low: float, high: float) -> float:
        """Probability of low..high, in the distribution before it is cut."""
        uncut = self._of_scipy()
        return float(uncut.cdf(high) - uncut.cdf(low))

    def quantile(self, shares: ArrayLike, low: float, high: float) -> FloatArray:
        """Values below which these shares of the probability within low..high lie."""
        uncut = self._of_scipy()
        begin = uncut.cdf(low)
        values = uncut.ppf(begin + np.asarray(shares, float) * (uncut.cdf(high) - begin))
        return np.asarray(np.clip(values, low, high))  # rounding may lead past an end

    def __str__(self) -> str:
        return f"{self.name}({', '.join(f'{name}={value:g}' for name, value in self.arguments)})"

    def _of_scipy(self) -> Any:
        """The distribution as scipy's object, not cut to any range."""
        return getattr(scipy_stats(), self.name)(**dict(self.arguments))


def scipy_stats() -> Any:
    """scipy.stats, imported at the first use; most evaluations drive a grid and do not need it."""
    from scipy import stats

    return stats
