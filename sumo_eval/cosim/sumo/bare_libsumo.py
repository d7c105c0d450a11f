"""The yardstick of `extras/bench`: libsumo alone, as the plainest script drives it.

Users: `extras/bench/costs.py`.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from sumo_eval.cosim.sumo.insides import libsumo


def bare_seconds(
    command_lines: Sequence[list[str]],
    steps: Sequence[int],
    hook: Callable[[Any, str, float], None] = lambda *_: None,
) -> float:
    """Processor time of whole simulations, s, from start to close.

    command_lines: of SUMO, one for each simulation.
    steps: number of steps in each simulation.
    hook: called before each step with libsumo, the ego's name and the time 0.
    """
    began = time.process_time()
    for command_line, count in zip(command_lines, steps, strict=True):
        libsumo.start(command_line)
        libsumo.simulationStep()  # inserts the vehicles
        for _ in range(count):
            with suppress(libsumo.TraCIException):  # the ego may have left
                hook(libsumo, "ego", 0.0)
            libsumo.simulationStep()
        libsumo.close()
    return time.process_time() - began
