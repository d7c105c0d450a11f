"""Policies that are faulty at one point, where the ego starts at 20 m/s; `test_packs` drives
them."""

import os
import random
import time

FAULTY_SPEED = 20.0


class Coasts:
    """Keeps its speed."""

    def fault(self):
        """What happens at the faulty point."""

    def act(self, seen):
        if seen.ego.speed == FAULTY_SPEED:
            self.fault()
        return 0.0


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
        if not vars(self).setdefault("said", False):
            print("a word from the faulty point")
            self.said = True


class ImportsTraci(Coasts):
    def fault(self):
        import traci

        traci.vehicle.getSpeed("ego")


class Gambles(Coasts):
    def act(self, seen):
        return 0.01 * random.random()


class Steps(Coasts):
    """TraCI code, which needs the simulation to itself."""

    act = None

    def step(self, traci, ego, now):
        return None
