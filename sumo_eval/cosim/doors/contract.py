"""Check of an ADS's contract: drive some cases twice and list what its author should fix.

Like Gymnasium's `check_env`.

Users: `record/apart.py` calls it in a child process, for `sumo-eval check`.
"""

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_eval.cosim.doors.controller import ControllerLike, load_controller
from sumo_eval.cosim.simulation import simulate
from sumo_eval.errors import must_be
from sumo_eval.groups import grouped
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import RunSettings, SimulationSettings
from sumo_eval.text import last_lines, without_numbers
from sumo_eval.trajectory import CHANNELS, Clip, Recording

_WORDS = {
    "acceleration": "asks for {requested:.3g} m/s2, the vehicle gives {applied:.3g}",
    "steering_angle": "asks for a steering wheel angle of {requested:.3g} rad, the vehicle gives "
    "{applied:.3g}",
    "negative_speed": "asks for a speed of {requested:.3g} m/s, the vehicle stops",
    "speed_mode": "sets SUMO's speed mode to {requested:.0f}; the harness sets it back to "
    "{applied:.0f}",
    "touched_vehicle": "writes to other vehicles",
    "dropped_traci_call": "moves the ego through TraCI in a step for which it also gives a "
    "Command: the Command counts",
    "ignored_traci_call": "makes TraCI calls that SUMO ignores, {requested:.0f} in a case",
    "stepped_the_clock": "steps SUMO's clock, which is left out",
    "actor_off_its_script": "another vehicle was {applied:.2f} m off its script",
    "plan_error": "the vehicle was {applied:.2f} m from its plan",
    "plan_ended": "a plan ended at {requested:.2f} s, and was driven on straight until "
    "{applied:.2f} s",
}
"""Words on a clip, by its name; `requested` and `applied` are its values."""
_Recordings = Sequence[Recording]  # of the drives of an ADS
_OF_A_PLAN = ("plan_error", "plan_ended")
_FAR_FROM_A_PLAN = 1.0  # m
_NO_ACCELERATION = 20.0  # m/s2; a larger request is probably a mistake of units
_LINES = 12  # last lines of a log that a finding shows
_COMMANDS = ("acceleration", "steering_angle")  # clips of commands out of range
RUN = RunSettings()
PATIENCE = 60.0  # s of wall time, after which no further case is driven
# share of a limit from which there is a finding: a busier machine may take twice as long
_MARGIN = 0.5
_HINTS = {
    r"[Tt]ype '.*' is not known": "a type of the ego's own is the class attribute `vehicle_type`, "
    "e.g. "
    'vehicle_type = {"carFollowModel": "IDM"}',
    r"[Vv]ehicle '.*' is not known": 'the ego\'s id is the argument `ego`, which is "ego"; other '
    "vehicles come and go, see traci.vehicle.getIDList()",
    "takes 1 positional argument but 3 were given": "a function of one argument gets an "
    "observation, one with *args gets (traci, ego, time): functools.wraps keeps a function's "
    "arguments through a decorator",
    "no device of type": "no vehicle carries a device of SUMO here; compute in your code what it "
    "would say",
}
"""Advice on an error, by a regular expression that its words match."""
_UNMOVED = (
    "return a command, or move it with TraCI; SUMO's car-following model drives it only after "
    "traci.vehicle.setSpeed(ego, -1)"
)
_WALL_CLOCK = "late_command"  # clip that differs from run to run by its nature


class Finding(NamedTuple):
    """One point of the contract.

    kind: `ok`, `note`, `warn` (works, but look at it) or `FAIL`.
    mend: what to do.
    """

    kind: str
    text: str
    mend: str = ""


_Findings = list[Finding]


