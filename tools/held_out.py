"""How near what `sumo-eval learn` fits comes to people who neither fitted it nor chose it. Prints a table of
docs/recordings.md.

    python tools/held_out.py LEARNED [vehicle | recording | SEED]

LEARNED: a folder that `learn` wrote. Each fifth of the vehicles (or each recording) is held out once; SEED, a number,
deals the vehicles out at random into as many parts as there are recordings, each of as many vehicles: what recordings
of the same people would give. On the others the model is chosen as `learn` chooses it, on inner folds of vehicles, and
fitted; the held-out events are put into it. The Kolmogorov distance is that of all held-out events together from the
distributions that predicted them. Beside it stands the distance that as many events of the true distribution would
exceed in one case of twenty.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sumo_eval.rates.intervals import kolmogorov, kolmogorov_by_chance
from sumo_eval.rates.learned import FOLDS, choose_model, fold_of, marginal_shares
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.joint import Joint


def nested(path: Path, by: str) -> str:
    """A row of the table: class, events, held-out log-likelihood, distances, the models that were chosen."""
    logical = read_scenario(path)
    who = pd.read_csv(path.with_suffix(".events.csv"))
    names, rows = list(logical.names), who[list(logical.names)].to_numpy()
    low, high = tuple(logical.low.tolist()), tuple(logical.high.tolist())
    inner = fold_of(who)
    outer = inner if by == "vehicle" else parts_of(who, None if by == "recording" else int(by))
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
        f"{np.median(list(far.values())):.3f} | {kolmogorov_by_chance(len(together)):.3f} | {', '.join(chosen)} |"
    )


def parts_of(who: pd.DataFrame, seed: int | None) -> NDArray[np.intp]:
    """The number of each event's recording; with a seed, that of another vehicle, all a vehicle's events together."""
    of_event = pd.factorize(who["recording"])[0]
    if seed is None:
        return of_event
    _, first, vehicle = np.unique(
        who["recording"].astype(str) + "/" + who["ego"].astype(str), return_index=True, return_inverse=True
    )
    return np.random.default_rng(seed).permutation(of_event[first])[vehicle]


if __name__ == "__main__":
    for path in sorted(Path(sys.argv[1]).glob("*.toml")):
        if path.with_suffix(".events.csv").exists():
            print(nested(path, sys.argv[2] if len(sys.argv) > 2 else "vehicle"), flush=True)
