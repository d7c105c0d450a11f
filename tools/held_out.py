"""How near what `sumo-eval learn` fits comes to people who neither fitted it nor chose it. Prints a table of
docs/recordings.md.

    python tools/held_out.py LEARNED [vehicle | recording]

LEARNED: a folder that `learn` wrote. Each fifth of the vehicles (or each recording) is held out once; on the others the
model is chosen as `learn` chooses it, on inner folds of vehicles, and fitted; the held-out events are put into it. The
Kolmogorov distance is that of all held-out events together from the distributions that predicted them. Beside it stands
the distance that as many events of the true distribution would exceed in one case of twenty, 1.36 / sqrt(n).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from sumo_eval.rates.intervals import kolmogorov
from sumo_eval.rates.learned import FOLDS, choose_model, fold_of, marginal_shares
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.joint import Joint

CHANCE = 1.36  # over sqrt(n): the Kolmogorov distance's 95 % point


def nested(path: Path, by: str) -> str:
    """A row of the table: class, events, held-out log-likelihood, distances, the models that were chosen."""
    logical = read_scenario(path)
    who = pd.read_csv(path.with_suffix(".events.csv"))
    names, rows = list(logical.names), who[list(logical.names)].to_numpy()
    low, high = tuple(logical.low.tolist()), tuple(logical.high.tolist())
    inner = fold_of(who)
    outer = inner if by == "vehicle" else pd.factorize(who["recording"])[0]
    logs, shares, chosen = [], [], []
    for fold in np.unique(outer):
        train, test = outer != fold, outer == fold
        if train.sum() < FOLDS * len(names):
            continue
        best = choose_model(rows[train], names, (low, high), inner[train])[0]
        kind, factor = best.named
        joint = Joint(kind, tuple(names), tuple(map(tuple, rows[train].tolist())), low, high, factor)
        logs.append(np.log(np.maximum(joint.density(rows[test]) / joint.mass(), 1e-300)))
        shares.append(marginal_shares(joint, rows[test]))
        chosen.append(best.model)
    if not shares:
        return f"| {path.stem} | {len(rows)} | too few | | | |"
    together = np.concatenate(shares)
    far = {name: kolmogorov(together[:, j]) for j, name in enumerate(names)}
    most = max(far, key=lambda name: far[name])
    return (
        f"| {path.stem} | {len(together)} | {np.concatenate(logs).mean():.2f} | {far[most]:.3f} ({most}) | "
        f"{np.median(list(far.values())):.3f} | {CHANCE / math.sqrt(len(together)):.3f} | {', '.join(chosen)} |"
    )


if __name__ == "__main__":
    for path in sorted(Path(sys.argv[1]).glob("*.toml")):
        if path.with_suffix(".events.csv").exists():
            print(nested(path, sys.argv[2] if len(sys.argv) > 2 else "vehicle"), flush=True)
