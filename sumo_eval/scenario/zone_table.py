"""The zone rule of a scenario file, `[zone]`: which quantities decide whether a point is safe or
hazardous.

Users: `scenario/file_tables.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from sumo_eval.errors import InputError, check_known
from sumo_eval.frozen import frozen
from sumo_eval.scenario.expression import Definitions, Expression
from sumo_eval.scenario.formulas import Formula, Formulas, FormulaValue, Names
from sumo_eval.scenario.logical import Approach, Search, Values, ZoneCoordinates
from sumo_eval.scenario.vehicle_tables import Placement
from sumo_eval.settings.checked import Checked, PositiveOrNone, optional, setting


@frozen
class ZoneTable(Checked):
    """The zone rule: the approach to one vehicle under ideal braking (Eqs. 1-6), or a margin."""

    obstacle: str = setting("", "the vehicle that is in the way")
    margin: Formula | None = optional(
        "instead of an obstacle: distance to a known limit, hazardous at 0 and below", "m"
    )
    delay: Formula = setting(0.0, "before ideal braking begins", "s")
    gap: Formula | None = optional("bumper to bumper at the start; default: the obstacle's", "m")
    conflict_begin: Formula = setting(0.0, "time from which the obstacle is in the ego's path", "s")
    passing_length: PositiveOrNone = optional(
        "an ego further ahead than this when the conflict begins has passed", "m"
    )
    conflict: bool = setting(
        False,
        "criticality by the time until both paths collide, from any side; default: by the gap "
        "along the road",
    )
    coordinates: dict[str, Formula] | None = optional(
        "in words = expression: in which the criticality is smooth; default: the parameters"
    )

    def read(self, names: Names, placement: Placement, *, searched: bool) -> dict[str, Any]:
        """Keywords of the logical scenario: `margin`, `search` or `approach`, and
        `zone_coordinates`.

        searched: whether the zones need a search, because no closed form exists.
        """
        keywords: dict[str, Any] = {}
        definitions = names.definitions
        if self.coordinates:
            coordinates = (
                names.expression(formula, f"zone.coordinates `{name}`")
                for name, formula in self.coordinates.items()
            )
            keywords["zone_coordinates"] = ZoneCoordinates(
                tuple(self.coordinates), Formulas.of(definitions, *coordinates)
            )
        numbers = {
            key: names.expression(value, f"`zone.{key}`")
            for key in ("delay", "conflict_begin", "gap", "margin")
            if (value := getattr(self, key)) is not None
        }
        if self.margin is not None:
            self._refuse(
                " beside `margin`, which stands alone", names.where, "obstacle", "delay", "conflict"
            )
            return keywords | {"margin": FormulaValue(Formulas.of(definitions, numbers["margin"]))}
        if not self.obstacle:
            raise InputError(f"[zone] of {names.where} must have an `obstacle`, or a `margin`.")
        check_known(f"vehicle in `zone.obstacle` of {names.where}:", names.vehicles, self.obstacle)
        number = list(names.vehicles).index(self.obstacle)
        if searched:
            self._refuse(": the search takes the motion of both vehicles as it is", names.where)
            delay = FormulaValue(Formulas.of(definitions, numbers["delay"]))
            return keywords | {"search": Search(number, delay, self.conflict)}
        if self.gap is None and placement.vehicles[number].table.gap is None:
            raise InputError(
                f"[zone] of {names.where} must have a `gap`: vehicle `{self.obstacle}` starts at "
                "an x."
            )
        return keywords | {"approach": self._approach(definitions, placement, number, numbers)}

    def _approach(
        self,
        definitions: Definitions,
        placement: Placement,
        number: int,
        numbers: Mapping[str, Expression],
    ) -> ZoneRule:
        """The approach to an obstacle.

        number: of the obstacle among the vehicles.
        numbers: expressions of this table by key.
        """
        obstacle = placement.vehicles[number]
        brakes = [
            move.numbers["deceleration"] for move in obstacle.moves if move.table.do == "brake"
        ]
        # in the order of the fields of `Approach`: speeds of ego and obstacle, gap, delay, braking
        # of the obstacle, begin of the conflict
        approach = Formulas.of(
            definitions, placement.numbers["speed"], obstacle.numbers["speed"],
            numbers.get("gap") or obstacle.numbers["gap"], numbers["delay"],
            *(brakes[:1] or [Expression("0.0")]),
            numbers["conflict_begin"],
        )  # fmt: skip
        return ZoneRule(approach, self.passing_length or math.inf)

    def _refuse(self, why: str, where: str, *further: str) -> None:
        """Refuse `gap`, `conflict_begin`, `passing_length` and further keys: they would have no
        effect.

        why: ends the message.
        """
        defaults = {item.name: item.default for item in fields(self)}
        for key in (*further, "gap", "conflict_begin", "passing_length"):
            if getattr(self, key) != defaults[key]:
                raise InputError(f"[zone] of {where} has no `{key}`{why}.")


@frozen
class ZoneRule:
    """Function of values by name (arrays) that gives the `Approach`.

    formulas: of the first six fields of `Approach`, in order.
    """

    formulas: Formulas
    passing_length: float

    def __call__(self, values: Values) -> Approach:
        """The approach at every point."""
        return Approach(  # type: ignore[misc]
            *self.formulas(values),  # type: ignore[arg-type]
            passing_length=self.passing_length,
        )
