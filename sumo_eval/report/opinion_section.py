"""The report's section on people's opinion, from what `sumo-eval humans opinion` has left in the
run's folder.

Users: `extras/studies/opinion.py`, `report/assessed.py`, `report/sections.py`.
"""

import json
from pathlib import Path
from typing import Any

from sumo_eval.input_file import read_input_text, taking_apart

OPINION = "opinion.json"
FIX = "Delete it, or ask again with: sumo-eval humans opinion."
_COMPARED = "S+", "A", "H", "S", "D", "C"
"""Scores that the opinion is compared with; a file of an earlier version may lack some."""


def opinion_content(folder: Path) -> dict[str, Any] | None:
    """Content of templates/sections/opinion.html.j2; None without a study of opinion.

    Raises InputError when the file with the answers cannot be read.
    """
    path = folder / OPINION
    if not path.exists():
        return None
    text = read_input_text(path, "opinion")
    with taking_apart(path, FIX):
        study = json.loads(text)
        correlations = {name: _number(rho) for name, rho in study["correlations"].items()}
        # unary + raises TypeError for a value that is not a number; files of earlier versions have
        # no intervals
        intervals = {
            name: None if ends is None else (+ends[0], +ends[1])
            for name, ends in (study.get("intervals") or {}).items()
        }
        rows = [
            {
                **row,
                **{name: +row[name] for name in ("opinion", "deviation")},
                "scores": {name: _number(row["scores"][name]) for name in correlations},
            }
            for row in study["rows"]
        ]
        panels = [
            {
                "name": name,
                "most": f"{_highest(name):g}",
                "rho": correlations[name],
                "interval": intervals.get(name),
                # `share`: score over its highest value, 0..1; `row`: its line in the copied table
                "dots": [
                    {
                        "opinion": row["opinion"],
                        "share": min(max(score / _highest(name), 0.0), 1.0),
                        "words": f"{row['ads']} in {row['scenario']}: opinion "
                        f"{row['opinion']:z.2f}, {name} {score:z.3g}",
                        "row": (row["scenario"], row["ads"], row["opinion"], score),
                    }
                    for row in rows
                    if (score := row["scores"][name]) is not None
                ],
            }
            for name in _COMPARED
            if name in correlations
        ]
        return {
            "rows": rows,
            "names": [panel["name"] for panel in panels],
            "concordance": _number(study["concordance"]),
            "correlations": correlations,
            "intervals": intervals,
            "panels": panels,
        }


def _number(value: Any) -> Any:
    """The number or None that a value is; TypeError for anything else."""
    return value if value is None else +value


def _highest(name: str) -> float:
    """Highest value of a score: 100 points for S and S+; 1 for A, H, D and C, which are shares."""
    return 100.0 if name.startswith("S") else 1.0
