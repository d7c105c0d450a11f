"""What a night finds of planted changes, and how often it cries over none.

`pytest -m campaign -s tests/campaign/test_nights.py`: prints a table for each size.
SUMO_EVAL_NIGHT_CASES names the sizes. Another ladder is kept for acceptance: no constant may be
fitted to this one.
"""

import contextlib
import os
import shutil
import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import pytest

import sumo_eval
from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.nightly.gates import judge
from sumo_eval.report.gate_result import failed
from sumo_eval.scenario.catalogue import load
from sumo_eval.scenario.sampling.request import Request
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.scoring.comparison import side_by_side
from sumo_eval.scoring.gate_settings import GateSettings
from sumo_eval.scoring.rule import (
    Ends,
    Noise,
    Repeats,
    floor_of,
    severity_floor,
    severity_limit,
    worse_ends,
)

pytestmark = pytest.mark.campaign
SIZES = tuple(int(text) for text in os.environ.get("SUMO_EVAL_NIGHT_CASES", "18 62").split())
SETTINGS = GateSettings(resamples=100)
BASE = "base"
WORK = 12_000.0  # rounds of a loop in each step: some 0.2 ms
PLANTED = tomllib.loads("""
"brakes 7" = { brakes = 7.0 }
"brakes 6" = { brakes = 6.0 }
"brakes 4" = { brakes = 4.0 }
"delay 0.2" = { delay = 0.2 }
"delay 0.4" = { delay = 0.4 }
"delay 0.8" = { delay = 0.8 }
"range 80" = { seen = 80.0 }
"range 60" = { seen = 60.0 }
"range 40" = { seen = 40.0 }
"headway 1.3" = { headway = 1.3 }
"headway 1.1" = { headway = 1.1 }
"headway 0.9" = { headway = 0.9 }
"speed 0.97" = { speed = 0.97 }
"speed 0.9" = { speed = 0.9 }
"shake 0.5" = { shake = 0.5 }
"shake 1.5" = { shake = 1.5 }
"latency 2" = { work = 24000.0 }
""")  # fmt: skip
SPECIAL = ("collides", "raises", "leaves")
DRIFT = {f"drift {night}": {"brakes": 8.0 * 0.98**night} for night in (1, 3, 5, 10)}
NOISES = (0.01, 0.1, 0.5)
DRIVES = 12  # of each noisy build
FURTHER = 4


def entry(name, options):
    return {"name": name, "controller": "ladder_ads.py:Build", "options": dict(options)}


def points_to_ask(use, possible):
    """How many points to ask for, so that the constraints of the scenario leave `possible` of
    them."""
    counts = range(possible, 10 * possible)
    left = (
        len(sample(load(use), "sobol", request=Request(count=count)).points) for count in counts
    )
    return next(count for count, n in zip(counts, left, strict=False) if n >= possible)


