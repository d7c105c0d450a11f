"""The point of no return of a contact: the last step from which full braking still avoids it.

The ADS is not asked again. Its recorded commands, or where SUMO or a plant moved it, are replayed
up to a step, then the ego brakes as strongly as it can, with the wheel straight. Steering away is
not considered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sumo_eval.cosim.loop import Replay
from sumo_eval.cosim.simulation import simulate_together
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import ConditionSettings, SimulationSettings
from sumo_eval.trajectory import (
    NEVER,
    NO_RETURN,
    UNKNOWN,
    Alone,
    Clip,
    Collision,
    FloatArray,
    Recording,
)

BRAKES = 0.5  # m/s2, commanded deceleration from which an ADS is said to brake
_LATE = 64  # steps before a contact among which most points of no return lie
_SAME = 1e-6  # s and m/s, contacts that differ by less are one


def with_no_return(
    recordings: Sequence[Recording | Alone],
    cases: Sequence[ConcreteScenario],
    settings: SimulationSettings,
) -> list[Recording | Alone]:
    """The recordings, those with a contact with the clip `NO_RETURN`."""
    marked = list(recordings)
    hits = [
        (place, found, found.collision)
        for place, found in enumerate(recordings)
        if isinstance(found, Recording) and found.collision is not None
    ]
    search = _Search(
        [cases[place] for place, _, _ in hits], [found for _, found, _ in hits], settings
    )
    for (place, found, hit), last in zip(hits, search.last_steps(), strict=True):
        commands = np.empty((0, 2)) if found.commands is None else found.commands
        braking = np.flatnonzero(commands[:, -2] <= -BRAKES)
        first = round(float(braking[0]) * settings.step, 6) if len(braking) else NEVER
        time = last if last < 0.0 else round(last * settings.step, 6)
        clip = Clip(NO_RETURN, 1, time, first, hit.time)
        marked[place] = replace(found, clips=(*found.clips, clip))
    return marked


class _Search:
    """Replays of contacts of one ADS."""

    def __init__(
        self,
        cases: Sequence[ConcreteScenario],
        recordings: Sequence[Recording],
        settings: SimulationSettings,
    ) -> None:
        self._cases, self._recordings = cases, recordings
        # what the conditions did is in the commands
        self._settings = replace(
            settings, conditions=ConditionSettings(), plant=None, end_when_decided=True
        )

    def last_steps(self) -> list[float]:
        """Of each contact the last step from which braking avoids it, by bisection."""
        last = np.full(len(self._cases), UNKNOWN)
        known = [i for i, it in enumerate(self._recordings) if it.commands is not None]
        high = {i: len(self._commands(i)) for i in known}
        replayed = self._drive(known, [high[i] for i in known])
        known = [i for i, hit in zip(known, replayed, strict=True) if self._repeats(i, hit)]
        last[known] = NEVER
        low: dict[int, int] = {}
        # most points of no return are some seconds before the contact
        for before in (_LATE, math.inf):
            tried = [int(max(high[i] - before, 0)) for i in known]
            self._try(known, tried, low, high)
            known = [i for i in known if i not in low]
        while wide := [i for i in low if high[i] - low[i] > 1]:
            self._try(wide, [(low[i] + high[i]) // 2 for i in wide], low, high)
        last[list(low)] = list(low.values())
        found: list[float] = last.tolist()
        return found

    def _try(
        self, which: Sequence[int], steps: Sequence[int], low: dict[int, int], high: dict[int, int]
    ) -> None:
        """Brake each contact from a step on, which then is its new `low` or `high`."""
        for i, step, hit in zip(which, steps, self._drive(which, steps), strict=True):
            (low if self._avoids(i, hit) else high)[i] = step

    def _commands(self, i: int) -> FloatArray:
        commands = self._recordings[i].commands
        assert commands is not None
        return commands

    def _drive(self, which: Sequence[int], until: Sequence[int]) -> list[Collision | Alone | None]:
        """The contacts of these replays, each braked from its step on."""
        replays = [Replay(self._commands(i), step) for i, step in zip(which, until, strict=True)]
        found = simulate_together([self._cases[i] for i in which], replays, self._settings)
        return [it if isinstance(it, Alone) else it.collision for it in found]

    def _repeats(self, i: int, hit: Collision | Alone | None) -> bool:
        was = self._recordings[i].collision
        return (
            was is not None
            and isinstance(hit, Collision)
            and hit.other == was.other
            and abs(hit.time - was.time) < _SAME
            and abs(hit.relative_speed - was.relative_speed) < _SAME
        )

    def _avoids(self, i: int, hit: Collision | Alone | None) -> bool:
        """Whether the contact is gone: one that runs into the braking ego is another."""
        was = self._recordings[i].collision
        assert was is not None
        if isinstance(hit, Collision):
            return hit.side == "rear" and was.side != "rear"
        return hit is None
