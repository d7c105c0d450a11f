"""Declaration of records: dataclasses whose fields never change.

Users: `ads/`, `case_table.py`, `cases.py`, `cosim/`, `drivers/`, `method/`, `record/`, `report/`,
`results.py`, `scenario/`, `score_notes.py`, `scoring/`, `settings/`, `trajectory.py`, `whatif/`,
`extras/`.
"""

from dataclasses import dataclass, field
from typing import Any, dataclass_transform


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frozen(cls: Any = None, /, **options: bool) -> Any:
    """Make a class a frozen dataclass with slots.

    options: others of `dataclass`: eq, init.
    """
    return dataclass(cls, frozen=True, slots=True, **options)
