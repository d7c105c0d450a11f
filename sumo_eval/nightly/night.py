"""One night: evaluate, compare with the last good night, write what people and machines read, add a
line of history.

DIR/nights/<time>/ is the folder of a night, DIR/history.sqlite the history.

A night counts once the history has its line. The line is written in one transaction, after all
cases are scored and its gate is evaluated, so no unfinished night is ever compared with. Files that
are written after it (`nightly/morning.py`, the trend) can be missing.

The history also notes which nights began: a night that began and has no line was stopped. The next
start with `--resume` continues it. Any other start removes its folder, unless its run is complete.
A note of the night that starts says which. Only folders of nights that the history knows are ever
removed.

Users: `cli/compare.py`.
"""

import errno
import itertools
import os
import shlex
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

from sumo_eval.errors import InputError, StoppedError, said
from sumo_eval.evaluation import discard_trajectories, record_rounds, score
from sumo_eval.nightly.bases import in_force
from sumo_eval.nightly.history import (
    DONE,
    GATE_FAILED,
    HISTORY,
    NOT_EVALUATED,
    History,
    Night,
    is_begun,
    open_history,
)
from sumo_eval.nightly.judgement import Judgement, judge_night, new_pin
from sumo_eval.nightly.morning import NightResult, write_night
from sumo_eval.nightly.repeats import AGAIN
from sumo_eval.nightly.trend import TREND, write_trend
from sumo_eval.record.facts import resolve
from sumo_eval.record.lock import held
from sumo_eval.record.progress import Progress, Stopping, never, quiet
from sumo_eval.record.run_folder import is_run
from sumo_eval.record.store import FACTS, Store
from sumo_eval.report.assessed import write_assessed_report
from sumo_eval.report.explain import known_case
from sumo_eval.report.gate_result import failed
from sumo_eval.report.junit import JUNIT, comparison_suites, run_suites, write_junit
from sumo_eval.report.summary import first_case
from sumo_eval.report.tables import write_tables
from sumo_eval.report.verdict import Additions, verdict
from sumo_eval.report.words import count
from sumo_eval.results import Evaluation
from sumo_eval.scoring.gate_settings import GateSettings
from sumo_eval.settings.config import read_evaluation
from sumo_eval.settings.toml_file import refuse_unfit
from sumo_eval.whatif.search import CaseLevers, WhatIf

NIGHTS = "nights"
IMPORTED = -1  # exit status of an imported night, for which no gate was evaluated
LOCK = "lock"
SPARE = 1.5  # disk space that must be free, in multiples of the last night's
COPY = 1.0  # the same for the copy of the run in which cases of a noisy ADS are rerun
LEVER_DRIVES = 500  # approximate number of drives that a search for the levers of one case takes
LONGEST_LEVERS = 600.0  # s; a search that may take longer is left to the user
FIRST_NIGHT_ROOM = 200_000_000  # bytes that must be free for a first night; estimated


