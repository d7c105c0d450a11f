"""Base of baselines and synthetic drivers, whose rule is a kernel that the loop of all rows calls.

An object of such a class holds what was given to it and nothing of a case: its memory of a case
stands in arrays that the loop keeps, a row each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from sumo_eval.cosim.records import MOVER, Layout, Records, fields, flags
from sumo_eval.cosim.step_rules import first_of
from sumo_eval.errors import ControllerError, must_be
from sumo_eval.kernels import kernel
from sumo_eval.kernels import rows as compiled_rows


def each_row(rule: Callable[..., None]) -> Callable[..., None]:
    """Loop of a rule: calls it for every live row.

    rule: kernel of the ego, the `MOVER` records of the actors, the row's own record, one of each
        actor, room for where those are foreseen, and the two `SCENARIO` records.
    """

    @compiled_rows
    def loop(
        egos: Records, seen: Records, own: Records, known: Records, later: Records,
        scenario: Records, time: float,
    ) -> None:  # fmt: skip
        for i in range(len(egos)):
            if egos[i].live:
                at = first_of(scenario, i)
                its = scenario[at : at + 2]
                rule(egos[i], seen[i], own[i], known[i], later[i], its)

    return loop


@kernel
def decides(own: Any, scenario: Any) -> bool:
    """Whether a cycle, the step of the last scenario, begins now. Call once a step.

    own: holds `steps` so far.
    """
    own.steps += 1
    return bool((own.steps - 1) % round(scenario[-1].step / scenario[0].step) == 0)


def _numbers(thing: Any, layout: Layout) -> tuple[Any, ...]:
    """Attributes of an object as a record."""
    values = ((getattr(thing, name), kind) for name, kind in layout)
    return tuple(
        _numbers(value, kind) if isinstance(kind, list) else value for value, kind in values
    )


def unknown(count: int, others: int, layout: Layout) -> Records:
    """Memories of vehicles that no rule has seen yet, (count, others): nan in every field that is a
    number.
    """

    def row(layout: Layout) -> tuple[Any, ...]:
        return tuple(
            row(kind) if isinstance(kind, list) else math.nan if kind == "f8" else 0
            for _, kind in layout
        )

    return np.full((count, others), np.array(row(layout), layout))


def check_numbers(ads: str, numbers: Mapping[str, float]) -> None:
    """Raises InputError for a number of an ADS that is not finite or negative."""
    for name, value in numbers.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise must_be(f"`{name}`", f"ADS `{ads}`", "a finite number, at least 0", value)


class Compiled:
    """Base of baselines and synthetic drivers.

    loop: the rows of its rule, called with the egos, what is seen of the actors, the arrays, the
        scenario and the time; writes the egos' commands, and whether they have settled.
    memory, known: layouts of what the rule remembers of a case, 0 at first, and of each actor, nan
        at first.
    numbers: layout of `p` in the memory, which holds the attributes of the object.
    """

    loop: ClassVar[Callable[..., None]]
    memory: ClassVar[Layout] = flags("steps")
    known: ClassVar[Layout] = fields("last_speed")
    numbers: ClassVar[Layout] = fields()

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Arrays for the loop between what is seen and the scenario, a row for each object.

        scenario: the `SCENARIO` records.
        others: number of actors.
        """
        known = unknown(len(together), others, cls.known)
        return cls.own_records(together), known, np.zeros(known.shape, MOVER)

    @classmethod
    def own_records(cls, together: Sequence[Any]) -> Records:
        """Memory and parameters of each object, (n,)."""
        own = np.zeros(
            len(together), [*cls.memory, ("p", cls.numbers)] if cls.numbers else cls.memory
        )
        if cls.numbers:
            own["p"] = np.array([_numbers(each, cls.numbers) for each in together], cls.numbers)
        return own

    @classmethod
    def rides(cls, target: Any) -> bool:
        """Whether an object is driven by its loop: a subclass with a `step` or a `reset` of its own
        is not.
        """
        own = type(target)
        return (
            isinstance(target, Compiled) and own.step is Compiled.step and not hasattr(own, "reset")
        )

    def step(self, traci: Any, ego: str, time: float) -> Any:
        """Refuse to be asked: a rule is called by its loop alone."""
        raise ControllerError(
            f"The baseline `{type(self).__name__}` must drive by its own loop; a class that "
            "decides otherwise needs a `step` of its own"
        )