def check_controller(
    controller: ControllerLike,
    cases: Sequence[ConcreteScenario],
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = RUN.step_timeout,
    case_timeout: float = RUN.case_timeout,
) -> _Findings:
    """Every point of the contract for an ADS, from two drives of each case.

    Raises InputError if the ADS cannot be loaded, or without a case.

    step_timeout, case_timeout: wall time that a step and a case may take in a run, s; the losses of
        a run to these limits are estimated from the wall time of the drives here.
    """
    if not cases:
        raise must_be("`cases`", "`check_controller`", "at least one concrete scenario", cases)
    # every step is recorded: `_same` compares all of them
    settings = settings or SimulationSettings()
    settings = replace(settings, record_interval=settings.step)
    load_controller(controller, folder)
    findings = [Finding("ok", "can be loaded")]

    def drive(some: Sequence[ConcreteScenario]) -> list[Recording]:
        """Drive cases until they took `PATIENCE`; return their recordings."""
        drives = list[Recording]()
        for case in some:
            if sum(recording.wall_time for recording in drives) <= PATIENCE:
                drives.append(
                    simulate(
                        case, controller, settings, folder=folder, step_timeout=step_timeout, seed=1
                    )
                )
        return drives

    first = drive(cases)
    driven = cases[: len(first)]
    findings += _ends(driven, first)
    clock = _projected(driven, first, settings, step_timeout, case_timeout)
    if len(driven) < len(cases):
        text = f"{len(driven)} of {len(cases)} cases were driven: they took over {PATIENCE:g} s"
        clock.insert(0, Finding("note", text))
    if any(finding.kind == "FAIL" for finding in findings):
        return findings + clock
    findings += [Finding("ok", "commands are finite numbers"), _in_range(first)]
    if not any(np.ptp(recording.ego.speed) for recording in first):
        findings.append(Finding("note", "the ego keeps its first speed in every case", _UNMOVED))
    findings += _planned(first)
    again = drive(driven)  # fewer if they take longer than `PATIENCE`
    findings += _counted(list(map(_same, driven, first, again)))
    if len(again) < len(driven):
        findings.append(
            Finding("note", f"{len(again)} of the {len(driven)} cases were driven a second time")
        )
    findings.append(_latency((*first, *again), settings.step))
    return findings + clock


def _projected(
    cases: Sequence[ConcreteScenario],
    recordings: _Recordings,
    settings: SimulationSettings,
    step_timeout: float,
    case_timeout: float,
) -> _Findings:
    """Findings on how many cases a run would lose to its two limits on wall time, estimated by the
    time that the drives took here.
    """
    late = sum(recording.end_reason == "ads_timeout" for recording in recordings)
    mend = "answer sooner, or allow more: [run] step_timeout"
    if late:
        limit = f"step_timeout = {step_timeout:g} s"
        return [
            Finding("FAIL", f"`run` would lose {late} of these {len(cases)} cases to {limit}", mend)
        ]
    if any(recording.end_reason == "ads_error" for recording in recordings):
        return []  # the time of an aborted drive does not predict that of a whole one
    worst = max(recording.controller_latency.longest for recording in recordings)
    findings = []
    if worst > _MARGIN * step_timeout:
        text = (
            f"a step took {_time(worst)} of the step_timeout = {step_timeout:g} s: a busier "
            "machine may lose cases"
        )
        findings.append(Finding("note", text, mend))
    walls = [recording.wall_time for recording in recordings]
    longest = max(walls)
    lost = [case for case, wall in zip(cases, walls, strict=True) if wall > case_timeout]
    # s of wall time for a simulated second, and for a case that lasts until the time limit
    pace = sum(walls) / sum(
        max(recording.simulated_time, settings.step) for recording in recordings
    )
    at_limit = pace * settings.time_limit
    reach = (
        f"a case may simulate {case_timeout / pace:.0f} s at {pace:.2g} s of wall time a "
        "simulated second"
    )
    mend = "answer sooner, ask the ADS less often, or allow more: [run] case_timeout"
    text = ""
    if lost:
        text = (
            f"`run` would lose {len(lost)} of these {len(cases)} cases to case_timeout = "
            f"{case_timeout:g} s, e.g. {lost[0].scenario} ({lost[0].label})"
        )
    elif at_limit > case_timeout:
        text = (
            f"`run` would lose a case that lasts until the time limit of {settings.time_limit:g} s"
            f": {at_limit:.0f} s of wall time, and case_timeout is {case_timeout:g} s"
        )
    elif longest > _MARGIN * case_timeout:
        text = (
            f"the slowest case here took {longest:.0f} s of the case_timeout = {case_timeout:g} s"
        )
    if text:
        findings.append(Finding("FAIL" if lost else "note", f"{text}; {reach}", mend))
    if not findings:
        text = (
            f"`run` would lose none of these cases to step_timeout = {step_timeout:g} s or "
            f"case_timeout = {case_timeout:g} s: {_time(worst)} the slowest step, "
            f"{_time(longest)} the slowest case"
        )
        findings.append(Finding("ok", text))
    return findings


