"""JSON schemas of the files that people write, with every key's meaning and unit in them."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

from pydantic import TypeAdapter

from sumo_eval.scenario.file_tables import ScenarioFile
from sumo_eval.settings import EvaluationSettings, about


def scenario_schema() -> dict[str, Any]:
    """JSON schema of a scenario file."""
    return _schema(ScenarioFile)


def evaluation_schema() -> dict[str, Any]:
    """JSON schema of an evaluation file."""
    return _schema(EvaluationSettings)


def _schema(root: type) -> dict[str, Any]:
    schema: dict[str, Any] = TypeAdapter(root).json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    for cls in _tables(root):
        table = schema if cls is root else schema["$defs"][cls.__name__]
        for name, entry in table["properties"].items():
            meaning = about(cls, name)
            if meaning.text:
                unit = f" ({meaning.unit})" if meaning.unit else ""
                entry["description"] = meaning.text + unit
    return schema


def _tables(root: Any) -> list[type]:
    """A settings class and those that it holds, at any depth."""
    if not is_dataclass(root):
        return [found for part in get_args(root) for found in _tables(part)]
    assert isinstance(root, type)
    hints = get_type_hints(root)
    return [root, *(found for item in fields(root) for found in _tables(hints[item.name]))]
