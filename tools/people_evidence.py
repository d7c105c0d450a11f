"""Compare recorded drivers with bad driving, in the drivers' own concrete scenarios: D, H and
plausibility.
Prints the AUCs of docs/trust.md.

    python tools/people_evidence.py ../shared/data/human [SEED]

A person: a car or van of DLR Highway Traffic v1.1.0 that comes up to a slower leader in the right
lane through a gap of 3.5 s (`range_crossing`, not suspect), recorded over at least 80 % of the
road. The concrete scenario is `front_vehicle_low_speed` at that person's own speed and leader's
speed; the drivers are the ten synthetic ones that an evaluation has by default. Lateral positions
are stretched from the recorded lanes' width to the scenario's.

Bad driving is made for each of these scenarios, and counts where it comes to be before the road
ends:

- brakes hard: with 8 m/s2 from 1 s on, to the leader's speed;
- crawls: with 3 m/s2 to 10 m/s, or to 60 % of the leader's speed;
- tailgates: keeps its lane, slows with 1 m/s2 and follows at 0.2, 0.3 or 0.5 s;
- swerves: keeps lane and speed until a TTC of 1.5 s (1 s), then changes lane within 2 s (1.6 s);
- drives through: keeps lane and speed, through its leader.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd

from sumo_eval.cosim.simulation import simulate_many
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.method.anthropomorphic import Pairing, indexes_by_group
from sumo_eval.method.measures import course_of
from sumo_eval.method.plausibility import MOTORWAY_PEOPLE, extremes_of, plausibility
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario, smooth_step
from sumo_eval.settings import AnthropomorphicSettings
from sumo_eval.trajectory import FloatArray, Trajectory

LANE_SPACING = {"DLRHT_NB": 3.79, "DLRHT_SB": 3.62}  # m, of the recorded lanes
COVERAGE = 0.8  # of the road that a recording must cover, as `drivers.coverage`
DRIVERS = 10
SLICES = 2.5  # m, within 0.02 of 0.5 m
# m/s2, m/s2, m/s, m/s2
HARD_BRAKING, CRAWL_BRAKING, CRAWL_SPEED, CLOSING_BRAKING = 8.0, 3.0, 10.0, 1.0
HEADWAYS = (0.2, 0.3, 0.5)  # s
SWERVES = ((1.5, 2.0), (1.0, 1.6))  # s: TTC at which it begins, duration
CALM = (10.0, 8.5)  # s, the recorded medians
SETTINGS = AnthropomorphicSettings(mode="gaussian")


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """One recorded approach: who, the concrete scenario that it was, the drive and the leader's."""

    name: str
    concrete: ConcreteScenario
    ego: Trajectory
    lead: Trajectory


def recorded_people(folder: Path) -> list[Person]:
    """Everybody who came up to a slower leader in the right lane and was recorded for long
    enough.
    """
    events = pd.read_csv(folder / "dlr_ht" / "approach_events.csv")
    kept = ~events["suspect"] & (events["lane0"] == 0) & (events["start_kind"] == "range_crossing")
    events = events[kept & events["ego_cls"].isin(["car", "van"])]
    series = duckdb.read_parquet(str(folder / "dlr_ht" / "approach_series.parquet")).df()
    drives = dict(list(series[series["t"] >= -1e-6].groupby("event_id")))
    shipped = catalogue.load("front_vehicle_low_speed")
    wide = tuple(replace(item, low=1.0, high=60.0) for item in shipped.parameters)
    # people's own speeds, also where they leave the space
    logical = replace(shipped, parameters=wide)
    people = []
    for _, event in events.iterrows():
        rows, spacing = drives[event["event_id"]], LANE_SPACING[str(event["recording"])]
        concrete = logical.concrete(
            ego_speed=float(event["v_ego0"]), lead_speed=float(event["v_lead0"])
        )
        ego, lead = (
            _moved(rows, name, concrete, spacing, float(event[f"{name}_L"]))
            for name in ("ego", "lead")
        )
        if ego.x[-1] - ego.x[0] >= COVERAGE * (concrete.road.length - ego.x[0]):
            people.append(Person(str(event["ego"]), concrete, ego, lead))
    return people


def _moved(
    rows: pd.DataFrame, name: str, concrete: ConcreteScenario, spacing: float, length: float
) -> Trajectory:
    """A recorded vehicle on the scenario's road, the ego's start at the scenario's."""
    there = rows[rows[f"{name}_x"].notna()]
    return Trajectory(
        np.round(there["t"].to_numpy(dtype=np.float64), 3),
        there[f"{name}_x"] - rows["ego_x"].iloc[0] + concrete.ego.x,
        there[f"{name}_y"] * concrete.road.lane_width / spacing,
        speed=there[f"{name}_v"],
        acceleration=there[f"{name}_a"],
        length=length,
    )


