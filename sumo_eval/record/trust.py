"""Origin of the code that a run may name: Python is loaded for a run that this user recorded here,
and for no other user's.

A run folder holds the names of functions (severity, sampler, scenario, people) and the folder where
they are looked for. The folders of runs that were recorded by this user on this machine stand in
the user's state folder, each with a hash of what it names; so does one that the user trusts by
`--trust`. What an evaluation names that the user gives is the user's own, in whatever run of the
same process it stands.
"""

from __future__ import annotations

import hashlib
import os
import shlex
from pathlib import Path

from sumo_eval.errors import InputError
from sumo_eval.method.severity import CHOICES
from sumo_eval.scenario.catalogue import is_file
from sumo_eval.settings import EvaluationSettings
from sumo_eval.text import clean

Code = tuple[str, str, str]
"""Kind of code, its locator, and the folder where that starts."""

_given: set[Code] = set()
_trusted: set[tuple[str, str]] = set()  # folder and hash, where the state folder takes none
_asked = False


def code_of(settings: EvaluationSettings, source: Path, *, driving: bool = True) -> set[Code]:
    """The Python that opening a run of these settings loads.

    driving: with the code of its ADSs, its vehicle and its cluster.
    """
    named = [
        ("scenario", entry.use.partition("?")[0])
        for entry in settings.scenario
        if not is_file(entry.use)
    ]
    named += [("sampler", entry.sampling.method or "") for entry in settings.scenario]
    named += [("severity", settings.method.collision.severity), ("people", settings.drivers.source)]
    named = [(what, name) for what, name in named if ":" in name and name not in CHOICES]
    if driving:
        named += [
            ("ADS", ads.controller)
            for ads in settings.ads
            if ":" in ads.controller and not ads.controller.startswith("sumo:")
        ]
        if settings.simulation.plant is not None:
            named.append(("vehicle", settings.simulation.plant.file))
        if settings.run.engine == "dask":
            named.append(("scheduler", settings.run.scheduler))
    return {_code(what, name, source) for what, name in named}


def give(settings: EvaluationSettings, source: Path) -> None:
    """Take what an evaluation names that the user gives, or recorded, for the user's own, in this
    process.
    """
    _given.update(code_of(settings, source))


def trust_what_is_opened(said: bool) -> None:
    """Trust every run that is opened from now on, as the user says, or no more."""
    global _asked
    _asked = said


def remember(run: Path, settings: EvaluationSettings, source: Path) -> None:
    """Note that this user recorded a run here, or trusts it.

    A run that names no code needs no note.
    """
    code = code_of(settings, source)
    if not code:
        return
    _given.update(code)
    place, digest = str(run.resolve()), _hash(code)
    _trusted.add((place, digest))
    note = _note(place)
    try:
        note.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        half = note.with_name(f"{note.name}.{os.getpid()}")
        half.write_text(digest, encoding="ascii")
        half.replace(note)
    except OSError:  # this process knows it, and a later one is told how to go on
        pass


def is_remembered(run: Path, settings: EvaluationSettings, source: Path) -> bool:
    """Whether this user recorded the run on this machine, or trusts it, and it names what it named
    then.
    """
    place, code = str(run.resolve()), code_of(settings, source)
    try:
        known = (place, _hash(code)) in _trusted
        return known or _note(place).read_text(encoding="ascii") == _hash(code)
    except (OSError, ValueError):
        return False


def refuse_foreign_code(
    run: Path, settings: EvaluationSettings, source: Path, *, driving: bool = False
) -> None:
    """Refuse to load what a run names that this user neither recorded here nor names nor trusts.

    driving: its ADSs are to be run, too.
    """
    code = code_of(settings, source, driving=driving)
    if code <= _given:
        return
    if _asked:
        remember(run, settings, source)
    if is_remembered(run, settings, source):
        give(settings, source)  # another run beside it may name the same
        return
    what, locator, _ = min(code - _given)
    raise InputError(
        f"Run {run} names code, the {what} `{clean(locator)}` with paths from "
        f"{clean(str(source))}, and is not known as recorded by you on this machine. If that code "
        f"may run here: sumo-eval report {shlex.quote(str(run))} --trust."
    )


def _code(what: str, locator: str, source: Path) -> Code:
    place, _, name = locator.rpartition(":")
    if place.endswith(".py"):
        return what, f"{(source / place).resolve()}:{name}", ""
    return what, locator, str(source)


def _hash(code: set[Code]) -> str:
    return hashlib.sha256(repr(sorted(code)).encode()).hexdigest()


def _note(place: str) -> Path:
    state = os.environ.get("XDG_STATE_HOME") or os.path.join(
        os.path.expanduser("~"), ".local", "state"
    )
    return Path(state, "sumo_eval", "runs", hashlib.sha256(place.encode()).hexdigest()[:32])
