"""What became of many cases at once: the rules of `CaseResult`'s properties over columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.results import EVALUATED, GAVE_UP, CaseResult
from sumo_eval.scoring.kept_rows import arrays_in_parts
from sumo_eval.trajectory import BoolArray, FloatArray

_FIELDS = (
    "zone",
    "status",
    "collided",
    "struck_from_behind",
    "ideal_severity",
    "no_reaction_severity",
    "departure_time",
)


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
    departed: BoolArray
    gave_up: BoolArray

    @classmethod
    def of(cls, cases: Sequence[CaseResult]) -> OutcomeColumns:
        """Those of rows, of which nothing else is read, and that some at a time."""
        parts = [cls._of_some(read) for read in arrays_in_parts(cases, *_FIELDS)]
        if not parts:
            return cls.of([])
        return cls(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(cls)))

    @classmethod
    def _of_some(cls, read: Mapping[str, NDArray[Any]]) -> OutcomeColumns:
        return cls(
            safe=read["zone"] == "safe",
            evaluated=np.isin(read["status"], EVALUATED),
            off_road=read["status"] == "off_road",
            collided=read["collided"] == 1.0,
            struck=read["struck_from_behind"] == 1.0,
            ideal=read["ideal_severity"],
            unreacting=read["no_reaction_severity"],
            departed=np.isfinite(read["departure_time"]),
            gave_up=np.isin(read["status"], GAVE_UP),
        )

    @property
    def counted(self) -> BoolArray:
        """Cases that count in T, A, H and S+: those given up among them."""
        return np.asarray(self.evaluated | self.gave_up)

    @property
    def incident(self) -> BoolArray:
        """Cases with a contact, a departure or a giving up."""
        return np.asarray(self.collided | self.departed | self.gave_up)

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
