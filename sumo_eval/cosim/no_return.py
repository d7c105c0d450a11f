"""The point of no return of a contact: the last step from which full braking still avoids it.

The ADS is not called again. Up to a step, the replay repeats its recorded commands or, where SUMO
or a plant moved the ego, the recorded motion. Then the ego brakes as strongly as it can. It keeps
the wheel straight; on a curved road it keeps the last angle. Steering away is not considered.

`record/worker.py` adds it to the recordings of a batch.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sumo_eval.cosim.ego_control import Replay
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
_LEAST_REPLAYS = 8  # in a simulation: its start takes as long as some replays
_STANDSTILL = 10.0  # s that a braked ego stands until its drive ends: it may be struck meanwhile
_TOLERANCE = 1e-6  # s and m/s, contacts that differ by less are one


class _Contact(NamedTuple):
    """A contact, its case, and its recording with the commands that led to it, as in `Replay`."""

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
        if isinstance(it, Recording) and it.collision and it.commands is not None
    }
    for index, step in _last_steps(contacts, settings).items():
        contact = contacts[index]
        # the column before the last is the acceleration in both kinds of `Replay`
        braking = np.flatnonzero(contact.commands[:, -2] <= -BRAKES)
        braked = round(float(braking[0]) * settings.step, 6) if len(braking) else NEVER
        # `UNKNOWN` and `NEVER` are below 0, and no steps
        time = float(step) if step < 0 else round(step * settings.step, 6)
        clip = Clip(NO_RETURN, 1, time, braked, contact.hit.time)
        marked[index] = replace(contact.recording, clips=(*contact.recording.clips, clip))
    return marked


def _last_steps(contacts: Mapping[int, _Contact], settings: SimulationSettings) -> dict[int, float]:
    """Last step from which braking avoids each contact, found by bisection around an estimate.

    `UNKNOWN` where the replay of all commands has another contact, `NEVER` where braking from the
    start does not avoid it.
    """
    # conditions and a plant have shaped the recorded commands; only contacts matter here
    plain = replace(
        settings,
        conditions=ConditionSettings(),
        plant=None,
        end_when_decided=True,
        standstill_time=max(settings.standstill_time, _STANDSTILL),
    )

    # low: last step known to avoid the contact, at first none; high: first one that does not
    high = {i: len(it.commands) for i, it in contacts.items()}
    hits = zip(contacts.items(), _braked(contacts, high.items(), plain), strict=True)
    low = {i: int(NEVER) for (i, contact), hit in hits if _is_same(hit, contact.hit)}
    # the last trial of each contact; the next ones are near it, then twice as far away, and so on
    tried = {i: _estimate(contacts[i], settings) for i in low}
    reach = 1
    while tried := {i: step for i, step in tried.items() if high[i] - low[i] > 1}:
        share = max(_LEAST_REPLAYS // len(tried), 1)
        width = reach * (share + 1)
        trials = [
            (i, step)
            for i, near in tried.items()
            for step in _spread(max(low[i], near - width), min(high[i], near + width), share)
        ]
        for (i, step), hit in zip(trials, _braked(contacts, trials, plain), strict=True):
            if step < high[i]:  # false: an earlier step of this round does not avoid it
                (low if _avoids(hit, contacts[i].hit) else high)[i] = tried[i] = step
        reach *= 2
    return dict.fromkeys(contacts, UNKNOWN) | low


def _braked(
    contacts: Mapping[int, _Contact],
    trials: Collection[tuple[int, int]],
    settings: SimulationSettings,
) -> Iterator[Collision | Alone | None]:
    """Contacts of replays that brake from a step on; a failed replay counts as one.

    trials: number of the contact, and step.
    """
    replays = [Replay(contacts[i].commands, step) for i, step in trials]
    drives = simulate_together([contacts[i].case for i, _ in trials], replays, settings)
    return (it if isinstance(it, Alone) else it.collision for it in drives)


def _avoids(hit: Collision | Alone | None, was: Collision) -> bool:
    """Whether a replay with the contact `hit` avoids the contact `was`."""
    if hit is None:
        return True
    # a vehicle that runs into the braking ego from behind is another contact
    return isinstance(hit, Collision) and hit.side == "rear" != was.side


def _spread(first: int, last: int, count: int) -> Sequence[int]:
    """At most `count` steps between two others, evenly spread."""
    between = range(first + 1, last)
    stride = -(-len(between) // count)
    return between[stride // 2 :: stride]


def _estimate(contact: _Contact, settings: SimulationSettings) -> int:
    """About the last step from which braking avoids a contact with a body that keeps its speed."""
    ego, hit, vehicle = contact.recording.ego, contact.hit, settings.vehicle
    times = np.arange(len(contact.commands)) * settings.step
    struck = np.hypot(*hit.ego_velocity) - hit.relative_speed
    closing = np.maximum(np.interp(times, ego.time, ego.speed) - struck, 0.0)
    needed = closing * (closing / vehicle.max_deceleration + vehicle.brake_build_up) / 2.0
    left = np.cumsum(closing[::-1])[::-1] * settings.step
    # one step before the last step with enough distance: in the mean, that is nearer
    return max(int(np.count_nonzero(left >= needed)) - 2, 0)


def _is_same(hit: Collision | Alone | None, was: Collision) -> bool:
    return (
        isinstance(hit, Collision)
        and hit.other == was.other
        and abs(hit.time - was.time) < _TOLERANCE
        and abs(hit.relative_speed - was.relative_speed) < _TOLERANCE
    )
