"""Streams of traffic, `[[stream]]` of a scenario file: where their vehicles start and how fast they
want to drive, drawn once from a declared seed.

Users: `scenario/file_tables.py`, `scenario/vehicle_tables.py`.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np

from sumo_eval.errors import check_vehicle_name, must_be
from sumo_eval.frozen import frozen
from sumo_eval.scenario.bodies import BODIES
from sumo_eval.scenario.concrete import Actor, Model, Numbers, Road, Start
from sumo_eval.scenario.formulas import Formula, LimitedFormulas, Names, PositiveFormula
from sumo_eval.settings.checked import (
    About,
    Checked,
    FilledText,
    Natural,
    NotNegativeFloat,
    setting,
)

MOST = 200  # vehicles of one stream


@frozen
class StreamTable(Checked):
    """Traffic of a given density: a lane of vehicles, each driven by a SUMO model."""

    name: Annotated[
        FilledText, About("name; its vehicles are name_1, name_2, ... from the foremost back")
    ]
    lane: Annotated[Natural, About("lane; 0 is the right-hand one")]
    begin: Annotated[
        Formula, About("where its rear is, from the ego's centre; negative: behind the ego", "m")
    ]
    end: Annotated[Formula, About("where its front is, from the ego's centre", "m")]
    density: Annotated[PositiveFormula, About("vehicles on a kilometre of the lane", "1/km")]
    speed: Annotated[
        PositiveFormula, About("mean speed, which each keeps while its lane is free", "m/s")
    ]
    speed_spread: NotNegativeFloat = setting(
        0.0, "speeds are spread evenly, up to this far from the mean", "m/s"
    )
    spacing_spread: NotNegativeFloat = setting(
        0.3, "distances are spread evenly around their mean, by up to this share of it"
    )
    seed: Natural = setting(0, "what speeds and distances are drawn from")
    model: Literal["Krauss", "IDM", "EIDM"] = setting(
        "IDM", "SUMO's car-following model, without noise"
    )
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

        numbers: of the table, by key.

        The draws depend on the seed and on the vehicle's number alone, so that a point of the space
        changes nothing but what its parameters say.

        Raises InputError for a stream that is denser than its lane holds, or too long.
        """
        owner = f"stream `{self.name}`"
        body = BODIES[self.body]
        mean_speed = numbers["speed"]
        # spacing: mean distance, front to front, m
        begin = numbers["begin"]
        end = numbers["end"]
        spacing = 1000.0 / numbers["density"]
        if not begin < end:
            raise must_be("`begin`", owner, f"below `end` ({end:g} m)", begin)
        # least distance between two vehicles, front to front, m, and the distance that one needs
        least, room = spacing * (1.0 - self.spacing_spread), body.length + numbers["min_gap"]
        if least < room:
            most = 1000.0 * (1.0 - self.spacing_spread) / room
            raise must_be(
                "`density`",
                owner,
                f"at most {most:g} a km, which the lane holds",
                numbers["density"],
            )
        vehicles = int((end - begin) / least) + 1
        if vehicles > MOST:
            raise must_be("The vehicles", owner, f"at most {MOST}", f"up to {vehicles}")
        if self.speed_spread >= mean_speed:
            raise must_be(
                "`speed_spread`", owner, f"below `speed` ({mean_speed:g} m/s)", self.speed_spread
            )
        # two rows of a fixed length: another one would change the draws of the second row
        draws = np.random.Generator(np.random.PCG64(self.seed)).uniform(-1.0, 1.0, (2, MOST + 1))
        x = end
        # faster, further: each vehicle's speed and distance within their spreads, -1..1
        for count, (faster, further) in enumerate(draws.T.tolist(), 1):
            if x < begin:
                break
            speed = mean_speed + self.speed_spread * faster
            start = Start(ego.x + x, road.lane_width * self.lane, speed)
            model = sumo_model(self.model, speed, numbers)
            yield Actor(
                f"{self.name}_{count}",
                start,
                (),
                body.length,
                body.width,
                body=self.body,
                model=model,
            )
            x -= spacing * (1.0 + self.spacing_spread * further)


def sumo_model(name: str, desired: float, numbers: Numbers) -> Model:
    """A car-following model of SUMO.

    numbers: of a table, by its keys; what the model does not know is left out.
    """
    keys = {"headway": "tau", "min_gap": "minGap", "acceleration": "accel", "deceleration": "decel"}
    return Model(name, desired, tuple((keys[key], numbers[key]) for key in keys if key in numbers))
