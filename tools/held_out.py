"""How near what `sumo-eval learn` fits comes to people who neither fitted it nor chose it. Prints a table of
docs/recordings.md.

    python tools/held_out.py LEARNED [vehicle | recording | SEED | apart]

LEARNED: a folder that `learn` wrote. Each fifth of the vehicles (or each recording) is held out once; SEED, a number,
deals the vehicles out at random into as many parts as there are recordings, each of as many vehicles: what recordings
of the same people would give. On the others the model is chosen as `learn` chooses it, on inner folds of vehicles, and
fitted; the held-out events are put into it. The Kolmogorov distance is that of all held-out events together from the
distributions that predicted them. Beside it stands the distance that as many events of the true distribution would
exceed in one case of twenty.

apart: no model. Of the first recording and the others the parameter that differs least like random parts of as many
vehicles: its Kolmogorov distance, the share of such parts in which it is as large, and the share in which some
parameter is as unlikely.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import ks_2samp, rankdata

from sumo_eval.rates.intervals import kolmogorov, kolmogorov_by_chance
from sumo_eval.rates.learned import FOLDS, choose_model, fold_of, marginal_shares
from sumo_eval.scenario.file import read_scenario
from sumo_eval.scenario.joint import Joint

DRAWS = 2_000  # random parts beside which two recordings are seen


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


def apart(path: Path) -> str:
    """A row of the table: class, events of both, the least likely parameter, its distance and how often chance has it,
    and how often chance has a parameter that is as unlikely.
    """
    names = list(read_scenario(path).names)
    who = pd.read_csv(path.with_suffix(".events.csv"))

    def distances(seed: int | None) -> list[float]:
        first = parts_of(who, seed) == 0
        return [float(ks_2samp(who[name][first], who[name][~first]).statistic) for name in names]

    real, drawn = np.array(distances(None)), np.array([distances(seed) for seed in range(DRAWS)])
    likely = (drawn >= real - 1e-12).mean(axis=0)
    as_large = 1.0 - (rankdata(drawn, "min", axis=0) - 1.0) / DRAWS
    least = int(np.argmin(likely))
    first = parts_of(who, None) == 0
    return (
        f"| {path.stem} | {first.sum()}, {(~first).sum()} | {names[least]} | {real[least]:.3f} | "
        f"{100.0 * likely[least]:.1f} % | {100.0 * np.mean(as_large.min(axis=1) <= likely[least] + 1e-12):.1f} % |"
    )


if __name__ == "__main__":
    for path in sorted(Path(sys.argv[1]).glob("*.toml")):
        if path.with_suffix(".events.csv").exists():
            by = sys.argv[2] if len(sys.argv) > 2 else "vehicle"
            print(apart(path) if by == "apart" else nested(path, by), flush=True)
