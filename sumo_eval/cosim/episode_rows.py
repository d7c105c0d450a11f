"""A batch of cases, each of which can end and begin again by itself, for learning (`extras/gym`).

The vehicle model moves the ego, and scripts move the actors. The functions of every evaluation
(`cosim/step_rules.py`) find contact and ends. With SUMO, SUMO steps the vehicles too. libsumo holds
one simulation in a process, so a process holds one batch with SUMO, but any number without.

Without SUMO the actors are where their scripts put them. An evaluation fails a case in which SUMO
shows actors elsewhere, so both give the same drive to rounding.

Users: `extras/gym/episodes.py`.
"""

from collections.abc import Sequence
from contextlib import ExitStack

import numpy as np

from sumo_eval.cosim.doors.observation import Observations
from sumo_eval.cosim.records import REASONS
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.sumo.insides import libsumo
from sumo_eval.cosim.sumo.session import running
from sumo_eval.cosim.sumo.shared_files import shared_network_xml, shared_routes_xml
from sumo_eval.cosim.world import World, kind_of
from sumo_eval.errors import InputError, SimulationError, must_be
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import ConditionSettings, SimulationSettings
from sumo_eval.trajectory import FloatArray, IntArray


class EpisodeRows:
    """Rows of cases of one logical scenario, stepped together.

    settings: of the simulation; the cases must not change them.
    sumo: whether SUMO steps the vehicles too, and is compared with the world as in an evaluation.
    """

    def __init__(
        self, cases: Sequence[ConcreteScenario], settings: SimulationSettings, *, sumo: bool
    ) -> None:
        if settings.plant is not None or settings.conditions != ConditionSettings():
            raise InputError(
                "Learning needs the usual vehicle model and conditions: no `plant`, nothing in "
                "`conditions`."
            )
        self._settings = cases[0].simulation(settings)
        self._kind = kind_of(cases[0])
        for concrete in cases:
            self._check(concrete)
        self.world = World(cases, self._settings)
        self._context = ExitStack()
        self._stage: Stage | None = None
        if sumo:
            self._open(cases)

    def _open(self, cases: Sequence[ConcreteScenario]) -> None:
        """Start SUMO with all vehicles at their starts."""
        if cases[0].road.bent:
            raise InputError("Learning on a curved road needs `sumo=False`.")
        if libsumo.simulation.isLoaded():
            raise InputError(
                "libsumo holds one simulation in a process, and there is one already: close the "
                "other environment first, or make this one with `sumo=False`."
            )
        texts = shared_network_xml(cases), shared_routes_xml(cases, self._settings)
        with ExitStack() as opened:
            traci = opened.enter_context(running(*texts, self._settings, collisions="none"))
            self._stage = Stage(traci, self.world)
            self._stage.take_charge(self.world)
            if self.world.errors:
                raise SimulationError(next(iter(self.world.errors.values())))
            self._context = opened.pop_all()  # without an error, SUMO stays until `close`

    def close(self) -> None:
        """End the simulation, if there is one."""
        self._context.close()

    def restart(self, row: int, concrete: ConcreteScenario) -> None:
        """Replace the case of a row by another case, at its start."""
        self._check(concrete)
        world = self.world
        fresh = World([concrete], self._settings)
        world.cases = [*world.cases[:row], concrete, *world.cases[row + 1 :]]
        for name in ("egos", "others", "clips", "seen"):
            getattr(world, name)[row] = getattr(fresh, name)[0]
        world.players = world.players.with_row(row, fresh.players)
        world.gather()
        world.egos["begun"][row] = world.steps
        world.none_leaves_before = 0.0  # the new vehicles may be near the end of their lanes

    def step(self, commands: FloatArray) -> IntArray:
        """Step all rows that have not ended; return the rows that end with this step.

        commands: (n, 2), acceleration, m/s2, and steering wheel angle, rad.
        """
        world = self.world
        egos = world.egos
        egos["command"]["acceleration"] = commands[:, 0]
        egos["command"]["steering"] = commands[:, 1]
        stage = self._stage
        to_sumo, compares = (0, False) if stage is None else stage.exchange(world)
        count, gone = world.move(to_sumo=to_sumo)
        if stage is not None:
            stage.put_aside(gone)
            stage.tell(world, count)
            # at step 0 all rows begin: SUMO may have the starts of cases that others replaced
            for row in np.flatnonzero(egos["begun"] == world.steps).tolist():
                stage.begin_again(world, row)
            stage.step()
            if compares:
                stage.compare(world)
        if not world.see():
            return np.empty(0, np.intp)
        rows = np.flatnonzero((egos["reason"] != 0) & (egos["live"] != 0))
        egos["live"][rows] = 0
        return rows

    def reason(self, row: int) -> str:
        """Reason why a row has ended, as in a `Recording`; "" while it continues."""
        return REASONS[int(self.world.egos["reason"][row])] or ""

    def observations(self) -> Observations:
        """Observations of the egos of all rows, as they are now: copies, which a user's reward may
        change and keep.
        """
        world = self.world
        egos = world.egos.copy()
        return Observations(
            egos["time"],  # type: ignore[arg-type]
            world.cases[0].road,
            world.rows,
            egos,
            world.seen.copy(),
            world.others.copy(),
            world.cases,
        )

    def _check(self, concrete: ConcreteScenario) -> None:
        """Raise InputError for a case that cannot be a row of this batch."""
        if concrete.changes:
            raise InputError(
                "Learning needs cases that change no setting (`conditions`, `vehicle`)."
            )
        if concrete.lively:
            raise InputError(
                f"Scenario `{concrete.scenario}` must have scripts that depend on time alone to be "
                "learned in, and lanes that neither open nor end: in it a lane does, the ego must "
                "change lanes, or a vehicle waits for a condition, has a heading, comes in a "
                "stream, or does more than brake once and move sideways."
            )
        if kind_of(concrete) != self._kind:
            raise must_be(
                "The cases",
                "one batch",
                "of one road, one ego's body and as many other vehicles",
                f"{concrete.scenario} ({concrete.label})",
            )
