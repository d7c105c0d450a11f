"""Evaluations made by hand, with a real facts file: what the report is tested on, without SUMO."""

import tomllib
from dataclasses import replace

import numpy as np
from evaluations import EMPTY, small
from scipy.integrate import cumulative_trapezoid

from sumo_eval.method.index_terms import IndexNote
from sumo_eval.record.cases import Case, Outcome
from sumo_eval.record.store import open_store
from sumo_eval.results import Evaluation, ZoneResult
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.score_notes import BeyondRange
from sumo_eval.scoring.quantities import combine
from sumo_eval.settings import MethodSettings, RunSettings
from sumo_eval.trajectory import Clip, Collision, Latency, Recording, Trajectory

CALM = "calm"
HOSTILE = '</script><img src=x onerror="alert(1)"> [red]"&\u2028'
LOW_SPEED, CUT_OUT = SCENARIOS = ("front_vehicle_low_speed", "front_vehicle_cut_out")
DRIVERS = 3
ERROR = "RuntimeError: </script><b>lost the lane</b>"


def drive(x, y, speed, seconds, *, offset=0.0, braking=0.0):
    """From (x, y), slowing down by `braking` m/s2 and moving `offset` m to the left; the end is off
    the 0.1 s grid."""
    time = np.append(np.arange(0.0, seconds, 0.1), seconds + 0.037)
    speeds = np.maximum(speed - braking * time, 0.0)
    along = x + cumulative_trapezoid(speeds, time, initial=0.0)
    return Trajectory(time, along, y + offset / (1.0 + np.exp(4.0 - time)), speed=speeds)


def evaluation(folder, partitions):
    """Two scenarios of three levels an axis, two ADSs.

    calm: 0.5 m to the left; hits in the hazardous zone only; one case crashed and has no recording.
    HOSTILE: hits in the safe zone of the cut-out, so it has no D there; one case of the other
        scenario has an error."""
    ads = {CALM: "idm", HOSTILE: "no_reaction"}
    plain = small(ads, SCENARIOS, DRIVERS, run=RunSettings())
    settings = replace(plain, name="made <by> hand")
    zones, scores, cases = [], [], []
    folder.mkdir(parents=True, exist_ok=True)
    with open_store(folder, create=True) as store:
        for name in SCENARIOS:
            logical = catalogue.load(name)
            points = sample(logical, levels=3)
            hazardous = partitions[name].exactly_hazardous(points.points)
            concretes = logical.concretes(points.points)
            places = [
                (number, concrete, "hazardous" if dangerous else "safe")
                for number, (concrete, dangerous) in enumerate(
                    zip(concretes, hazardous, strict=True)
                )
            ]
            for number, concrete, zone in places:
                if zone == "safe":
                    _record_drivers(store, number, concrete)
            for ads in (CALM, HOSTILE):
                rows = [_case(store, *place, ads) for place in places]
                cases += rows
                scores.append(_score(ads, name, rows))
            zones.append(
                ZoneResult(
                    scenario=name,
                    zones=partitions[name].zones,
                    hazardous_share=float(np.mean(hazardous)),
                    most_dangerous=partitions[name].most_dangerous,
                    boundary_error=0.0123 * (name == CUT_OUT),
                    boundary_error_box=0.0234 * (name == CUT_OUT),
                    sampled=len(points.points),
                    refused=len(points.refused),
                    notes=partitions[name].notes,
                )
            )
    manifest = tomllib.loads("""
format_version = 1
created = "2026-01-01T00:00:00+00:00"
source_folder = "/nowhere"
versions = { python = "3.11", sumo_eval = "0.0", libsumo = "1.28" }
machine = { system = "a machine" }
""")
    spaces = {name: catalogue.load(name) for name in SCENARIOS}
    parts = map(tuple, (zones, scores, cases))
    return Evaluation(settings.name, folder, settings, manifest, *parts, scenarios=spaces)


