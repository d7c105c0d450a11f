"""Trust in the code that a run names: it is loaded only if the user recorded the run on this
machine, opened it with `--trust`, or gave this process the same code.

A run folder names code by locators, and the folder where their relative paths start. Opening
another user's run must not execute that code. The user's state folder has a note of each run that
names code and that the user recorded here or trusted. The note is a hash of these names, not of the
files' contents: code that changes under the same path stays trusted.

Users: `cli/options.py`, `record/facts.py`, `record/run_folder.py`.
"""

import os
import shlex
from contextlib import suppress
from pathlib import Path

from sumo_eval.errors import InputError
from sumo_eval.input_file import sha256, write_whole
from sumo_eval.method.severity import CHOICES
from sumo_eval.scenario.catalogue import is_file
from sumo_eval.settings import EvaluationSettings
from sumo_eval.text import clean

Code = tuple[str, str, str]
"""Kind of code (scenario, sampler, severity, people, ADS, vehicle, scheduler), its locator, and the
folder where that is looked for; no folder for a locator with an absolute path.
"""

_trusted: set[Code] = set()  # in this process
_trust_all = False  # whether the user has given `--trust`


def code_of(settings: EvaluationSettings, source: Path, *, driving: bool = True) -> set[Code]:
    """The user's code that a run of these settings loads.

    source: folder where relative paths of the settings start.
    driving: whether to add what only drives need: the ADSs, the vehicle model, the cluster.
    """
    named = [
        ("scenario", entry.use.partition("?")[0])  # without options
        for entry in settings.scenario
        if not is_file(entry.use)
    ]
    named += [("sampler", entry.sampling.method or "") for entry in settings.scenario]
    named += [("severity", settings.method.collision.severity), ("people", settings.drivers.source)]
    # code is named as `file.py:name` or `module:name`; names of shipped severities (`CHOICES`) may
    # have a colon, too
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


def trust_code(settings: EvaluationSettings, source: Path) -> None:
    """Trust the code of an evaluation in this process: the user gave or recorded it."""
    _trusted.update(code_of(settings, source))


def trust_what_is_opened(trust_all: bool) -> None:
    """Trust every run that is opened from now on, or only known runs.

    trust_all: whether the user has given `--trust`.
    """
    global _trust_all
    _trust_all = trust_all


def remember(run: Path, settings: EvaluationSettings, source: Path) -> None:
    """Note that this user recorded a run here, or trusts it.

    A run that names no code needs no note.
    """
    code = code_of(settings, source)
    if not code:
        return
    _trusted.update(code)
    note = _note(run)
    with suppress(OSError):  # without the note a later process asks the user for `--trust`
        note.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_whole(note, _hash(code))


def is_remembered(run: Path, settings: EvaluationSettings, source: Path) -> bool:
    """Whether the user has recorded or trusted the run on this machine, and it names the same code
    as then.
    """
    try:
        return _note(run).read_text(encoding="ascii") == _hash(code_of(settings, source))
    except (OSError, ValueError):
        return False


def refuse_foreign_code(
    run: Path, settings: EvaluationSettings, source: Path, *, driving: bool = False
) -> None:
    """Refuse to load the code that a run names, unless that code is trusted.

    driving: whether the run's ADSs will drive.
    """
    code = code_of(settings, source, driving=driving)
    if code <= _trusted:
        return
    if _trust_all:
        remember(run, settings, source)
        return
    if is_remembered(run, settings, source):
        trust_code(settings, source)  # for other runs that name the same code
        return
    what, locator, _ = min(code - _trusted)
    # `report` loads no code of driving, so it would not remember it
    command = "run --resume --out" if driving else "report"
    raise InputError(
        f"Run {run} must be recorded by you on this machine, or trusted, as it names code: "
        f"the {what} `{clean(locator)}` with paths from {clean(str(source))}. If that code may "
        f"run here, add --trust: sumo-eval {command} {shlex.quote(str(run))} --trust."
    )


def _code(what: str, locator: str, source: Path) -> Code:
    module, _, name = locator.rpartition(":")
    if module.endswith(".py"):
        return what, f"{(source / module).resolve()}:{name}", ""
    return what, locator, str(source)


def _hash(code: set[Code]) -> str:
    return sha256(repr(sorted(code)))


def _note(run: Path) -> Path:
    """The file in the user's state folder that holds the hash of a run's code."""
    path = os.fsencode(run.resolve())  # bytes: a path need not be UTF-8
    state = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    return Path(state, "sumo_eval", "runs", sha256(path)[:32])
