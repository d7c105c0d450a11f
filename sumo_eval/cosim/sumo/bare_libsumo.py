"""The yardstick of the benchmark: libsumo alone, as the plainest script drives it."""

from __future__ import annotations

import time
from collections.abc import Sequence

from sumo_eval.cosim.sumo.insides import libsumo


def bare_seconds(command_lines: Sequence[list[str]], steps: Sequence[int]) -> float:
    """Processor time of one simulation after the other, s: start, as many steps as given, close."""
    began = time.process_time()
    for command_line, count in zip(command_lines, steps, strict=True):
        libsumo.start(command_line)
        libsumo.simulationStep()  # inserts the vehicles
        for _ in range(count):
            libsumo.simulationStep()
        libsumo.close()
    return time.process_time() - began