def made_drives(concrete: ConcreteScenario) -> tuple[Trajectory, dict[str, Trajectory]]:
    """The leader of a concrete scenario, and the drives that are made for it, those that come to be
    on its road.
    """
    v, w = concrete.values["ego_speed"], concrete.values["lead_speed"]
    gap, closing = 3.5 * v, v - w
    time = np.arange(0.0, 60.0, 0.1)
    lead = _drive(time, np.full(time.size, w), 0.0, concrete.ego.x + gap + 4.5)
    steady = np.full(time.size, v)

    def made(speed: FloatArray, y: FloatArray | float = 0.0) -> Trajectory:
        return _up_to(concrete.road.length, _drive(time, speed, y, concrete.ego.x))

    def changes(ttc: float, duration: float) -> Trajectory:
        begin = max((gap - ttc * closing) / closing, 0.5)
        return made(steady, concrete.road.lane_width * smooth_step((time - begin) / duration))

    drives = {
        "overtakes calmly": changes(*CALM),
        "brakes hard": made(np.maximum(v - HARD_BRAKING * np.maximum(time - 1.0, 0.0), w)),
        "crawls": made(np.maximum(v - CRAWL_BRAKING * time, min(CRAWL_SPEED, 0.6 * w))),
    }
    for headway in HEADWAYS:
        room = gap - headway * w
        braking = max(CLOSING_BRAKING, closing**2 / (2.0 * room))
        begin = (room - closing**2 / (2.0 * braking)) / closing
        drive = made(np.maximum(v - braking * np.maximum(time - begin, 0.0), w))
        if np.min(_gap(drive, lead) / drive.speed) < headway + 0.02:
            drives[f"tailgates at {headway:g} s"] = drive
    for ttc, duration in SWERVES:
        drive = changes(ttc, duration)
        if drive.y[-1] > 0.97 * concrete.road.lane_width:
            drives[f"swerves at a TTC of {ttc:g} s"] = drive
    through = made(steady)
    if _gap(through, lead).min() < 0.0:
        drives["drives through its leader"] = through
    return lead, drives


def _drive(time: FloatArray, speed: FloatArray, y: FloatArray | float, start: float) -> Trajectory:
    x = start + np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) * 0.05)))
    return Trajectory(time, x, np.broadcast_to(y, time.shape), speed=speed)


def _gap(drive: Trajectory, lead: Trajectory) -> FloatArray:
    gap: FloatArray = (
        np.interp(drive.time, lead.time, lead.x) - drive.x - (drive.length + lead.length) / 2.0
    )
    return gap


def _up_to(end: float, drive: Trajectory) -> Trajectory:
    last = int(np.argmax(drive.x >= end)) if drive.x[-1] >= end else len(drive) - 1
    kept = (
        getattr(drive, name)[: last + 1]
        for name in ("time", "x", "y", "heading", "speed", "acceleration")
    )
    return Trajectory(*kept)


def evidence(people: list[Person], seed: int) -> pd.DataFrame:
    """One row a drive: scenario, who, D in both modes, H, plausibility.

    `left out`: a driver against the other nine.
    """
    drivers = [
        human_controller(i, DRIVERS, seed, person.concrete)
        for person in people
        for i in range(DRIVERS)
    ]
    recorded = iter(
        list(simulate_many([person.concrete for person in people for _ in range(DRIVERS)], drivers))
    )
    rows: list[dict[str, object]] = []
    for number, person in enumerate(people):
        mates = [next(recorded) for _ in range(DRIVERS)]
        lead, made = made_drives(person.concrete)
        drives = [*(mate.ego for mate in mates), person.ego, *made.values()]
        everybody = tuple(range(DRIVERS))
        pairings = [
            *(
                Pairing(place, tuple(n for n in everybody if n != place), SLICES, True)
                for place in everybody
            ),
            *(Pairing(place, everybody, SLICES, True) for place in range(DRIVERS, len(drives))),
        ]
        leads = [*(mate.actors["lead"] for mate in mates), person.lead, *[lead] * len(made)]
        names = [*["left out"] * DRIVERS, "recorded person", *made]
        for name, drive, ahead, index in zip(
            names,
            drives,
            leads,
            indexes_by_group(drives, [pairings], person.concrete.road, SETTINGS)[0],
            strict=True,
        ):
            found = index.likeness
            assert found is not None
            plausible = plausibility(
                extremes_of(course_of(drive, {"lead": ahead}, None, person.concrete.road)),
                MOTORWAY_PEOPLE,
            )
            rows.append(
                {
                    "scenario": number,
                    "who": name,
                    "D": index.value,
                    "D mixture": index.length_factor
                    * index.operation_factor
                    * found.mixture_similarity,
                    "H": found.value * plausible,
                    "plausibility": plausible,
                }
            )
    return pd.DataFrame(rows)


def area_under_curve(people: FloatArray, others: FloatArray) -> float:
    """AUC: how often a person scores higher than one of the others, ties half."""
    difference = people[:, None] - others[None, :]
    return float(np.mean((difference > 0.0) + 0.5 * (difference == 0.0)))


def areas(table: pd.DataFrame, score: str) -> dict[str, float]:
    """AUC of the people against every other kind of drive."""
    people = table.loc[table["who"] == "recorded person", score].to_numpy()
    return {
        str(who): area_under_curve(people, rows[score].to_numpy())
        for who, rows in table.groupby("who", sort=False)
        if who != "recorded person"
    }


if __name__ == "__main__":
    found = evidence(
        recorded_people(Path(sys.argv[1])), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    )
    scores = ("D", "D mixture", "H", "plausibility")
    print(pd.DataFrame({score: areas(found, score) for score in scores}).round(3).to_string())
