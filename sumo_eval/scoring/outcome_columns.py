"""What became of many cases at once: the rules of `CaseResult`'s properties over columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.results import EVALUATED, CaseResult
from sumo_eval.scoring.kept_rows import arrays
from sumo_eval.trajectory import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class OutcomeColumns:
    """Flags (n,) that are called like the properties of `CaseResult` and hold by the same rules, and what they are made
    of. ideal: Ug and unreacting: U0, m/s, nan where they are not known. struck: whether the other was at fault.
    """

    safe: BoolArray
    evaluated: BoolArray
    off_road: BoolArray
    collided: BoolArray
    struck: BoolArray
    ideal: FloatArray
    unreacting: FloatArray

    @classmethod
    def of(cls, cases: Sequence[CaseResult]) -> OutcomeColumns:
        """Those of rows, of which nothing else is read."""
        read = arrays(
            cases, "zone", "status", "collided", "struck_from_behind", "ideal_severity", "no_reaction_severity"
        )
        return cls(
            safe=read["zone"] == "safe",
            evaluated=np.isin(read["status"], EVALUATED),
            off_road=read["status"] == "off_road",
            collided=read["collided"] == 1.0,
            struck=read["struck_from_behind"] == 1.0,
            ideal=read["ideal_severity"],
            unreacting=read["no_reaction_severity"],
        )

    @property
    def avoidable(self) -> BoolArray:
        """Collisions that the ideal vehicle avoids."""
        return np.asarray(self.collided & (self.ideal == 0.0))

    @property
    def unavoidable(self) -> BoolArray:
        """Collisions that the ideal vehicle has as well."""
        return np.asarray(self.collided & (np.nan_to_num(self.ideal) != 0.0))

    @property
    def caused(self) -> BoolArray:
        """Collisions that neither the ideal vehicle nor doing nothing has."""
        return np.asarray(self.avoidable & (self.unreacting == 0.0))

    @property
    def voids_index(self) -> BoolArray:
        """Collisions after which there is no D."""
        return np.asarray(self.safe & self.collided & (np.nan_to_num(self.ideal) == 0.0))

    @property
    def counts_for_index(self) -> BoolArray:
        """Cases that may have a D_i that counts."""
        return self.safe & ~self.collided & ~self.struck
