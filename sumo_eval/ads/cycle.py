"""The clock of a driver whose rule jumps: it decides once a cycle, as a control unit does.

A rule that lets go as soon as its threshold is not exceeded exceeds it again at once: the finer the step, the more
often, and in continuous time without end. One that takes whoever has come into the path for its lead does so at a look.
So what such a driver does depends on when it looks. It looks once a cycle, and the step of the simulation may be any
part of that.
"""

from __future__ import annotations

import numpy as np

from sumo_eval.cosim.records import Records

CYCLE = 0.05
"""s from one decision to the next, or a step where that is longer."""


def cycles_of(scenario: Records, count: int) -> Records:
    """The scenario's record with a cycle as its step, `count` times."""
    step = float(scenario["step"][0])
    cycles = np.repeat(scenario, count)
    cycles["step"] = max(round(CYCLE / step), 1) * step
    return cycles