def _ends(cases: Sequence[ConcreteScenario], recordings: _Recordings) -> _Findings:
    """Findings on how cases end: one for each case without a fault, and one for each cause of a
    fault, with its count.
    """
    # cases and their recordings by cause; "": no fault
    alike = grouped(
        (without_numbers(drive.error or "") + drive.error_place, (case, drive))
        for case, drive in zip(cases, recordings, strict=True)
    )
    return [
        Finding(
            "ok",
            f"drives {case.scenario} ({case.label}) to its end: {drive.end_reason} at "
            f"{drive.simulated_time:.2f} s",
        )
        for case, drive in alike.pop("", [])
    ] + [_fault(*group[0], len(group), len(cases)) for group in alike.values()]


def _fault(case: ConcreteScenario, recording: Recording, count: int, cases: int) -> Finding:
    """Finding on one cause of a fault.

    count: how many of the cases it ended; the first of them is reported.
    """
    where = f"{case.scenario} ({case.label})"
    if count > 1:
        where = f"{count} of {cases} cases, e.g. {where}"
    mend = {
        "ads_timeout": "answer sooner, or allow more: [run] step_timeout",
        "sim_error": "SUMO's own words are above; check the vehicle, the parameters and the FMU",
    }.get(recording.end_reason, "fix what the message names")
    error = f"{recording.error}"
    log = recording.log
    mend = next((hint for words, hint in _HINTS.items() if re.search(words, error)), mend)
    if recording.error_place:
        error += f" At {recording.error_place}."
    elif log.strip():
        error += f"\n{last_lines(log, _LINES)}"
    return Finding("FAIL", f"{where}: {error}", mend)


def _worst(recordings: _Recordings, kinds: Collection[str]) -> dict[str, Clip]:
    """The worst clip of each of these kinds: the one whose two values are farthest apart."""
    clips = [clip for it in recordings for clip in it.clips if clip.what in kinds]
    clips.sort(key=lambda clip: (abs(clip.requested - clip.applied), abs(clip.requested)))
    # a later clip, which is worse, replaces an earlier one
    return dict(sorted({clip.what: clip for clip in clips}.items()))


def _said(clip: Clip) -> str:
    """Words on a clip."""
    return _WORDS[clip.what].format(requested=clip.requested, applied=clip.applied)


def _in_range(recordings: _Recordings) -> Finding:
    """Finding on all that was not carried out as requested, or not as scripted: see `_WORDS`."""
    worst = _worst(recordings, _WORDS.keys() - _OF_A_PLAN)
    if not worst:
        return Finding("ok", "commands are within what the vehicle can do")
    text = "; ".join([*map(_said, worst.values()), *_ignored_calls(recordings)])
    if worst.keys() & _COMMANDS:
        mend = (
            "the vehicle does what it can, and every case counts that as clips; if that was not "
            "intended: acceleration is in m/s2, steering is the steering WHEEL's angle in rad"
        )
        if "acceleration" in worst and abs(worst["acceleration"].requested) > _NO_ACCELERATION:
            mend += "; for a speed at once return Command(speed=wanted) instead of (wanted - v)/dt"
        return Finding("warn", text, mend)
    return Finding(
        "note",
        text,
        "allowed, and counted in every case as clips; limit it yourself if that was not intended",
    )


