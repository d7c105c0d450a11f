"""JSON schemas of scenario files and evaluation files, with the meaning and unit of every key.

Users: `cli/tools.py`.
"""

from typing import Any

from pydantic import TypeAdapter

from sumo_eval.scenario.file_tables import ScenarioFile
from sumo_eval.settings import EvaluationSettings


def schema_of(kind: str) -> dict[str, Any]:
    """JSON schema of a file of a kind, `scenario` or `evaluation`."""
    root: type = ScenarioFile if kind == "scenario" else EvaluationSettings
    schema: dict[str, Any] = TypeAdapter(root).json_schema()
    return {**schema, "$schema": "https://json-schema.org/draft/2020-12/schema"}
