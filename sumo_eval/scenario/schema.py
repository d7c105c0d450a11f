"""JSON schemas of the files that people write, with every key's meaning and unit in them."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from sumo_eval.scenario.file_tables import ScenarioFile
from sumo_eval.settings import EvaluationSettings


def scenario_schema() -> dict[str, Any]:
    """JSON schema of a scenario file."""
    return _schema(ScenarioFile)


def evaluation_schema() -> dict[str, Any]:
    """JSON schema of an evaluation file."""
    return _schema(EvaluationSettings)


def _schema(root: type) -> dict[str, Any]:
    schema: dict[str, Any] = TypeAdapter(root).json_schema()
    return {**schema, "$schema": "https://json-schema.org/draft/2020-12/schema"}
