"""S+ of the ADSs that ship when a constant is halved or doubled: `python tools/robustness.py FOLDER`.

The ADSs drive the points of `tools/games.py`, and so does a policy of `tools/search.py` that steers aside late and
leaves the road at times. Prints the table of docs/trust.md. FOLDER: of the run, which is scored
again where it exists, that of `tools/games.py` too.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
from games import POINTS, evaluation, table

import sumo_eval
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.method.severity import Contact
from sumo_eval.settings import AdsSettings

HERE = Path(__file__).resolve()
AT_TIMES = "policy_673_454_86_215_251_913_621_475_176_206"
UNIT = 500.0  # m/s: a severity of one's own lies within 0..1
BOTH = (("/2", 0.5), ("x2", 2.0))


def of_contact(hit: Contact, beside_the_road: float = 1.0) -> float:
    """Eq. 15: U = |v_ego - v_obstacle| / w, in units of 500 m/s, as A is of ratios; a departure's times a factor."""
    factor = beside_the_road if hit.other == "roadside" else 1.0
    return factor * hit.closing_speed / max(hit.overlap, 0.5) / UNIT


def halved_departure(hit: Contact) -> float:
    """U, and half of it beside the road."""
    return of_contact(hit, 0.5)


def doubled_departure(hit: Contact) -> float:
    """U, and twice of it beside the road."""
    return of_contact(hit, 2.0)


CHANGES = {
    "as it ships": [],
    **{f"x0 {name}": [f"method.task.sharpness={0.01 * factor}"] for name, factor in BOTH},
    **{f"road_margin {name}": [f"method.task.road_margin={0.5 * factor}"] for name, factor in BOTH},
    **{f"a : b {name}": [f"method.score.a={100 * factor / (1 + factor)}"] for name, factor in BOTH},
    "departure /2": [f"method.collision.severity={HERE}:halved_departure"],
    "departure x2": [f"method.collision.severity={HERE}:doubled_departure"],
}


def main() -> None:
    """Drive once, score with each change, print S+."""
    folder = Path(sys.argv[1])
    if not folder.exists():
        ads = [AdsSettings(name, name) for name in SHIPPED]
        ads.append(AdsSettings("leaves the road at times", f"{HERE.with_name('search.py')}:{AT_TIMES}"))
        sumo_eval.evaluate(evaluation(POINTS, ads), folder)
    columns = {}
    for name, changes in CHANGES.items():
        columns[name] = table(sumo_eval.score(folder, changes)).set_index("ADS")["S+"]
        print(name, " ".join(columns[name].index), file=sys.stderr, flush=True)
    print(pd.DataFrame(columns).sort_values("as it ships", ascending=False).round(1).to_string())


if __name__ == "__main__":
    main()
