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
_COMPARED = ("S+", "A", "H", "S", "D", "C")
"""Scores that the opinion is compared with; a file of an earlier version may lack some."""


def opinion_content(folder: Path) -> dict[str, Any] | None:
    """Content of templates/sections/opinion.html.j2; None without a study of opinion.

    Raises InputError when the file with the answers cannot be read.
    """
    path = folder / OPINION
    if not path.exists():
        return None
    text = read_input_text(path, "opinion")
    try:
        study = json.loads(text)
        rows, correlations = study["rows"], study["correlations"]
        intervals = study.get("intervals") or {}
        panels = [
            {
                "name": name,
                "most": f"{_highest(name):g}",
                "rho": correlations[name],
                "interval": intervals.get(name),
                "dots": _dots(rows, name, _highest(name)),
            }
            for name in _COMPARED
            if name in correlations
        ]
        return {
            "rows": rows,
            "names": [panel["name"] for panel in panels],
            "concordance": study["concordance"],
            "panels": panels,
        }
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path} cannot be read ({said(error)}); delete it, or ask again with: sumo-eval "
            "humans opinion."
        ) from error


def _highest(name: str) -> float:
    """Highest value of a score: S and S+ are points, A, H, D and C shares."""
    return 100.0 if name.startswith("S") else 1.0


def _dots(rows: list[dict[str, Any]], name: str, highest: float) -> list[dict[str, Any]]:
    """A dot for each row with this score.

    opinion and share: its place; `share` is the score as a share of the highest, 0..1.
    words: its tooltip. row: what the page's copied table has of it.
    """
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
                    "share": min(max(score / highest, 0.0), 1.0),
                    "words": words,
                    "row": (row["scenario"], row["ads"], opinion, score),
                }
            )
    return dots