def run_night(
    evaluation: Path,
    history: Path,
    gate: GateSettings,
    *,
    keep: int = 14,
    workers: int | None = None,
    resume: bool = False,
    progress: Progress = quiet,
    stopping: Callable[[], AbstractContextManager[Stopping]] = lambda: nullcontext(never),
) -> NightResult:
    """Run a night: drive and score the evaluation, and evaluate its gate.

    history: folder of the nights.
    keep: number of the newest nights whose folders stay.
    workers: number of processes, instead of `run.workers`.
    resume: continue the night that was stopped, if one was.
    stopping: makes a context for the time of the drives, whose value returns whether to stop.
    """
    # a mistake in the file is reported before anything is locked, removed or simulated
    read_evaluation(evaluation)
    _refuse_without_history(history)
    with (
        _only_one(history, "this one was not begun"),
        open_history(history, create=True) as database,
    ):
        # the night to continue: the newest stopped night that had begun to record. One that was
        # imported since may be a base, which must not change.
        paths = [history / NIGHTS / name for name in (database.stopped_last() if resume else ())]
        without_line = _without_line(history, database, None)
        stopped = next(
            (path.name for path in paths[::-1] if path in without_line and is_run(path)), None
        )
        shutil.rmtree(history / AGAIN, ignore_errors=True)  # of a night that was killed
        # first, so that a refused night has removed nothing
        _refuse_without_room(history, database, gate, stopped)
        notes = _clear_away(history, database, stopped)
        clock = time.monotonic()
        folder = history / NIGHTS / (stopped or _begin(history, database, notes, resume))
        continues = stopped is not None
        with _unfinished(folder, resumed=continues):
            run = resolve(evaluation, folder, continues, workers=workers)
            with stopping() as is_asked_to_stop:
                recorded = record_rounds(
                    run, folder, resume=continues, progress=progress, stopping=is_asked_to_stop
                )
            scored = score(folder, progress=progress, resolved=run)
            judgement = judge_night(history, database, scored, gate, progress)
            notes += [*recorded.notes, *judgement.bases.notes, *_noise_notes(judgement)]
            report = _write_results(scored, judgement, notes, progress)

            result = verdict(judgement.bases.comparison, judgement.gates, scored)
            base = judgement.bases.good
            status = _exit_status(scored, judgement)
            line = _line(
                scored, folder.name, f"{NIGHTS}/{folder.name}", status, result.sentence
            )._replace(
                base=None if base is None else base.night,
                wall_time=None if continues else time.monotonic() - clock,
            )
            database.add(
                line,
                scored,
                judgement.gates,
                shaky=judgement.shaky,
                pin=new_pin(line, judgement, database, gate),
            )
        # The history has the night: a failure from here on is a note.
        results = partial(write_night, history, line, result.word, judgement, tuple(notes))
        notes += _noted("Its results could not all be written", results)
        # only now: a night that is stopped before needs its trajectories to continue
        discard = partial(discard_trajectories, scored)
        notes += _noted("Its trajectories could not be discarded", discard)
        notes += _prune(history, database, keep)
        trend = partial(write_trend, history, database)
        notes += _noted("The trend page could not be written", trend)
        return NightResult(line, scored, judgement, tuple(notes), report, history / TREND)


def _noise_notes(judgement: Judgement) -> list[str]:
    """Notes on ADSs that drove repeated cases differently."""
    return [
        f"{ads} drove {repeats.cases - repeats.alike} of {count(repeats.cases, 'case')} "
        "differently the second time, so its limits have wider tolerances."
        for ads, repeats in judgement.noise.repeats.items()
        if repeats.noisy
    ]


def _exit_status(evaluation: Evaluation, judgement: Judgement) -> int:
    """Exit status of a night."""
    status = NOT_EVALUATED if evaluation.not_evaluated else DONE
    if failed(judgement.gates) or (status and evaluation.settings.run.incomplete == "gate"):
        status = GATE_FAILED
    return status


def _write_results(
    evaluation: Evaluation, judgement: Judgement, notes: Sequence[str], progress: Progress
) -> Path:
    """Write tables, JUnit file and page of a night; return the page's path."""
    comparison, gates = judgement.bases.comparison, judgement.gates
    write_tables(evaluation)
    write_junit(
        {**comparison_suites(comparison, gates), **run_suites(evaluation)},
        evaluation.folder / JUNIT,
    )
    additions = Additions(
        comparison,
        gates,
        {limit: start.words for limit, start in judgement.since.items()},
        tuple(notes),
    )
    additions = additions._replace(levers=_levers(evaluation, additions, progress))
    return write_assessed_report(evaluation, additions, progress=progress)