def _record_drivers(store, number, concrete):
    for index in range(DRIVERS):
        start = concrete.ego
        driven = drive(
            start.x, 0.1 * index, start.speed - 0.5 * index, 12.0, offset=3.5 if index else 0.0
        )
        case = Case(number, concrete, "human", f"driver_{index:02d}", "synthetic", index, DRIVERS)
        store.add(Outcome(case, "ok", Recording(driven, {}, None, "road_end")))


def _case(store, number, concrete, zone, ads):
    """Record a case and say what came of it."""
    cut_out, safe = concrete.scenario == CUT_OUT, zone == "safe"
    hits = ads == HOSTILE and cut_out and number % 5 == 0 if safe else number % 2 == 0
    status = "collision" if hits else "ok"
    if not cut_out and number == 1:
        status = "crashed" if ads == CALM else "ads_error"
    elif not cut_out and number == 2 and ads == HOSTILE:
        status = "off_road"
    case = Case(number, concrete, "ads", ads, "idm")
    row = replace(
        EMPTY, case=case.key, scenario=concrete.scenario, ads=ads, values=concrete.values,
        zone=zone,
        exposure=concrete.exposure, status=status, no_reaction_severity=0.0 if safe else 12.0,
        weight=0.25 + 0.01 * number, task_share=float(status == "ok") if safe else None,
    )  # fmt: skip
    if status == "crashed":
        error = "The process that ran the case died with exit code -11."
        store.add(Outcome(case, status, None, error))
        return replace(row, error=error)
    start, other = concrete.ego, concrete.actors[-1]
    ego = drive(start.x, 0.0, start.speed, 3.0 if hits else 12.0, offset=0.5, braking=0.2)
    collision = None
    if hits:
        pose = (float(ego.x[-1]), float(ego.y[-1]), 0.0)
        collision = Collision(3.037, other.name, (12.5, 0.0), (5.0, 0.0), 0.75, "front", pose, pose)
    ends = {"ok": "road_end", "collision": "contact"}
    recording = Recording(
        ego,
        {
            actor.name: drive(actor.start.x, actor.start.y, actor.start.speed, float(ego.time[-1]))
            for actor in concrete.actors
        },
        collision,
        ends.get(status, status),
        (Clip("acceleration_rate", 3, 0.5, -12.0, -9.0),),
        wall_time=0.01,
        controller_latency=Latency(1e-5, 4e-4, 9e-6, 3e-4, 1e-5),
    )
    error = ERROR if status == "ads_error" else None
    store.add(Outcome(case, status, recording, error))
    row = replace(
        row, error=error, end_reason=recording.end_reason, wall_time=0.01,
        simulated_time=recording.simulated_time,
        latency_mean=1e-5, latency_max=4e-4, clips="acceleration_rate x3", max_deceleration=0.2,
        max_jerk=1.5,
        plausibility=0.8 if number % 3 else 1.0,
    )  # fmt: skip
    if status in ("ok", "collision"):
        near = (0.0, 0.0, None) if hits else (2.25, 11.5, 0.444)
        row = replace(row, **dict(zip(("min_ttc", "min_gap", "max_ittc"), near, strict=True)))
    if collision is not None:
        return replace(
            row, collided=True, impact_speed=7.5, overlap=0.75, side="front", severity=10.0,
            loss=0.7,
            ideal_severity=0.0 if number % 4 else 4.0, ideal_collided=number % 4 == 0,
            delta_v=-3.75,
            human_likeness=0.0 if safe and number % 4 else None,
        )  # fmt: skip
    if safe and row.evaluated and not (ads == HOSTILE and cut_out):
        similarity = 0.05 * (number % 10) + 0.5
        mixture = 0.5 + 0.5 * similarity
        return replace(
            row, index=0.5 * similarity, length_factor=1.0, operation_factor=0.5,
            similarity=similarity, operation_tolerance=0.75,
            likeness_length_factor=1.0, mixture_similarity=mixture,
            human_likeness=0.75 * mixture * row.plausibility,
            index_note=(IndexNote("two_groups", number + 3, 1101),),
        )  # fmt: skip
    return row


def _score(ads, scenario, rows):
    score = combine(ads, scenario, rows, MethodSettings(), task_reference="attentive")
    return replace(score, notes=(BeyondRange("<this> score", (("reason", 1),)),))
