"""Known answers of regulations: UN R157, UN R79 and (EU) 2022/1426.

Users: `extras/studies/qualification/table.py`.
"""

from pathlib import Path

from sumo_eval.ads.eu_2022_1426 import SEATED, STANDING
from sumo_eval.extras.studies.qualification.drives import LENGTH, Rows, drive, least_gap
from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start, catalogue, constant_lateral
from sumo_eval.scenario.file import scenario_from
from sumo_eval.settings import SimulationSettings, VehicleSettings

EU_ROAD = Road("eu_2022_1426_2x3.5m", 2000.0, 2, 3.5, 200.0)
R157 = SimulationSettings(
    time_limit=35.0, vehicle=VehicleSettings(length=4.3, width=1.9), record_interval=0.1
)
"""For the rows of UN R157."""


CONSENSUS = (
    (
        "cut_in", "cut-in {} to {} km/h, {} m/s, {} m",
        {"ego_speed": 3.6, "cut_in_speed": 3.6, "lateral_speed": 1.0, "gap": 1.0},
        ((40, 10, 1.2, 18, 26), (60, 30, 1.2, 18, 26), (100, 70, 1.6, 18, 22))
    ),
    (
        "r157_cut_out", "cut-out {} km/h, {} m/s, {} m",
        {"ego_speed": 3.6, "lateral_speed": 1.0, "obstacle_gap": 1.0},
        ((70, 1.0, 5, 20), (90, 1.5, 20, 30), (130, 1.5, 50, 75))
    ),
    (
        "front_vehicle_braking", "lead brakes {} km/h, {} s, {} g",
        {"ego_speed": 3.6, "headway": 1.0, "lead_deceleration": 1.0 / 9.81},  # in g
        ((30, 1, 0.9, 0.4), (60, 1, 0.9, 0.5), (120, 1, 0.8, 0.6))
    )
)  # fmt: skip
"""Checks of UN R157. Of each of three scenarios:

- the name of the shipped scenario,
- the pattern of a check's name,
- parameter -> divisor that makes SI units of a row's value, as 3.6 of km/h,
- rows: values of all parameters except the last, then a value of the last with contact and a
  neighbouring value without.
"""
DISTANCES = (130, 100, 42.7), (130, 80, 59.9), (120, 100, 35.1), (100, 80, 29.6)
"""Rows of UN R79: speed of the vehicle behind and of the ego, km/h; distance S, m."""
TABLE = (
    (SEATED, (0.48, 0.71, 0.94, 1.18, 1.41, 1.64)),
    (STANDING, (0.74, 1.32, 1.90, 2.47, 3.05, 3.63)),
)
"""Rows of (EU) 2022/1426: brakes that it assumes of an ADS with seated or with standing passengers;
TTC, s, above which a cut-in must be avoided, at closing speeds of 10, 20 .. 60 km/h.
"""


def _outcome(name: str, values: dict[str, float]) -> str:
    """Outcome of `careful_driver` at a point of a shipped scenario: `avoided` or `contact`."""
    recording = drive(catalogue.load(name).concrete(**values), "careful_driver", R157)
    return "avoided" if recording.collision is None else "contact"


def consensus() -> Rows:
    """Rows on both sides of the limit at which the careful driver just avoids a collision.

    Independent readings of the regulation's text agree in them.
    """
    for scenario, name, parameters, rows in CONSENSUS:
        for *fixed, contact, avoided in rows:
            for value, expected in ((contact, "contact"), (avoided, "avoided")):
                point = (*fixed, value)
                values = {
                    key: number / divisor
                    for (key, divisor), number in zip(parameters.items(), point, strict=True)
                }
                source = "independent readings of Annex 3 agree"
                yield name.format(*point), _outcome, (scenario, values), expected, source


def _margin(ego: float, faster: float) -> float:
    """S, m, by the shipped scenario, whose margin is gap - S.

    ego: its speed, m/s.
    faster: speed of the vehicle behind less that of the ego, m/s.
    """
    logical = catalogue.load("lane_change_rear")
    assert logical.margin is not None
    return 100.0 - float(logical.margin(logical.columns([(ego, faster, 100.0)]))[0])


