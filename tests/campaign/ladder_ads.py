"""An adaptive cruise control with one thing planted in it: the builds of the ladder of
test_nights.py.

Each build is an entry of an evaluation with other options. The seed of its noise is the case and
`drive`: two drives of a case differ, but a test always sees the same ones.
"""

import math
import random
from collections import deque

from sumo_eval import Command


class Build:
    """An IDM behind the nearest vehicle ahead.

    special: `collides`, `raises` or `leaves` where the ego begins at `at`.

    brakes m/s2, delay s, seen m (how far it sees), headway s, speed: share of the first speed,
    shake m/s2 (amplitude of a swinging command), noise m/s2, digits: share by which each command is
    off.

    work: rounds of a loop in each step.
    """

    def __init__(
        self, *, brakes = 8.0, delay = 0.1, seen = 120.0,
        headway = 1.4, speed = 1.0,
        shake = 0.0, noise = 0.0, digits = 0.0, special = "",
        at = 0.0,
        work = 0.0,
        drive = 0,
    ):  # fmt: skip
        self.brakes, self.delay, self.seen, self.headway, self.speed = (
            brakes,
            delay,
            seen,
            headway,
            speed,
        )
        self.shake, self.noise, self.digits, self.special, self.at = (
            shake,
            noise,
            digits,
            special,
            at,
        )
        self.first = None
        self.waiting = deque()
        self.drive, self.work = drive, int(work)

    def act(self, seen):
        """The command of a step."""
        for _ in range(self.work):
            pass
        if self.first is None:
            self.first = seen.ego.speed
            self.chance = random.Random(f"{self.drive} {seen.ego} {seen.vehicles}")
        struck = bool(self.special) and abs(self.first - self.at) < 1e-9
        if struck and self.special == "raises" and seen.time > 1.0:
            raise RuntimeError("planted")
        if struck and self.special == "leaves" and seen.time > 1.0:
            return Command(0.0, 1.5)
        wanted = 0.0 if struck and self.special == "collides" else self.wanted(seen)
        wanted += self.shake * math.sin(2.0 * math.pi * seen.time)
        wanted += self.chance.gauss(0.0, self.noise) if self.noise else 0.0
        self.waiting.append((seen.time, wanted * (1.0 + self.digits)))
        while len(self.waiting) > 1 and self.waiting[1][0] <= seen.time - self.delay + 1e-9:
            self.waiting.popleft()
        return self.waiting[0][1] if self.waiting[0][0] <= seen.time - self.delay + 1e-9 else 0.0

    def wanted(self, seen):
        """IDM, within the brakes."""
        v, desired = seen.ego.speed, max(self.speed * (self.first or 1.0), 0.1)
        free = 1.0 - (v / desired) ** 4
        lead = seen.lead
        if lead is None or lead.gap > self.seen:
            return max(1.5 * free, -2.0)
        gap = 2.0 + max(
            0.0, self.headway * v - v * lead.relative_speed / (2.0 * math.sqrt(1.5 * 2.0))
        )
        return max(1.5 * (free - (gap / max(lead.gap, 0.1)) ** 2), -self.brakes)