def _levers(evaluation: Evaluation, additions: Additions, progress: Progress) -> CaseLevers | None:
    """The levers of the case to look at first; None where it has no contact."""
    case = first_case(evaluation, additions)
    fact = known_case(evaluation.folder, case) if case else None
    if fact is None or fact.collision is None:
        return None
    seconds = LEVER_DRIVES * (fact.wall_time or 0.0)
    if seconds > LONGEST_LEVERS:
        command = shlex.join(["sumo-eval", "whatif", str(evaluation.folder), case])
        return CaseLevers(
            fact, why_not=f"Its drives may take {seconds / 60.0:z.0f} min, so run: {command}"
        )
    try:
        # it reads the scenarios again, whose files may have gone while the night ran
        return WhatIf(evaluation.folder, progress).answers(fact)
    except InputError as error:
        return CaseLevers(fact, why_not=str(error))


def _begin(history: Path, database: History, notes: list[str], resume: bool) -> str:
    """Note that a night begins. Returns its name: a time to the second that no other night has."""
    taken = {night.night for night in database.nights()} | database.stopped()
    taken |= {path.name for path in (history / NIGHTS).glob("*")}
    began = datetime.now(UTC)
    names = (_name(began + timedelta(seconds=later)) for later in itertools.count())
    name = next(name for name in names if name not in taken)
    database.begin(name)
    ran = database.ran()
    last = ran[-1].night if ran else ""
    if name <= last:
        notes.append(
            f"The clock went back: night {last} was added before, {name} now. Nights stand in the "
            "order of adding."
        )
    if resume:
        notes.append("There is no stopped night to continue; this one is a new one.")
    return name


@contextmanager
def _unfinished(folder: Path, *, resumed: bool) -> Iterator[None]:
    """A block whose failure is reported as a night that is not finished."""
    try:
        yield
    except (KeyboardInterrupt, StoppedError):  # the text of a StoppedError is that of `run`
        raise StoppedError(f"Stopped. {_how_to_continue(folder)}") from None
    except (InputError, OSError, sqlite3.Error) as error:
        cause = error.__cause__ or error  # of an InputError that names the file
        full = _is_full(cause, folder)
        if isinstance(error, InputError) and not full:
            if resumed:
                raise InputError(
                    f"Night {folder.name} was not continued: {error} It stays; without --resume a "
                    "new one begins, and this one is removed unless its run is complete."
                ) from error
            if is_run(folder):
                raise InputError(f"{error} {_how_to_continue(folder)}") from error
            raise
        rest = _how_to_continue(folder)
        if full:
            # this night's cases must not keep the disk full until tomorrow
            shutil.rmtree(folder, ignore_errors=True)
            rest = "Its recorded cases were removed."
        raise InputError(
            f"The night could not be finished: {said(cause)}. Earlier nights are as they were. "
            f"{rest}"
        ) from error


def _how_to_continue(folder: Path) -> str:
    """Sentence of the message on a night that was stopped."""
    if is_run(folder):
        return f"The same command with --resume continues night {folder.name}."
    return "It has recorded nothing; the same command begins a new night."


def _is_full(error: BaseException, folder: Path) -> bool:
    """Whether an error says that the disk of a folder is full, or a user's quota on it."""
    if isinstance(error, shutil.Error):  # without a number: it lists the texts of other errors
        return os.strerror(errno.ENOSPC) in str(error)
    if isinstance(error, sqlite3.Error):  # all databases of a night are on the disk of its folder
        return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
    full = getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT)
    # a file that the error names may be on another disk, such as a small /tmp
    named = getattr(error, "filename", None)
    return full and (not isinstance(named, str) or _disk(Path(named)) == _disk(folder))


def _disk(path: Path) -> int:
    """Number of the disk that a path is on, or would be if it existed."""
    return next(it for it in (path, *path.absolute().parents) if it.exists()).stat().st_dev


