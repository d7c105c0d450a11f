"""What small evaluations of every shipped scenario come to, kept in files, so that a change of
behaviour is seen.

    python tests/golden/golden.py            says what is different from the kept files
    python tests/golden/golden.py --write    writes them again, and says what changed

One file a scenario: a line for every drive of an ADS (how it ended, when, how hard it hit, a hash
of all trajectories), a hash for every synthetic driver, and every number of the scores. Hashes are
of the recorded channels to the bit; they hold for the versions that the file names, because other
versions of the C library round a sine differently.
"""

import argparse
import dataclasses
import functools
import hashlib
import json
import math
import platform
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

import numpy as np

import sumo_eval
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.record.store import open_store
from sumo_eval.scenario.catalogue import SCENARIOS, load
from sumo_eval.settings import (
    AdsSettings,
    DriverSettings,
    EvaluationSettings,
    MethodSettings,
    RunSettings,
    SamplingSettings,
    ScenarioSettings,
    ZoneSettings,
)
from sumo_eval.trajectory import CHANNELS, NO_RETURN

FOLDER = Path(__file__).parent
POINTS, FEW_POINTS = 12, 4
FEW = ("no_reaction", "ideal_braking", "idm", "attentive", "lane_changer")
"""Who drives where others react, wait for what happens, or no zone has a closed form: a second each
is enough."""
COARSE = ZoneSettings(grid_points=1_000, restarts=0, refinements=0)
DRIVERS, FEW_DRIVERS = 4, 2
NATIVE = "sumo:IDM"
TOLERANCE = 1e-9  # of scores, relative to 1 or to their own size where that is larger
MADE_WITH = ("libsumo", "numpy")


def _closed_form(scenario):
    return load(scenario).approach is not None


IN_THE_SUITE = {True: ("curve_cut_in",), False: ("ramp_merge",)}
"""By whether their zones have a closed form: a bend, and a ramp. The campaign has all others."""


def _others(closed):
    return tuple(
        sorted(
            name
            for name in SCENARIOS
            if _closed_form(name) == closed and name not in IN_THE_SUITE[closed]
        )
    )


PARTS = (
    IN_THE_SUITE[True], IN_THE_SUITE[False],
    *(_others(closed)[half::2] for closed in (True, False) for half in (0, 1)),
)  # fmt: skip
"""The scenarios of each evaluation: to start one costs most, and four of a length can be driven
side by side."""


def evaluation(part):
    """One small evaluation of scenarios whose zones all have a closed form, or all have none.

    All shipped ADSs and one of SUMO's models drive a few points of the former, `FEW` fewer points
    of the latter. `attentive` is `idm` but for who comes into its path, and drives where somebody
    does.
    """
    scenarios = PARTS[part]
    closed_form = _closed_form(scenarios[0])
    names = (*(name for name in SHIPPED if name != "attentive"), NATIVE) if closed_form else FEW
    sampling = SamplingSettings(method="sobol", count=POINTS if closed_form else FEW_POINTS)
    return EvaluationSettings(
        name="golden",
        scenario=tuple(ScenarioSettings(name, sampling) for name in scenarios),
        ads=tuple(AdsSettings(name.replace(":", "_"), name) for name in names),
        drivers=DriverSettings(count=DRIVERS if closed_form else FEW_DRIVERS),
        run=RunSettings(engine="serial"),
        method=MethodSettings() if closed_form else MethodSettings(zones=COARSE),
    )


@functools.cache
def _done(part):
    folder = tempfile.TemporaryDirectory()
    return sumo_eval.evaluate(evaluation(part), Path(folder.name) / "run"), folder


def measured(scenario):
    """What the evaluation of a scenario comes to today, in the shape of a golden file."""
    done, _ = _done(next(part for part, scenarios in enumerate(PARTS) if scenario in scenarios))
    with open_store(done.folder) as store:
        drives = {fact.case: _drive(fact, store) for fact in store.facts("ads", scenario)}
        people = {}
        for fact in store.facts("human", scenario):
            people.setdefault(fact.driver, hashlib.sha256()).update(
                _hash(store, fact.case).encode()
            )
    return {
        "made_with": made_with(),
        "drives": drives,
        "people": {name: found.hexdigest()[:16] for name, found in sorted(people.items())},
        "scores": {
            score.ads: _numbers(score) for score in done.scores if score.scenario == scenario
        },
    }


