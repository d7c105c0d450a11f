"""The report's section on people's opinion, from what `sumo-eval humans opinion` has left in the
run's folder.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError, said
from sumo_eval.input_file import read_input_text

OPINION = "opinion.json"
_BESIDE = ("S+", "A", "H", "S", "D", "C")
"""The scores beside the opinion; a file of an earlier version may lack some."""


def opinion_content(folder: Path) -> dict[str, Any] | None:
    """Content of templates/sections/opinion.html.j2; None without a study of opinion.

    Raises InputError when the file with the answers cannot be read.
    """
    path = folder / OPINION
    if not path.exists():
        return None
    text = read_input_text(path, "opinion")
    try:
        told = json.loads(text)
        rows, rho, ends = told["rows"], told["correlations"], told.get("intervals", {})
        panels = [
            {
                "name": name,
                "most": f"{_most(name):g}",
                "rho": rho[name],
                "interval": ends.get(name),
                "dots": _dots(rows, name, _most(name)),
            }
            for name in _BESIDE
            if name in rho
        ]
        return {
            "rows": rows,
            "names": [panel["name"] for panel in panels],
            "concordance": told["concordance"],
            "panels": panels,
        }
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path} cannot be read ({said(error)}); delete it, or ask again with: sumo-eval "
            "humans opinion."
        ) from error


def _most(name: str) -> float:
    """The most that a score can be."""
    return 100.0 if name.startswith("S") else 1.0


def _dots(rows: list[dict[str, Any]], name: str, most: float) -> list[dict[str, Any]]:
    dots = []
    for row in rows:
        score, opinion = row["scores"][name], row["opinion"]
        if score is not None:
            words = (
                f"{row['ads']} in {row['scenario']}: opinion {opinion:z.2f}, {name} {score:z.3g}"
            )
            dots.append(
                {
                    "opinion": opinion,
                    "share": min(max(score / most, 0.0), 1.0),
                    "words": words,
                    "row": (row["scenario"], row["ads"], opinion, score),
                }
            )
    return dots
