"""Streams of traffic, `[[stream]]` of a scenario file: where their vehicles start and how fast they
want to drive, drawn from a seed that the file declares.

The order and number of the draws are fixed: another order would change recorded scenarios.

Users: `scenario/file_tables.py`, `scenario/vehicle_tables.py`.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from annotated_types import Lt

from sumo_eval.errors import check_vehicle_name, must_be
from sumo_eval.frozen import frozen, required
from sumo_eval.scenario.bodies import BODIES
from sumo_eval.scenario.concrete import Actor, Model, Numbers, Road, Start
from sumo_eval.scenario.formulas import Formula, LimitedFormulas, Names, PositiveFormula
from sumo_eval.settings.checked import (
    Checked,
    FilledText,
    Natural,
    NotNegativeFloat,
    setting,
)

MOST = 200  # vehicles of one stream
FollowModel = Literal["Krauss", "IDM", "EIDM"]
"""Name of a car-following model of SUMO."""


@frozen
class StreamTable(Checked):
    """Traffic of a given density: vehicles in a lane, each driven by a SUMO model."""

    name: FilledText = required("name; its vehicles are name_1, name_2, ... from the foremost back")
    lane: Natural = required("lane; 0 is the right-hand one")
    begin: Formula = required(
        "from the ego's centre to its last vehicle's, at least; negative: behind the ego", "m"
    )
    end: Formula = required("from the ego's centre to its first vehicle's", "m")
    density: PositiveFormula = required("vehicles on a kilometre of the lane", "1/km")
    speed: PositiveFormula = required("mean speed, which each keeps while its lane is free", "m/s")
    speed_spread: NotNegativeFloat = setting(
        0.0, "speeds are spread evenly, up to this far from the mean", "m/s"
    )
    spacing_spread: Annotated[NotNegativeFloat, Lt(1.0)] = setting(
        0.3, "distances are spread evenly around their mean, by up to this share of it"
    )
    seed: Natural = setting(0, "what speeds and distances are drawn from")
    model: FollowModel = setting("IDM", "SUMO's car-following model, without noise")
    headway: PositiveFormula = setting(1.0, "time headway that each keeps", "s")
    min_gap: PositiveFormula = setting(2.5, "gap to a standing vehicle", "m")
    acceleration: PositiveFormula = setting(2.6, "largest acceleration", "m/s2")
    deceleration: PositiveFormula = setting(4.5, "comfortable deceleration", "m/s2")
    body: Literal["car", "van", "truck", "motorcycle"] = setting("car", "what they are")

    def read(self, names: Names, road: Road) -> LimitedFormulas:
        """The formulas of its numbers.

        Raises InputError for a bad name, or a lane that the road does not have.
        """
        what = f"stream `{self.name}`"
        check_vehicle_name(f"a stream of {names.where}", self.name)
        if self.lane >= road.lanes:
            raise must_be("`lane`", f"{what} of {names.where}", f"below {road.lanes}", self.lane)
        return names.quantities(self, what)

    def actors(self, ego: Start, road: Road, numbers: Numbers) -> Iterator[Actor]:
        """Its vehicles from the foremost back.

        numbers: values of the table's formulas at a point, by key.

        The draws depend only on the seed and on the number of the vehicle: the points of a space
        differ in nothing but their parameters.

        Raises InputError for numbers that `_check` refuses.
        """
        self._check(numbers)
        body = BODIES[self.body]
        spacing = 1000.0 / numbers["density"]  # mean distance, front to front, m
        # two rows of a fixed length: with another length the second row would have other draws
        draws = np.random.Generator(np.random.PCG64(self.seed)).uniform(-1.0, 1.0, (2, MOST + 1))
        x = numbers["end"]  # of the vehicle's centre, from the ego's, m
        # shares of the spreads, -1..1: of the vehicle's speed, of the distance to the next one
        for count, (faster, further) in enumerate(draws.T.tolist(), 1):
            if x < numbers["begin"]:
                break
            speed = numbers["speed"] + self.speed_spread * faster
            yield Actor(
                f"{self.name}_{count}",
                Start(ego.x + x, road.lane_width * self.lane, speed),
                (),
                body.length,
                body.width,
                body=self.body,
                model=sumo_model(self.model, speed, numbers),
            )
            x -= spacing * (1.0 + self.spacing_spread * further)

    def _check(self, numbers: Numbers) -> None:
        """Refuse a stream that is denser than its lane holds, too long, or possibly standing."""
        owner = f"stream `{self.name}`"
        begin, end, speed = numbers["begin"], numbers["end"], numbers["speed"]
        if not begin < end:
            raise must_be("`begin`", owner, f"below `end` ({end:g} m)", begin)
        # m, front to front: the least distance of two vehicles, and the distance that one needs
        least = 1000.0 / numbers["density"] * (1.0 - self.spacing_spread)
        needed = BODIES[self.body].length + numbers["min_gap"]
        if least < needed:
            most = 1000.0 * (1.0 - self.spacing_spread) / needed
            wanted = f"at most {most:g} a km, which the lane holds"
            raise must_be("`density`", owner, wanted, numbers["density"])
        vehicles = int((end - begin) / least) + 1
        if vehicles > MOST:
            raise must_be("The vehicles", owner, f"at most {MOST}", f"up to {vehicles}")
        if self.speed_spread >= speed:
            wanted = f"below `speed` ({speed:g} m/s)"
            raise must_be("`speed_spread`", owner, wanted, self.speed_spread)


def sumo_model(name: str, desired: float, numbers: Numbers) -> Model:
    """A car-following model of SUMO.

    name: SUMO's name of the model. desired: speed, m/s.
    numbers: of a table, by its keys; only those that are parameters of a model are used.
    """
    # key of a table -> SUMO's name
    keys = {"headway": "tau", "min_gap": "minGap", "acceleration": "accel", "deceleration": "decel"}
    return Model(name, desired, tuple((keys[key], numbers[key]) for key in keys if key in numbers))
