"""What the adapters share: the ADS that they drive, and vectors."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from sumo_eval.cosim.doors.controller import adapter_for
from sumo_eval.errors import InputError, said
from sumo_eval.settings.locators import load_object


def found_agent(agent: Any, method: str, owner: str) -> Any:
    """The class or object that `agent` names, which must have `method`.

    Raises InputError for anything else.

    A `file.py:Name` lies where the process runs, or where Python looks for modules: an evaluation
    file's folder is one.
    """
    if agent is None:
        raise InputError(
            f"{owner} needs the ADS that it drives: `{owner}?options.agent=my_agent.py:Agent`."
        )
    if isinstance(agent, str):
        place = agent.rpartition(":")[0]
        folder = next(
            (
                Path(p)
                for p in ("", *sys.path)
                if place.endswith(".py") and Path(p, place).is_file()
            ),
            None,
        )
        agent = load_object(agent, folder, f"{owner}'s agent")
    if not callable(getattr(agent, method, None)):
        kind = agent if inspect.isclass(agent) else type(agent)
        other = adapter_for(agent)
        hint = f" `{other}` drives it." if other else ""
        wanted = f"a class or an object with a method `{method}`"
        raise InputError(f"`agent` of {owner} must be {wanted}, got {kind.__name__}.{hint}")
    return agent


def made_agent(agent: Any, options: Mapping[str, Any], owner: str) -> Any:
    """An object of the agent's class, made with the options; an object is taken as it is."""
    if not inspect.isclass(agent):
        if options:
            raise InputError(
                f"{owner} takes no more options where `agent` is an object: {', '.join(options)}."
            )
        return agent
    try:
        return agent(**options)
    except KeyboardInterrupt:
        raise
    except Exception as error:
        raise InputError(f"{owner}: making a {agent.__name__} failed: {said(error)}.") from error


def takes(function: Any, name: str) -> bool:
    """Whether a function or a class has a parameter of that name."""
    try:
        return name in inspect.signature(function).parameters
    except (TypeError, ValueError):
        return False


def positional(function: Any) -> int:
    """How many arguments a bound method must be given in order."""
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    parameters = inspect.signature(function).parameters.values()
    return sum(p.kind in kinds and p.default is p.empty for p in parameters)


def vector(x: float, y: float) -> SimpleNamespace:
    """A vector in the plane."""
    return SimpleNamespace(x=x, y=y, z=0.0)


def densified(line: Any, step: float = 2.0, beyond: float = 300.0) -> Any:
    """Points along a line, (n, 2) m, about a step apart and straight on before and after it."""
    points = np.asarray(line, dtype=float)
    ends = points[1] - points[0], points[-1] - points[-2]
    first, last = (end / np.linalg.norm(end) * beyond for end in ends)
    points = np.vstack([points[0] - first, points, points[-1] + last])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], max(round(along[-1] / step), 2))
    return np.stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)], axis=1)