def _ignored_calls(recordings: _Recordings) -> list[str]:
    """Sentences of the logs on TraCI calls that SUMO ignored, each once, without its full stop."""
    lines = {line for recording in recordings for line in recording.log.splitlines()}
    return sorted(line.rstrip(".") for line in lines if line.startswith("SUMO ignored "))


def _planned(recordings: _Recordings) -> _Findings:
    """Finding on the largest distance of the vehicle from its ADS's plan, for an ADS that plans."""
    worst = _worst(recordings, _OF_A_PLAN)
    if not worst:
        return []
    text = "; ".join(map(_said, worst.values()))
    # `cosim/plans.py` notes a `plan_error` of every plan
    if worst["plan_error"].applied > _FAR_FROM_A_PLAN or "plan_ended" in worst:
        return [Finding("warn", text, "a Plan is in road coordinates and in s since the start of "
                                      "the case, from where "
                        "the ego is, and reaches until the next one is given")]  # fmt: skip
    return [Finding("ok", text)]


def _counted(findings: Sequence[Finding]) -> _Findings:
    """All findings without the `FAIL`s, then the first `FAIL`, with the number of all `FAIL`s."""
    wrong = [finding for finding in findings if finding.kind == "FAIL"]
    count = f"{len(wrong)} of {len(findings)} cases, e.g. " if len(wrong) > 1 else ""
    return [
        *(finding for finding in findings if finding.kind != "FAIL"),
        *(finding._replace(text=count + finding.text) for finding in wrong[:1]),
    ]


def _same(case: ConcreteScenario, one: Recording, two: Recording) -> Finding:
    """Finding on whether two drives with one seed are equal in every step."""
    where = f"{case.scenario} ({case.label})"
    n = min(len(one.ego), len(two.ego))
    # the samples that both have, (n, channels)
    samples = [np.column_stack([getattr(r.ego, name)[:n] for name in CHANNELS]) for r in (one, two)]
    equal = np.isclose(samples[0], samples[1], 0.0, 0.0, equal_nan=True).all(axis=1)
    differ = np.flatnonzero(~equal)
    clips = [tuple(clip for clip in r.clips if clip.what != _WALL_CLOCK) for r in (one, two)]
    if (
        not differ.size
        and len(one.ego) == len(two.ego)
        and one.collision == two.collision
        and clips[0] == clips[1]
    ):
        return Finding("ok", f"drives {where} the same a second time, with another case in between")
    i = differ[0] if differ.size else n - 1  # the first sample that differs, else the last
    when = one.ego.time[i] if differ.size else one.simulated_time
    return Finding(
        "FAIL",
        f"{where}: the second drive differs from {when:.2f} s on: {one.ego.speed[i]:.4f} m/s, "
        f"then {two.ego.speed[i]:.4f} m/s",
        "forget everything in reset, keep state on the object alone (cases of a batch run at once "
        "and share its class and module), draw random numbers from a seed, do not read the wall "
        "clock",
    )  # fmt: skip


def _latency(recordings: _Recordings, step: float) -> Finding:
    """Finding on the wall time of the ADS's steps.

    step: of the simulation, s.
    """
    mean = float(np.mean([recording.controller_latency.mean for recording in recordings]))
    worst = max(recording.controller_latency.longest for recording in recordings)
    text = f"{_time(mean)} a step, {_time(worst)} at most; SUMO's step is {_time(step)}"
    if worst > step and math.isfinite(worst):
        return Finding(
            "note",
            text,
            "slower than real time at least once; [simulation.conditions] step_budget makes that "
            "count",
        )
    return Finding("ok", text)


def _time(seconds: float) -> str:
    """A duration in s, ms or us."""
    if seconds >= 1.0:
        return f"{seconds:.3g} s"
    return f"{seconds * 1e6:.3g} us" if seconds < 1e-3 else f"{seconds * 1e3:.3g} ms"
