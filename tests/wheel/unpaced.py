"""A window that keeps no clock: each step of its drives waits for an answer to its own state."""

import time
from unittest.mock import patch

from sumo_eval.extras.wheel.seat import Seat
from sumo_eval.extras.wheel.window import Window


class UnpacedSeat(Seat):
    def _wait_until_due(self):
        desk = self._desk
        while not desk.end_reason:
            if desk.on_hold or desk.was_held or time.perf_counter() < desk.due:
                self._stay_on_hold()
            elif desk.newest.seen >= self._tick:
                break
            time.sleep(0.0005)  # an answer must not wait long for the next look
        return 0.0


class UnpacedWindow(Window):
    async def drive(self, *given):
        with patch("sumo_eval.extras.wheel.window.Seat", UnpacedSeat):
            return await super().drive(*given)
