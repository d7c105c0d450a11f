"""Records that nothing changes: the decorator of their classes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, dataclass_transform


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frozen(cls: Any = None, *, eq: bool = True) -> Any:
    """Make a class a dataclass that is frozen and has slots.

    eq: whether two records with equal fields are equal; else a record equals itself alone.
    """
    made = dataclass(frozen=True, slots=True, eq=eq)
    return made if cls is None else made(cls)
