"""An ADS for many cases at once that is faulty at one point, where the ego starts at 20 m/s; `test_packs` drives it."""

import os
import time

import numpy as np

from sumo_eval import Command
from sumo_eval.cosim.packed_controller import PackedCommand

FAULTY_SPEED = 20.0


class Coasts:
    """Keeps its speed, alone and in packs."""

    def fault(self):
        """What happens at the faulty point, alone and in a pack."""

    def step(self, traci, ego, now):
        if traci.vehicle.getSpeed(ego) == FAULTY_SPEED:
            self.fault()
        return Command(0.0)

    def packed(self, briefing):
        return _Packed(self)


class _Packed:
    def __init__(self, ads):
        self.ads = ads

    def step(self, scene, now):
        if FAULTY_SPEED in scene.along:
            self.ads.fault()
        self.cases = len(scene.x)
        return PackedCommand(np.zeros(self.cases), np.zeros(self.cases))

    def settled(self):
        return np.zeros(self.cases, dtype=bool)

    def keep(self, rows):
        self.cases = len(rows)


class Exits(Coasts):
    def fault(self):
        print("last words before leaving", flush=True)
        os._exit(7)


class HangsInC(Coasts):
    def fault(self):
        sum(range(10**18))


class Hangs(Coasts):
    def fault(self):
        while True:
            time.sleep(0.01)


class Raises(Coasts):
    def fault(self):
        raise ValueError("no path found")


class Interrupts(Coasts):
    def fault(self):
        raise KeyboardInterrupt


class FillsMemory(Coasts):
    def fault(self):
        hoard = []
        while True:
            hoard.append(bytes(64 << 20))


class Chatters(Coasts):
    def fault(self):
        print("a word from the faulty point")


class RefusesPacks(Coasts):
    def packed(self, briefing):
        return None
