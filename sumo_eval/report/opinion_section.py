"""The report's section on people's opinion, from what `sumo-eval humans opinion` has left in the
run's folder.

Users: `extras/studies/opinion.py`, `report/assessed.py`, `report/sections.py`.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sumo_eval.input_file import read_input_text, taking_apart
from sumo_eval.scoring.gate_settings import HIGHER_IS_BETTER

OPINION = "opinion.json"
FIX = "Delete it, or ask again with: sumo-eval humans opinion."


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
        # a file of an earlier version may lack some scores, and has no intervals
        correlations, intervals = study["correlations"], study.get("intervals") or {}
        names = [name for name in HIGHER_IS_BETTER if name in correlations]
        rows = [_row(row, names) for row in study["rows"]]
        return {
            "rows": rows,
            "concordance": _number(study["concordance"]),
            "panels": [
                {
                    "name": name,
                    "most": f"{_highest(name):g}",
                    "rho": _number(correlations[name]),
                    "interval": _interval(intervals.get(name)),
                    "dots": list(_dots(name, rows)),
                }
                for name in names
            ],
        }


def _row(row: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """A rated ADS in a scenario: its ratings, and its scores of these names.

    Unary + raises TypeError for a value that is not a number.
    """
    return {
        "scenario": row["scenario"],
        "ads": row["ads"],
        **{name: +row[name] for name in ("opinion", "deviation", "raters")},
        "scores": {name: _number(row["scores"][name]) for name in names},
    }


def _dots(name: str, rows: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """A score over the mean rating, a dot for each row that has this score.

    share: the score divided by its highest value, 0..1. row: its line in the table that the
        page's reader may copy.
    """
    for row in rows:
        score, opinion = row["scores"][name], row["opinion"]
        if score is not None:
            yield {
                "opinion": opinion,
                "share": min(max(score / _highest(name), 0.0), 1.0),
                "words": f"{row['ads']} in {row['scenario']}: opinion {opinion:z.2f}, "
                f"{name} {score:z.3g}",
                "row": (row["scenario"], row["ads"], opinion, score),
            }


def _number(value: Any) -> Any:
    """The number or None that a value is; TypeError for anything else."""
    return value if value is None else +value


def _interval(ends: Any) -> tuple[Any, Any] | None:
    """The two numbers of an interval, or None; TypeError for anything else."""
    return None if ends is None else (+ends[0], +ends[1])


def _highest(name: str) -> float:
    """Highest value of a score: 100 points for S and S+, 1 for any other."""
    return 100.0 if name.startswith("S") else 1.0
