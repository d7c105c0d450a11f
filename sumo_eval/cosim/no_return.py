"""The point of no return of a contact: the last step from which full braking still avoids it.

The ADS is not called again: a replay repeats the commands that the ADS gave up to a step or, where
SUMO or a plant moved the ego, the recorded motion. From that step on the ego brakes as strongly as
it can. It keeps the wheel straight, on a curved road at its last angle. Steering away from the
contact is not considered.

The clip goes into facts: keep the meaning of its fields, and `BRAKES`, `_STANDSTILL` and
`_TOLERANCE`, on which its times depend. Keep the trials of a contact too, which no other contact
of its batch may change: where braking later avoids a contact that braking earlier does not, other
trials find another step.

Users: `record/worker.py` adds the clip `NO_RETURN` to the recordings of a batch or of a case alone.
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
_STANDSTILL = 10.0  # s that a braked ego stands until its drive ends: it may be struck meanwhile
_TOLERANCE = 1e-6  # s and m/s, contacts that differ by less are the same


class _Contact(NamedTuple):
    """A contact `hit`, its case, its recording, and the commands that led to it (`Replay`)."""

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
        index: _Contact(_standing_long(case, settings), it, it.collision, it.commands)
        for index, (it, case) in enumerate(zip(recordings, cases, strict=True))
        if isinstance(it, Recording) and it.collision and it.commands is not None
    }
    for index, step in _last_steps(contacts, settings).items():
        contact = contacts[index]
        # the column before the last is the acceleration in both kinds of `Replay`
        braking_steps = np.flatnonzero(contact.commands[:, -2] <= -BRAKES)
        # s, when the ADS began to brake
        braked = round(float(braking_steps[0]) * settings.step, 6) if len(braking_steps) else NEVER
        # `UNKNOWN` and `NEVER` are below 0: codes, not steps
        time = float(step) if step < 0 else round(step * settings.step, 6)
        clip = Clip(NO_RETURN, count=1, first_time=time, requested=braked, applied=contact.hit.time)
        marked[index] = replace(contact.recording, clips=(*contact.recording.clips, clip))
    return marked


def _standing_long(case: ConcreteScenario, settings: SimulationSettings) -> ConcreteScenario:
    """The case, in which a drive ends `_STANDSTILL` or longer after the ego has stopped."""
    usual = case.simulation(settings).standstill_time
    return replace(case, standstill_time=max(usual, _STANDSTILL))


def _last_steps(contacts: Mapping[int, _Contact], settings: SimulationSettings) -> dict[int, float]:
    """Last step from which braking avoids each contact, found by bisection around an estimate.

    `UNKNOWN` where the replay of all commands has another contact or none, or fails. `NEVER` where
    braking from the start does not avoid the contact.
    """
    # no conditions and no plant: the recorded commands show their effect already
    plain = replace(settings, conditions=ConditionSettings(), plant=None, end_when_decided=True)

    # by contact. low: last step from which braking is known to avoid it, at first none: `NEVER` is
    # -1, the step before the first. high: first step from which braking is known not to.
    high = {i: len(it.commands) for i, it in contacts.items()}
    hits = zip(contacts.items(), _braked(contacts, high.items(), plain), strict=True)
    low = {i: int(NEVER) for (i, contact), hit in hits if _is_same(hit, contact.hit)}
    # the last trial of each contact; the next trials are near it, then twice as far away, and so on
    last_trial = {i: _estimate(contacts[i], settings) for i in low}
    reach = 2  # steps
    # without the contacts whose last step is found: the next one does not avoid them
    while last_trial := {i: step for i, step in last_trial.items() if high[i] - low[i] > 1}:
        # one trial of each contact, however many contacts there are
        trials = [
            (i, (1 + max(low[i], near - reach) + min(high[i], near + reach)) // 2)
            for i, near in last_trial.items()
        ]
        for (i, step), hit in zip(trials, _braked(contacts, trials, plain), strict=True):
            bound = low if _avoids(hit, contacts[i].hit) else high
            bound[i] = last_trial[i] = step
        reach *= 2
    return dict.fromkeys(contacts, UNKNOWN) | low


def _braked(
    contacts: Mapping[int, _Contact],
    trials: Collection[tuple[int, int]],
    settings: SimulationSettings,
) -> Iterator[Collision | Alone | None]:
    """Contact of each replay that brakes from a step on; None: it has none. `Alone`: the replay
    failed, which counts as a contact.

    trials: key in `contacts`, and step.
    """
    replays = [Replay(contacts[i].commands, step) for i, step in trials]
    drives = simulate_together([contacts[i].case for i, _ in trials], replays, settings)
    return (it if isinstance(it, Alone) else it.collision for it in drives)


def _avoids(hit: Collision | Alone | None, was: Collision) -> bool:
    """Whether a replay with the contact `hit` avoids the contact `was`."""
    if hit is None:
        return True
    # a vehicle that runs into the braking ego from behind is another contact
    return isinstance(hit, Collision) and hit.side == "rear" and was.side != "rear"


def _estimate(contact: _Contact, settings: SimulationSettings) -> int:
    """About the last step from which braking avoids a contact with a body that keeps its speed."""
    ego, hit, vehicle = contact.recording.ego, contact.hit, settings.vehicle
    # of each step: closing speed, m/s, distance that braking needs, m, distance to the contact, m
    times = np.arange(len(contact.commands)) * settings.step
    struck_speed = np.hypot(*hit.ego_velocity) - hit.relative_speed
    closing = np.maximum(np.interp(times, ego.time, ego.speed) - struck_speed, 0.0)
    needed = closing * (closing / vehicle.max_deceleration + vehicle.brake_build_up) / 2.0
    distance = np.cumsum(closing[::-1])[::-1] * settings.step
    # one step before the last step with enough distance: on average, that is nearer
    return max(int(np.count_nonzero(distance >= needed)) - 2, 0)


def _is_same(hit: Collision | Alone | None, was: Collision) -> bool:
    """Whether a replay has the recorded contact `was`."""
    return (
        isinstance(hit, Collision)
        and hit.other == was.other
        and abs(hit.time - was.time) < _TOLERANCE
        and abs(hit.relative_speed - was.relative_speed) < _TOLERANCE
    )
