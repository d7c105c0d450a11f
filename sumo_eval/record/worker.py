"""Work of a child process: drive cases with SUMO, alone or together. `record.engines` calls
`answer`.

Every child process loads this file, so it imports only what driving needs.
"""

import random
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sumo_eval.ads.known_answers import IdealBraking, no_reaction
from sumo_eval.cosim.doors.controller import Adapter, load_controller
from sumo_eval.cosim.doors.entry import split_entry, take_load_report
from sumo_eval.cosim.doors.fault_place import fault_place
from sumo_eval.cosim.ego_control import Terms
from sumo_eval.cosim.no_return import with_no_return
from sumo_eval.cosim.simulation import simulate, simulate_together
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.errors import InputError
from sumo_eval.record import reads
from sumo_eval.record.cases import IN_BLOCK, Case, Outcome, Setup, Status, on_its_own
from sumo_eval.record.claims import NO_USER_CODE, STATUS, Results, affinity, as_plain
from sumo_eval.record.identity import named_files
from sumo_eval.record.kept import keep
from sumo_eval.record.watch import interrupted, interrupts_of_ads, watched
from sumo_eval.settings import ConditionSettings, SimulationSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import Alone, Clip, Recording


def run_case(case: Case, setup: Setup) -> Outcome:
    """Simulate a case. A fault of its ADS or of the simulation is part of the outcome."""
    try:
        return _ended(case, _simulate(case, setup))
    except InputError as error:
        cause = error.__cause__
        # an interrupt comes from the ADS's own code, see `_loaded`
        status: Status = "ads_error" if isinstance(cause, KeyboardInterrupt) else "rejected"
        place = fault_place(cause, None, setup.folder)
        return Outcome(case, status, None, str(error), error_place=place)


def answer(cases: Sequence[Case], setup: Setup) -> list[Any]:
    """Result of `run_together`, as a child sends it, with the files that a user's ADS has read
    meanwhile.
    """
    if affinity(cases[0], setup) != NO_USER_CODE:
        locator = cases[0].controller
        named = [setup.folder / file for file in setup.files.get(locator, ())]
        reads.begin(setup.folder, [*named, *named_files(locator, setup.folder)])
    return as_plain(run_together(cases, setup), reads.end())


def run_together(cases: Sequence[Case], setup: Setup) -> Results:
    """Simulate cases of one kind (see `batches`) in one simulation; a single case by `run_case`.

    Returns a list with an outcome for each case, or an `Alone` with the reason why that case has to
    run alone. Returns None if all cases of this kind have to run alone.
    """
    if on_its_own(cases):
        outcome = run_case(cases[0], setup)
        return [replace(outcome, log=take_load_report() + outcome.log)]
    faults: tuple[type[BaseException], ...] = (InputError, *interrupts_of_ads(setup.run))
    try:
        drives = list(_simulate_together(cases, setup))
    except faults:
        return None  # each case reports its fault when it runs alone
    if all(isinstance(drive, Alone) and drive.by_nature for drive in drives):
        return None
    loaded = take_load_report()  # goes to the log of the first outcome
    results: list[Outcome | Alone] = []
    for case, drive in zip(cases, drives, strict=True):
        if isinstance(drive, Alone):
            results.append(drive)
        else:
            results.append(_ended(case, drive, loaded))
            loaded = ""
    return results


def _ended(case: Case, recording: Recording, loaded: str = "") -> Outcome:
    """Outcome of a case that was driven.

    loaded: what loading its ADS printed.
    """
    return Outcome(
        case,
        STATUS[recording.end_reason],
        keep(recording),
        recording.error,
        loaded + recording.log,
        recording.error_place,
        recording.batched,
    )


def _simulate(case: Case, setup: Setup) -> Recording:
    settings = _settings(case, setup)
    if case.role != "ads":
        return simulate(case.concrete, _control(case, settings), settings)
    _seed_global_generators(case)
    drive = simulate(
        case.concrete,
        watched(_loaded(case, setup), setup.run),
        settings,
        folder=setup.folder,
        step_timeout=setup.run.step_timeout,
        seed=case.seed,
        period=split_entry(case.controller)[1].period,
    )
    (recording,) = _with_no_return([drive], [case], setup)
    assert isinstance(recording, Recording)
    return recording


def _control(case: Case, settings: SimulationSettings) -> Any:
    """Controller of the ego in a case of a reference or a driver."""
    if case.role == "human":
        return human_controller(
            case.driver_index, case.driver_count, case.seed, case.concrete, case.population
        )
    if case.role == "ideal":
        return IdealBraking(settings.vehicle.max_deceleration)
    return no_reaction if case.role == "no_reaction" else case.controller