def import_run(history: Path, run: Path, progress: Progress = quiet) -> Night:
    """Add a finished run to a history, as a night that began when the run was recorded.

    An imported night is a base only if it is accepted, because no gate was evaluated for it.
    """
    path = str(run.resolve())
    refuse_unfit(path, "The path of an imported run")  # the history could not name it
    # first: a failure must not leave an empty history, which `_refuse_without_history` accepts. Nor
    # may a night be refused because a run is scored here.
    evaluation = score(run, progress=progress)
    created = datetime.fromisoformat(str(evaluation.manifest["created"])).astimezone(UTC)
    words = "Imported; no gate evaluated it."
    night = _line(evaluation, _name(created), path, IMPORTED, words)
    with (
        _only_one(history, f"{run} was not added: import it once that night has ended"),
        open_history(history, create=True) as database,
    ):
        database.add(night, evaluation, ())
    return night


def _only_one(history: Path, refused: str) -> AbstractContextManager[None]:
    """Lock of a history: only its holder may add a night.

    refused: ends the error message if another process holds it.
    """
    return held(
        history / LOCK,
        f"The history folder {history}",
        lambda owner: f"Another night is running in {history} ({owner}); {refused}.",
    )


def _refuse_without_history(history: Path) -> None:
    """Raise InputError for folders of nights without a history: a new history would know none of
    them.
    """
    nights = sorted((history / NIGHTS).glob("*"))
    if nights and not is_begun(history):
        raise InputError(
            f"The night was not begun: {history / NIGHTS} holds {count(len(nights), 'night')} and "
            f"{history / HISTORY} is missing or empty. "
            "Put a copy of it back, begin in another folder, or make a new one of these nights: "
            f"{_importing(history, nights[-1])}. Nothing was removed."
        )


def _importing(history: Path, night: Path) -> str:
    return shlex.join(["sumo-eval", "trend", str(history), "--import", str(night)])


def _without_line(history: Path, database: History, resumed: str | None) -> dict[Path, str]:
    """Folders of nights that have no line in the history, except the night that continues. By
    folder: `unknown` to the history, a `complete` run, or `unfinished`.

    resumed: name of the night that continues.
    """
    night_folders = {(history / night.folder).resolve() for night in database.nights()}
    stopped = database.stopped()
    kinds = {}
    for path in sorted((history / NIGHTS).glob("*")):
        if path.resolve() in night_folders or path.name == resumed:
            continue
        kinds[path] = "unfinished"
        if path.name not in stopped:
            kinds[path] = "unknown"
        elif _stored(path, "sealed"):  # e.g. an old copy of the history was put back
            kinds[path] = "complete"
    return kinds


def _clear_away(history: Path, database: History, resumed: str | None) -> list[str]:
    """Remove the folders of stopped nights. Return notes on them and on the night that is resumed.

    The cause of their end is unknown, so their cases are not used, except those of the night that
    continues. A folder stays, and a note names it, if the history does not know it as a night or as
    one that began.

    resumed: name of the night that continues.
    """
    notes = []
    for path, kind in _without_line(history, database, resumed).items():
        if kind == "unknown":
            notes.append(f"{path} is not in the history; it was left as it is.")
        elif kind == "complete":
            notes.append(
                f"{path} is a complete run without a line in the history; it was left as it is. To "
                f"add it: {_importing(history, path)}."
            )
        else:
            gone = "unfinished folder was" if _removed(path) else "folder could not be"
            notes.append(f"Night {path.name} was stopped before its end; its {gone} removed.")
    if resumed:
        notes.append(
            f"Night {resumed} was stopped before its end and continued with its recorded cases. "
            "How long the night took is not known."
        )
    return notes


def _stored(folder: Path, name: str) -> int:
    """A property of a run's store; 0 where none can be read."""
    with suppress(InputError), closing(Store(folder / FACTS)) as store:
        return int(getattr(store, name))
    return 0


def _removed(folder: Path) -> bool:
    """Remove a folder. Returns whether that succeeded: a link is not removed."""
    try:
        shutil.rmtree(folder)
    except OSError:
        return False
    return True


