"""The point of no return of a contact: the last step from which full braking still avoids it.

The ADS is not called again. Up to a step, the replay repeats its recorded commands or, where SUMO
or a plant moved the ego, the recorded motion. Then the ego brakes as strongly as it can, with the
wheel straight or, on a curved road, as it was last. Steering away is not considered.

`record/worker.py` adds it to the recordings of a batch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

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

BRAKES = 0.5  # m/s2, commanded deceleration from which on an ADS counts as braking
_LATE = 64  # steps: most points of no return are fewer than this before the contact
_STANDS = 10.0  # s that a braked ego stands until its drive ends: it may be struck meanwhile
_SAME = 1e-6  # s and m/s, contacts that differ by less are one


class _Contact(NamedTuple):
    """A contact, its case and the recorded commands that led to it, as in `Replay`."""

    case: ConcreteScenario
    recording: Recording
    hit: Collision
    commands: FloatArray


def with_no_return(
    recordings: Sequence[Recording | Alone],
    cases: Sequence[ConcreteScenario],
    settings: SimulationSettings,
) -> list[Recording | Alone]:
    """The recordings; those with a contact get the clip `NO_RETURN`."""
    marked = list(recordings)
    contacts = {
        index: _Contact(case, it, it.collision, it.commands)
        for index, (it, case) in enumerate(zip(recordings, cases, strict=True))
        if isinstance(it, Recording) and it.collision is not None and it.commands is not None
    }
    for index, step in _last_steps(contacts, settings).items():
        contact = contacts[index]
        # the column before the last is the acceleration in both kinds of `Replay`
        braking = np.flatnonzero(contact.commands[:, -2] <= -BRAKES)
        braked = round(float(braking[0]) * settings.step, 6) if len(braking) else NEVER
        # `UNKNOWN` and `NEVER`, which are no steps, are below 0
        time = step if step < 0.0 else round(step * settings.step, 6)
        clip = Clip(NO_RETURN, 1, time, braked, contact.hit.time)
        marked[index] = replace(contact.recording, clips=(*contact.recording.clips, clip))
    return marked


def _last_steps(contacts: Mapping[int, _Contact], settings: SimulationSettings) -> dict[int, float]:
    """Last step from which braking avoids each contact, found by bisection.

    `UNKNOWN` where the replay of all commands has another contact, `NEVER` where braking from the
    start does not avoid it.
    """
    # conditions and a plant have had their effect on what is replayed; only contacts matter here
    plain = replace(
        settings,
        conditions=ConditionSettings(),
        plant=None,
        end_when_decided=True,
        standstill_time=max(settings.standstill_time, _STANDS),
    )

    def braked(steps: Mapping[int, int]) -> dict[int, Collision | Alone | None]:
        """Contacts of replays that brake from these steps on; a failed replay counts as one."""
        replays = [Replay(contacts[i].commands, step) for i, step in steps.items()]
        drives = simulate_together([contacts[i].case for i in steps], replays, plain)
        hits = (it if isinstance(it, Alone) else it.collision for it in drives)
        return dict(zip(steps, hits, strict=True))

    # low: step from which braking avoids the contact; high: one from which it does not. The last
    # that does is between them
    low: dict[int, int] = {}
    high = {i: len(it.commands) for i, it in contacts.items()}

    def narrow(steps: Mapping[int, int]) -> None:
        """Try a step for each contact: it becomes its `low` if braking avoids, else its `high`."""
        for i, hit in braked(steps).items():
            # a vehicle that runs into the braking ego from behind is another contact
            behind = isinstance(hit, Collision) and hit.side == "rear"
            avoids = hit is None or (behind and contacts[i].hit.side != "rear")
            (low if avoids else high)[i] = steps[i]

    replayed = [i for i, hit in braked(high).items() if _is_same(hit, contacts[i].hit)]
    # first `_LATE` steps before the contact; if that does not avoid it, from the start
    for before in (_LATE, math.inf):
        narrow({i: int(max(high[i] - before, 0)) for i in replayed if i not in low})
    while wide := [i for i in low if high[i] - low[i] > 1]:
        narrow({i: (low[i] + high[i]) // 2 for i in wide})
    return dict.fromkeys(contacts, UNKNOWN) | dict.fromkeys(replayed, NEVER) | low


def _is_same(hit: Collision | Alone | None, was: Collision) -> bool:
    return (
        isinstance(hit, Collision)
        and hit.other == was.other
        and abs(hit.time - was.time) < _SAME
        and abs(hit.relative_speed - was.relative_speed) < _SAME
    )
