"""Declaration of records: dataclasses whose fields never change, and what a key of settings means.

Users: `ads/`, `case_table.py`, `cases.py`, `cosim/`, `drivers/`, `method/`, `record/`, `report/`,
`results.py`, `scenario/`, `score_notes.py`, `scoring/`, `settings/`, `trajectory.py`, `whatif/`,
`extras/`.
"""

from dataclasses import dataclass, field
from typing import Any, dataclass_transform


def required(text: str, unit: str = "") -> Any:
    """A key without a default, and its meaning."""
    return field(metadata=About(text, unit).metadata)


@dataclass_transform(frozen_default=True, field_specifiers=(field, required))
def frozen(cls: Any = None, /, **options: bool) -> Any:
    """Make a class a frozen dataclass with slots.

    options: others of `dataclass`: eq, init.
    """
    return dataclass(cls, frozen=True, slots=True, **options)


@frozen
class About:
    """Meaning of a setting, for the documentation, the schema and the report.

    symbol, equation: those of the paper, if it has any.
    """

    text: str
    unit: str = ""
    symbol: str = ""
    equation: str = ""

    @property
    def description(self) -> str:
        """The meaning and the unit."""
        return f"{self.text} ({self.unit})" if self.unit else self.text

    @property
    def metadata(self) -> dict[str, Any]:
        """Of a dataclass's field: for `about`, and for pydantic's schema."""
        return {"about": self, "description": self.description}