def _rest(ego: float, faster: float, gap: float) -> float:
    """Time gap, s, that is left of `gap` m when the vehicle behind has braked to the ego's speed,
    with 3 m/s2 from 0.4 s on.

    ego, faster: as in `_margin`.
    """
    # `accelerate` to a lower speed brakes; its acceleration is a magnitude
    brakes = {"do": "accelerate", "when": "time >= 0", "begin": 0.4, "speed": ego,
        "acceleration": 3.0}  # fmt: skip
    content = {
        "name": "un_r79", "zone": "none", "ego": {"speed": ego, "x": 150.0},
        "end": {"x": 600.0, "time": 8.0},
        "parameter": [{"name": "gap", "unit": "m", "low": 10.0, "high": 90.0, "step": 10.0}],
        "vehicle": [{"name": "rear", "speed": ego + faster, "gap_behind": "gap",
            "manoeuvre": [brakes]}]
    }  # fmt: skip
    recording = drive(scenario_from(content, "un_r79", Path()).concrete(gap=gap), "no_reaction")
    return float(recording.ego.x[-1] - recording.actors["rear"].x[-1] - LENGTH) / ego


def un_r79() -> Rows:
    """S of the regulation, and the time gap of 1 s that a vehicle behind keeps at a gap of S."""
    for number, (rear, own, distance) in enumerate(DISTANCES):
        ego, faster = own / 3.6, (rear - own) / 3.6
        yield (
            f"S, {rear} behind {own} km/h", _margin,
            (ego, faster), distance, "dv 0.4 s + dv^2 / (2 * 3 m/s2) + v * 1 s", 0.06, "m"
        )  # fmt: skip
        if number < 2:  # two drives through SUMO are enough
            s = faster * 0.4 + faster * faster / 6.0 + ego
            yield (
                f"left of S, {rear} behind {own} km/h", _rest,
                (ego, faster, s), 1.0, "1 s is left of a gap of S", 1e-6, "s"
            )  # fmt: skip


def _cut_in(closing: float, ttc: float) -> ConcreteScenario:
    """A cut-in at 1 m/s lateral speed, with this TTC once the body is 0.30 m over the line.

    closing: speed of the ego less that of the other vehicle, m/s.
    ttc: s.

    The other vehicle moves 1.75 m (half a lane) - 0.90 m (half a body) + 0.30 m = 1.15 m until
    then, which takes 1.15 s.
    """
    speed = 60.0 / 3.6 + 10.0  # of the ego, m/s: the other drives 10 m/s or faster
    start = Start(100.0 + LENGTH + closing * (ttc + 1.15), 3.5, speed - closing)
    other = Actor("other", start, (constant_lateral(0.0, 1.0, -3.5),), slides=True)
    return ConcreteScenario(
        "eu_2022_1426", {"closing": closing}, 1.0, EU_ROAD, Start(100.0, 0.0, speed), (other,)
    )


def eu_2022_1426() -> Rows:
    """Cut-ins 0.05 s above each TTC of the table: the vehicle that the regulation demands avoids
    them, and its braking leaves a known gap.
    """
    source = "Annex III: avoided, 0.1 m + a tau^2 / 24 left"
    for brakes, values in TABLE:
        # What is left: 0.1 m that the rule keeps, and a tau^2 / 24. The rule counts the build-up of
        # the braking a over tau as a delay of tau / 2, which needs that much more road.
        margin = 0.1 + brakes.braking * brakes.build_up**2 / 24.0
        model = brakes.ads.removeprefix("eu_2022_")
        for kph, ttc in zip(range(10, 70, 10), values, strict=True):
            name = f"{model} {kph} km/h, TTC {ttc:.2f} + 0.05 s"
            arguments = _cut_in(kph / 3.6, ttc + 0.05), brakes.ads
            yield name, least_gap, arguments, margin, source, 0.01, "m"