def _name(moment: datetime) -> str:
    """Name of a night that begins at a moment, UTC."""
    return moment.strftime("%Y-%m-%dT%H-%M-%SZ")


def _line(evaluation: Evaluation, name: str, folder: str, status: int, verdict: str) -> Night:
    """The history's line of a night; its base and its wall time are None."""
    package, libsumo = (
        evaluation.manifest.get("versions", {}).get(it, "not known")
        for it in ("sumo_eval", "libsumo")
    )
    return Night(
        name,
        evaluation.name,
        folder,
        None,
        status,
        None,
        verdict,
        package,
        libsumo,
        status == IMPORTED,
    )


def _refuse_without_room(
    history: Path, database: History, gate: GateSettings, stopped: str | None
) -> None:
    """Refuse to begin what would fill the disk.

    stopped: a night that continues, whose files are there already.
    """
    finished = [history / night.folder for night in database.ran()]
    last = next((folder for folder in reversed(finished) if folder.is_dir()), None)
    needed = FIRST_NIGHT_ROOM
    if last is not None:
        # any night may find the first noisy ADS, unless no case is driven twice
        times = SPARE + COPY * bool(gate.noise.cases)
        needed = int(times * (_size(last) + _stored(last, "discarded_size")))
    if stopped:
        needed -= _size(history / NIGHTS / stopped)
    kinds = _without_line(history, database, stopped)
    removable = sum(_size(path) for path, kind in kinds.items() if kind == "unfinished")
    free = shutil.disk_usage(history).free + removable
    if free < needed:
        raise InputError(
            f"The night was not begun: it may need {needed / 1e6:z.0f} MB in {history}; "
            f"{free / 1e6:z.0f} MB are free."
        )


def _size(folder: Path) -> int:
    return sum(path.lstat().st_size for path in folder.rglob("*"))  # a link may lead nowhere


def _noted(failure: str, work: Callable[[], object]) -> list[str]:
    """Do work after the history has the night. Returns a note if the work fails, or is stopped: the
    verdict and the exit status of the night must still be given.

    failure: beginning of the note.
    """
    try:
        work()
    except (InputError, OSError, sqlite3.Error, StoppedError, KeyboardInterrupt) as error:
        return [f"This night is in the history. {failure}: {said(error)}."]
    return []


def _prune(history: Path, database: History, keep: int) -> list[str]:
    """Remove folders of old nights, except the newest `keep`, the newest good one, and those whose
    acceptance counts now or will count again.
    """
    nights = database.ran()
    good = [night for night in nights if night.good]
    kept = {night.night for night in (*nights[-keep:], *good[-1:])}
    # The newest acceptance in force counts. When it expires, an older one may count again. Each
    # that will count on some day also counts on its own last day (9999: without end), because newer
    # ones have expired by then. So these days give all nights that must stay.
    pins = in_force(database.accepted())
    for day in {pin.until or "9999-12-31" for pin in pins}:
        kept |= {pin.night for pin in in_force(pins, day)[-1:]}
    notes, removed = [], 0
    for night in nights:
        folder = history / night.folder
        if night.night in kept or not folder.is_dir():
            continue
        if not _is_own(history, night):
            notes.append(f"{folder} is not a folder of night {night.night}; it was left.")
        elif _removed(folder):
            removed += 1
        else:
            notes.append(f"The folder of night {night.night} could not be removed.")
    if removed:
        notes.append(
            f"The folders of {count(removed, 'old night')} were removed; their lines stay in the "
            "history."
        )
    return notes


def _is_own(history: Path, night: Night) -> bool:
    """Whether a line names the folder that its night was run in, the only one that may be removed:
    a line of a changed history could name any.
    """
    folder = history / NIGHTS / night.night
    return (
        night.folder == f"{NIGHTS}/{night.night}"
        and folder.resolve().parent == (history / NIGHTS).resolve()
        and not folder.is_symlink()
    )