def _loaded(case: Case, setup: Setup) -> Adapter:
    """Load the ADS of a case.

    A user's Ctrl-C does not reach a child process: an interrupt there comes from the ADS's code.
    """
    try:
        return load_controller(case.controller, setup.folder)
    except interrupts_of_ads(setup.run) as error:
        raise InputError(
            f"ADS `{case.controller}`: making one failed: {interrupted(error)}."
        ) from error


def _simulate_together(cases: Sequence[Case], setup: Setup) -> Iterable[Recording | Alone]:
    """Results of `_simulate` for cases of one kind, from one simulation; for a case that has to run
    alone, the reason.
    """
    first, settings = cases[0], _settings(cases[0], setup)
    concretes = [case.concrete for case in cases]
    if first.role != "ads":
        controls = [_control(case, settings) for case in cases]
        return simulate_together(
            concretes, controls if first.role == "human" else controls[0], settings
        )
    block = first.block
    seeds = [case.seed for case in cases]
    if block is not None:
        concretes, seeds = list(block.concretes), [first.seed] * len(block.concretes)
    # for a block, the seed is that of its first case, whichever of its cases the run wants
    _seed_global_generators(replace(first, concrete=concretes[0]))
    before = _states_of_global_generators()
    drives = list(
        simulate_together(
            concretes,
            first.controller,
            settings,
            terms=Terms(setup.run.step_timeout, folder=setup.folder),
            seeds=seeds,
            wrap=lambda ads: watched(ads, setup.run),
            batches=block is not None,
        )
    )
    if block is None:
        # An ADS that draws from these generators must begin each case with the case's seed. So its
        # cases run alone.
        drew = _states_of_global_generators() != before
        return [Alone("draws")] * len(cases) if drew else _with_no_return(drives, cases, setup)
    # `drives` are those of the whole block; `cases` are the cases of it that the run wants
    wanted = [drives[case.point - block.first] for case in cases]
    return _with_no_return(_marked(wanted, len(drives)), cases, setup)


def _marked(drives: Iterable[Recording | Alone], block_size: int) -> list[Recording | Alone]:
    """Drives of a block, each with the clip `IN_BLOCK`, which notes the number of its cases."""
    mark = Clip(IN_BLOCK, 1, 0.0, requested=float(block_size), applied=float(block_size))
    return [
        drive if isinstance(drive, Alone) else replace(drive, clips=(*drive.clips, mark))
        for drive in drives
    ]


def _with_no_return(
    drives: Sequence[Recording | Alone], cases: Sequence[Case], setup: Setup
) -> list[Recording | Alone]:
    """Recordings of an ADS; each contact with its point of no return, if the run asks for it."""
    if not setup.no_return:
        return list(drives)
    return with_no_return(drives, [case.concrete for case in cases], setup.simulation)


def _settings(case: Case, setup: Setup) -> SimulationSettings:
    """Settings of the simulation of a case.

    The run's conditions and vehicle model apply only to ADSs under test. The ideal vehicle has
    brakes of its own. Only its collision counts, so its drive ends once that is decided.
    """
    if case.role == "ads":
        return setup.simulation
    settings = replace(setup.simulation, conditions=ConditionSettings(), plant=None)
    if case.role != "ideal":
        return settings
    return replace(
        settings,
        end_when_decided=True,
        vehicle=replace(
            settings.vehicle,
            max_deceleration=settings.ideal_deceleration,
            brake_build_up=settings.ideal_build_up,
        ),
    )


def _seed_global_generators(case: Case) -> None:
    """Seed the global generators of `random` and `np.random`, so that an ADS that draws from them
    draws the same numbers in every run, whatever ran in this process before.

    The seed depends on the point's values and not on its number, which differs between samples.
    """
    stream = random_stream(
        case.seed, "ads", case.concrete.scenario, case.concrete.label, case.driver
    )
    random.seed(int(stream.integers(2**63)))
    np.random.seed(int(stream.integers(2**32)))  # noqa: NPY002 - the one that ADSs use


def _states_of_global_generators() -> tuple[object, ...]:
    """States of both generators; they differ after a draw."""
    legacy: Any = np.random.get_state()  # noqa: NPY002 - the one that ADSs use
    # `legacy`: name, array, then the place in the array and a normal number drawn ahead
    return random.getstate(), legacy[1].tobytes(), legacy[2:]
