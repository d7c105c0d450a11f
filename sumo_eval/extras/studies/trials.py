"""Trials: drives of an ADS at the points that a study asks for, `boundary` or `rates.campaign`.

The outcome of each trial is kept in a file until the study has written its results. A study asks
for the same points every time, so a stopped study continues with the kept outcomes.

Users: `extras/rates/campaign.py`, `extras/rates/command.py`, `extras/studies/boundary.py`,
`extras/studies/boundary_command.py`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

from sumo_eval.cli.sentences import say
from sumo_eval.cli.stopping import stop_on_signal
from sumo_eval.errors import InputError, StoppedError
from sumo_eval.frozen import frozen
from sumo_eval.record import loops
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.cases import Case, Outcome, Setup
from sumo_eval.record.engines import identify
from sumo_eval.record.identity import harness_identity, with_fingerprint
from sumo_eval.record.kept import keep
from sumo_eval.record.lock import held_folder
from sumo_eval.record.reads import OneVersion
from sumo_eval.record.recording import Recorder, RoleCases, find_stale
from sumo_eval.record.store import Store
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.trajectory import FloatArray, Recording

KEPT = "unfinished.sqlite"  # in the folder of a study that is not finished
PAGES = "boundary.html", "campaign.html"  # in the folders of finished studies


class _Outcomes(Store):
    """A store that keeps no trajectories: a study of a million trials needs only the outcomes."""

    def add(self, *outcomes: Outcome) -> None:
        super().add(*map(_without_trajectories, outcomes))


def _without_trajectories(outcome: Outcome) -> Outcome:
    """An outcome whose recording, if any, has no drives."""
    recording = outcome.recording
    if isinstance(recording, Recording):
        recording = keep(recording)
    return replace(outcome, recording=recording and recording._replace(drives={}))


@frozen(eq=False)
class Trials:
    """Driver of a study's points, which keeps the outcomes.

    recorder: into the study's store.
    identities: locator of an ADS -> hash of what its behaviour depends on.
    """

    recorder: Recorder
    identities: Mapping[str, str]

    def at(
        self,
        points: FloatArray,
        logical: LogicalScenario,
        ads: tuple[str, str],
        *,
        first: int,
        ended: Callable[[int], None],
    ) -> list[Fact]:
        """Facts of an ADS's drives at points (n, k), one for each point, in their order.

        ads: name and locator.
        first: number of the first point among all points of the search.
        ended: called after each drive, with `first` plus the number of drives that ended.
        """
        recorder = self.recorder
        cases = [
            with_fingerprint(
                Case(number, concrete, "ads", *ads),
                recorder.setup.simulation, self.identities[ads[1]], harness_identity()
            )
            for number, concrete in enumerate(logical.concretes(points), first)
        ]  # fmt: skip
        loops.ready(loops.of_cases(cases))
        replace(recorder, progress=lambda stage, done, *_: ended(first + done)).do(
            [RoleCases(ads[0], logical.name, "ads", cases, len(cases))]
        )
        return [_fact_of(case, recorder.store) for case in cases]


def _fact_of(case: Case, store: Store) -> Fact:
    """The fact of a case that was driven. Without one, a search would mix up its points."""
    fact = store.fact(case.key)
    if fact is None:
        raise RuntimeError(f"{case.key} was driven, but has no fact in {store.path}")
    return fact


@contextmanager
def trials_in(
    folder: Path, setup: Setup, locators: Sequence[str], study: str, *, resume: bool
) -> Iterator[Trials]:
    """Trials of a study of these ADSs. The `with` block must write the results into the folder:
    then the kept outcomes are deleted.

    locators: of the ADSs.
    study: words that identify the study; no other study can continue it.
    resume: whether to continue the study that was stopped in this folder.
    Raises InputError where an ADS cannot be loaded, or where the folder holds results, a stopped
    study without `resume`, or no stopped study with it.
    """
    path = folder / KEPT
    if results := [name for name in PAGES if (folder / name).exists()]:
        raise InputError(
            f"{folder} holds the results of a study, {results[0]}: name another folder with --out."
        )
    if resume and not path.exists():
        raise InputError(
            f"--resume must have the folder of a stopped study in --out, got {folder}: there is "
            "nothing to resume."
        )
    identities = identify([("ADS", locator) for locator in locators], setup)
    with stop_on_signal() as stopping, held_folder(folder):
        with closing(_Outcomes(path, create=True)) as store:
            _refuse_another(store, study, resume)
            store.note("study", study)
            say(find_stale(store, setup.folder))
            store.remove_stale()
            recorder = Recorder(
                store, setup, lambda *_: None, stopping, OneVersion(store.files_read())
            )
            try:
                yield Trials(recorder, identities)
            except (StoppedError, KeyboardInterrupt):
                drives = sum(count.drives for count in store.counts())
                raise StoppedError(
                    f"Stopped. {drives} drives are kept in {folder}; the same command with "
                    f"--out {folder} --resume continues."
                ) from None
        path.unlink()


def _refuse_another(store: Store, study: str, resume: bool) -> None:
    """Raise InputError for a store with drives of a stopped study, unless it is `study` and
    resumed. A damaged store is refused too.
    """
    store.check()
    if not store.counts():
        return
    holds = f"{store.path.parent} holds a study that was stopped"
    if not resume:
        raise InputError(f"{holds}; --resume continues it.")
    if (noted := store.noted("study")) != study:
        raise InputError(f"{holds}, `{noted}`; `{study}` needs another folder.")
