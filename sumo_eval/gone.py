"""Removed names: one sentence each says what to use instead."""

from __future__ import annotations

from typing import Never

from sumo_eval.errors import InputError

MODULES = {
    "sumo_eval.adapters": "copy the adapter from docs/examples/adapters: `carla_agent.py:CarlaAgent?options.agent=...`",
}
"""Modules that locators named, and what to do instead."""


def is_use_case(name: str) -> bool:
    """Whether `name` is a use case written as Gherkin, or the catalogue of them."""
    return name.endswith((".feature.md", ".feature")) or name == "autoware"


def refuse_use_case(name: str) -> Never:
    """Raise InputError: use cases became scenario files."""
    raise InputError(
        f"Use cases as Gherkin tables are not supported any more, got {name}: write the rows as `[[sample]]` points "
        "and the `Then` lines as `[[require]]` of a scenario file (docs/space.md)."
    )