def made_with():
    """The versions on which the last bit of a trajectory depends."""
    return {name: version(name) for name in MADE_WITH} | {
        "c_library": " ".join(platform.libc_ver()),
        "machine": platform.machine(),
    }


def kept(scenario):
    """The golden file of a scenario."""
    return json.loads((FOLDER / f"{scenario}.json").read_text())


def check(scenario):
    """Fail where drives, people or scores are not the golden ones, and name each that is not."""
    found = measured(scenario)
    assert found["scores"]["ideal_braking"]["c"] == 1.0
    told = list(differences(kept(scenario), found))
    assert not told, "\n".join(
        [*told[:20], "If this is meant: python tests/golden/golden.py --write"]
    )


def write(scenario, content):
    """Keep it, a line a drive, so that a change shows in a diff."""
    parts = []
    for name, part in content.items():
        lines = ",\n".join(
            f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in part.items()
        )
        parts.append(f"{json.dumps(name)}: {{\n{lines}\n}}")
    (FOLDER / f"{scenario}.json").write_text("{" + ",\n".join(parts) + "}\n")


def differences(old, new):
    """A sentence for everything that is not as it was: drives that end otherwise, hashes,
    scores."""
    same_bits = old["made_with"] == new["made_with"]
    for part in ("drives", "people", "scores"):
        for name in sorted({*old[part], *new[part]}):
            before, after = old[part].get(name), new[part].get(name)
            if before is None or after is None:
                yield f"{part}: {name} is {'new' if before is None else 'gone'}."
            elif part == "people":
                if same_bits and before != after:
                    yield f"people: {name} drives otherwise."
            else:
                yield from _unequal(f"{part}: {name}", before, after, same_bits=same_bits)


def _unequal(what, before, after, *, same_bits):
    for key in sorted({*before, *after}):
        old, new = before.get(key), after.get(key)
        if key == "trajectories":
            if same_bits and old != new:
                yield f"{what}: the trajectories differ in some bit."
        elif not _close(old, new):
            yield f"{what}: {key} was {old}, is {new}."


def _close(old, new):
    if isinstance(old, list) and isinstance(new, list):
        return len(old) == len(new) and all(map(_close, old, new))
    if isinstance(old, float) and isinstance(new, int | float):
        return math.isclose(old, new, rel_tol=TOLERANCE, abs_tol=TOLERANCE) or (
            math.isnan(old) and math.isnan(new)
        )
    return old == new


def _drive(fact, store):
    hit = fact.collision
    return {
        "status": fact.status,
        "end": fact.end_reason,
        "time": fact.simulated_time,
        "impact": None if hit is None else hit.relative_speed,
        "clips": sum(clip.count for clip in fact.clips if clip.what != NO_RETURN),
        "trajectories": _hash(store, fact.case),
    }


def _hash(store, case):
    found = hashlib.sha256()
    for name, drive in sorted(store.trajectories(case).items()):
        found.update(name.encode())
        for channel in CHANNELS:
            found.update(np.ascontiguousarray(getattr(drive, channel)).tobytes())
    return found.hexdigest()[:16]


def _numbers(score):
    """Every number of a score by name; texts are not kept here."""
    plain = json.loads(json.dumps(dataclasses.asdict(score)))
    return {name: value for name, value in plain.items() if _is_numeric(value)}


def _is_numeric(value):
    if isinstance(value, list):
        return bool(value) and all(map(_is_numeric, value))
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def main():
    """Compare or write, and say what changed.

    Exit status 1: something differs and was not written.
    """
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--write", action="store_true", help="write the files again")
    arguments.add_argument("scenario", nargs="*", help="only these")
    given = arguments.parse_args()
    changed = False
    for scenario in given.scenario or sorted(SCENARIOS):
        new = measured(scenario)
        there = (FOLDER / f"{scenario}.json").is_file()
        found = (
            list(differences(kept(scenario), new)) if there else ["there is no golden file yet."]
        )
        print(
            f"{scenario}: {len(found) or 'no'} difference{'' if len(found) == 1 else 's'}",
            *found,
            sep="\n  ",
        )
        changed |= bool(found)
        if given.write:
            write(scenario, new)
    return int(changed and not given.write)


if __name__ == "__main__":
    sys.exit(main())
