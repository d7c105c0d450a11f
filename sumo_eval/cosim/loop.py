"""The loop that steps every simulation, of one case or of hundreds in a batch.

In a step the ADS commands, the vehicle model moves the egos, scripts move the actors, SUMO steps
all vehicles, and the world takes in what SUMO shows. This order decides recorded values. One of
five classes controls the egos:
`Rules` (kernels) and `Replays` (recorded commands) of `cosim/ego_control.py`, `OneEach` (a policy
for each row) and `OverArrays` (one policy over arrays) of `cosim/policies.py`, and `OnTraci` of
`cosim/on_traci.py` (an ADS that calls TraCI).

Users: `cosim/simulation.py`.
"""

import numpy as np

from sumo_eval.cosim.ego_control import EgoControl, fault_of
from sumo_eval.cosim.impossible import LeftTheRoadError
from sumo_eval.cosim.latency import STEPS_BETWEEN_TIMINGS
from sumo_eval.cosim.recordings import end_case
from sumo_eval.cosim.records import ADS_ERROR, REASONS
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.step_rules import stop_rows
from sumo_eval.cosim.world import World
from sumo_eval.errors import ControllerError, SimulationError, said
from sumo_eval.text import SENTENCE, words_of

KEPT = 0.75  # share of live rows below which the rows of ended cases are dropped


def drive(world: World, driver: EgoControl, stage: Stage) -> None:
    """Step until every case has ended.

    world: the cases. driver: controls the egos of all rows. stage: SUMO's side.
    """
    step = world.settings.step
    every = round(world.settings.record_interval / step)  # steps from one sample to the next
    moved = 0  # 1 between `world.move` and SUMO's answer: an error there discards the step
    try:
        driver.begin(world, stage)
        if world.errors or world.left:  # failed at the start, or to be driven alone
            _end_rows(world, driver, stage)
        while world.going:
            steps_after = world.steps + 1
            if world.steps % STEPS_BETWEEN_TIMINGS == 0:
                world.latencies.time_fixed_work()
            driver.step(world, world.steps * step)
            now = steps_after * step
            sampling = steps_after % every == 0
            if sampling:
                world.room_for_samples()
            to_sumo, compares = stage.exchange(world)
            # as_read: actors are where SUMO shows them; count: rows of `world.tell` to send; gone:
            # numbers of actors that left their last lane
            count, gone = world.move(to_sumo=to_sumo, as_read=stage.as_read)
            moved = 1
            if gone:
                stage.put_aside(gone)
            try:
                stage.tell(world, count)
                stage.step()
                driver.after(world, now)
                stage.read(world)
                if compares:
                    stage.compare(world)
            except stage.traci.TraCIException as error:
                if not stage.ads_asks:  # no ADS may ask SUMO
                    raise
                raise ControllerError(  # the ADS has removed a vehicle by TraCI
                    f"After the ADS's step at {world.time:.2f} s SUMO cannot move the ego: "
                    f"{said(error)}."
                ) from error
            moved = 0
            if world.waits:  # an act of an actor waits for a condition
                world.wake(now)
            if world.see(sampling=sampling, as_read=stage.as_read):
                _end_rows(world, driver, stage)
    except LeftTheRoadError:  # raised only where the case is alone
        world.egos["reason"][0] = REASONS.index("off_road")
        _stop(world, moved)
    except (
        ControllerError, SimulationError, stage.traci.TraCIException, stage.traci.FatalTraCIError
    ) as error:  # fmt: skip
        if len(world.cases) > 1:
            raise
        if driver.unguarded and isinstance(error, SimulationError):
            error = ControllerError(f"The ADS's program is responsible: {error}")
        break_off(world, error, moved)
    finally:
        for row in world.live.tolist():
            _release(world, driver, row)
    for row in world.live.tolist():
        end_case(world, row)


def _release(world: World, driver: EgoControl, row: int) -> None:
    """Release the controller of a row, once."""
    case = world.case_of(row)
    if case not in driver.released:
        driver.released.add(case)
        driver.release(world, row)


def break_off(world: World, error: Exception, moved: int = 0) -> None:
    """End a case that is alone by an error.

    moved: 1: within a step, which then does not count.
    """
    if isinstance(error, ControllerError | SimulationError):
        world.fail(0, fault_of(error), words_of(error, SENTENCE))
    elif not world.errors:  # if the ADS closed the simulation, there is an error already
        world.fail(
            0,
            "sim_error",
            words_of(f"SUMO stopped at {world.time:.2f} s: {said(error)}.", SENTENCE),
        )
    _stop(world, moved)


def _stop(world: World, moved: int) -> None:
    """Record the vehicles of a case that is alone where it stops; `moved` as in `break_off`."""
    world.room_for_samples()
    stop_rows(world.egos, world.others, world.samples, moved)


def _explain_refusal(world: World, row: int) -> None:
    """Make the error message if `step_rules.move_rows`, a kernel, has refused a command that is not
    finite.
    """
    ego = world.egos[row]
    if ego["reason"] != ADS_ERROR or world.case_of(row) in world.errors:
        return
    acceleration, steering = ego["command"].tolist()
    name, value = "acceleration", acceleration
    if np.isfinite(acceleration):
        name, value = "steering", steering
    world.fail(
        row,
        "ads_error",
        f"`{name}` of the ADS's Command must be a finite number, got {value!r} at "
        f"{float(ego['time']):.2f} s.",
    )


def _end_rows(world: World, driver: EgoControl, stage: Stage) -> None:
    """Make the recordings of rows that have ended, and drop these rows once they are many."""
    egos = world.egos
    for row in np.flatnonzero((egos["reason"] != 0) & (egos["live"] != 0)).tolist():
        _explain_refusal(world, row)
        _release(world, driver, row)
        stage.remove(world, row)
        end_case(world, row)
    if not world.going:
        return
    rows = world.live
    if len(rows) < KEPT * len(world.rows):
        world.keep(rows)
        driver.keep(world, rows)
        stage.keep(world)
    else:
        stage.without(world)  # the ended rows stay in the arrays; SUMO's side leaves them out