def driven(folder, name, cases, entries):
    """Drive builds at the same points: a lead that brakes, and a cut-in."""
    settings = {
        "name": name,
        "scenario": [
            {"use": use, "sampling": {"method": "sobol", "count": points_to_ask(use, cases // 2)}}
            for use in ("front_vehicle_braking", "cut_in")
        ],
        "ads": list(entries),
        "drivers": {"count": 4},
        "run": {"workers": 2, "case_timeout": 600.0, "step_timeout": 60.0},
    }
    with contextlib.chdir(folder):
        return sumo_eval.evaluate(settings, folder / name)


def only(run, ads):
    return replace(
        run,
        scores=tuple(score for score in run.scores if score.ads == ads),
        cases=tuple(case for case in run.cases if case.ads == ads),
    )


def beside(base, old, new, ads):
    after = only(new, ads)
    return side_by_side(only(base, old), after, SETTINGS, pairs={old: ads}), after


@dataclass(frozen=True)
class Row:
    """What a night said of a build.

    moved: whether any case moved beyond a tolerance.
    """

    build: str
    moved: bool
    found: bool
    named: bool
    by: str

    def __str__(self):
        flags = ("moved", "found", "named")
        told = (f"{name} {'yes' if getattr(self, name) else 'no':<4}" for name in flags)
        return " ".join([f"{self.build:<14}", *told, self.by])


def watched():
    return (*SETTINGS.near_miss.measure, *SETTINGS.shift.measure)


def worse_beyond(comparison):
    """Whether any case is worse beyond the tolerance of anything that the rule watches."""
    from sumo_eval.scoring.rule import newly_bad, tally

    ads, near = comparison.ads[0].ads, SETTINGS.near_miss.measure
    for one in watched():
        if tally(ads, comparison.ads, one, 0.0, near=one in near).number:
            return True
    ends = (newly_bad(one, SETTINGS, Repeats(0, 0)).values() for one in comparison.ads)
    return any(worse for found in ends for worse in found)


def told(base, new, ads, noise=None):
    comparison, after = beside(base, BASE, new, ads)
    bad = failed(judge(after, comparison, SETTINGS, noise or Noise()))
    by = ", ".join(gate.quantity for gate in bad)
    return Row(ads, worse_beyond(comparison), bool(bad), any(gate.worst for gate in bad), by)


def rows_of(run, ads):
    return sorted((case for case in run.cases if case.ads == ads), key=lambda case: case.case)


def repeats(run, first, second):
    """What two drives of one build tell, of 30 cases at most, as a night has them."""
    once, twice = (rows_of(run,
        ads)[:: max(1, len(run.cases_of(ads, run.scores[0].scenario)) * 2 // 30)]
                   for ads in (first, second))  # fmt: skip
    names = [measure.quantity for measure in watched()]
    before, after = CaseTable.of(once), CaseTable.of(twice)
    floors = {
        name: floor_of(getattr(after, name) - getattr(before, name), SETTINGS.noise)
        for name in names
    }
    severity = severity_floor(Ends.of(before), Ends.of(after), SETTINGS.noise)
    return Repeats(len(once), 0, floors | {"severity": severity})


Rows = Mapping[tuple[str, tuple[float, ...]], CaseResult]


def by_point(run, ads):
    return {
        (case.scenario, tuple(case.values.values())): case for case in run.cases if case.ads == ads
    }


def ends(case):
    return Ends.of(CaseTable.of([case]))


def bad_drives(base, drives, limit):
    """How many drives ended in a way in which the base did not."""
    return sum(
        any(flags.any() for flags in worse_ends(ends(base), ends(one), limit).values())
        for one in drives
    )


def night_alarms(run, old, tonight, others):
    """What fails in a night of the same build.

    others: further drives, the first tells the floors, four are repeats.
    """
    known = repeats(run, tonight, others[0])
    limit = severity_limit(SETTINGS, known, (" m/s", " m/s"))
    base, again = by_point(run, old), [by_point(run, name) for name in others[1 : 1 + FURTHER]]
    bad = {
        case.case: bad_drives(base[point], [case, *(drive[point] for drive in again)], limit)
        for point, case in by_point(run, tonight).items()
    }
    comparison, after = beside(run, old, run, tonight)
    return [
        gate.quantity
        for gate in failed(judge(after, comparison, SETTINGS, Noise({tonight: known}, bad)))
    ]


def false_alarms(run, drives):
    """What failed in each night of a build that did not change.

    Each ordered pair of drives is a night.
    """
    return [
        night_alarms(run, old, tonight, [name for name in drives if name not in (old, tonight)])
        for old, tonight in permutations(drives, 2)
    ]


@pytest.mark.parametrize("cases", SIZES)
def test_planted_changes_are_found_and_silence_is_kept(cases, tmp_path):
    shutil.copy(Path(__file__).with_name("ladder_ads.py"), tmp_path)
    base = driven(tmp_path, "first", cases, [entry(BASE, {"work": WORK})])
    well = next(case for case in base.cases if case.status == "ok" and case.zone == "hazardous")
    at = well.values["ego_speed"]
    entries = [entry(name, options) for name, options in (PLANTED | DRIFT).items()]
    entries += [entry(name, {"special": name, "at": at}) for name in SPECIAL]
    nulls = ("same", "same again", "same once more", "last digits")
    entries += [
        entry(name, {"work": WORK, "digits": 1e-12 * (name == "last digits")}) for name in nulls
    ]
    planted = driven(tmp_path, "planted", cases, entries)
    print(f"\n{len(base.cases)} cases")
    rows = [told(base, planted, name) for name in (*PLANTED, *SPECIAL, *DRIFT)]
    print("\n".join(map(str, rows)))
    moved = [row for row in rows if row.moved]
    found = sum(row.found for row in rows)
    named = sum(row.named for row in rows)
    print(f"{len(rows)} planted, {len(moved)} moved a case, {found} found, {named} named")
    silent = [told(base, planted, name) for name in nulls]
    print(
        f"false alarms of builds that repeat: {sum(row.found for row in silent)} of {len(silent)}"
    )
    assert not any(row.found for row in silent)
    assert all(row.named for row in rows if row.found)
    missed = [row.build for row in moved if not row.found]
    print("missed:", ", ".join(missed) or "none")
    assert {row.build for row in rows if row.found} >= set(SPECIAL)


@pytest.mark.parametrize("cases", SIZES)
def test_noise_raises_one_alarm_in_fifty_nights_at_most(cases, tmp_path):
    shutil.copy(Path(__file__).with_name("ladder_ads.py"), tmp_path)
    entries = [
        entry(f"{noise} {k:02d}", {"noise": noise, "drive": k})
        for noise in NOISES
        for k in range(DRIVES)
    ]
    run = driven(tmp_path, "noisy", cases, entries)
    run = replace(run, cases=tuple(run.cases))  # read once: each night looks at them several times
    for noise in NOISES:
        nights = false_alarms(run, [f"{noise} {k:02d}" for k in range(DRIVES)])
        alarms = [night for night in nights if night]
        by = Counter(quantity for night in alarms for quantity in night)
        cases = len(run.cases) // len(entries)
        print(
            f"\n{cases} cases, noise {noise} m/s2: {len(alarms)} of {len(nights)} null nights "
            "failed",
            dict(by),
        )
        assert len(alarms) <= 0.02 * len(nights)
