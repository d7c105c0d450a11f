"""A case: one concrete scenario driven once, and its outcome. `record/` plans, runs and stores
these.

Users: `nightly/repeats.py`, `record/`, `report/`, `scoring/`, `whatif/search.py`,
`extras/bench/costs.py`, `extras/rates/command.py`, `extras/studies/`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Literal, Self

from sumo_eval.frozen import frozen
from sumo_eval.input_file import sha256
from sumo_eval.record.kept import KeptRecording
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import PopulationSettings, RunSettings, SimulationSettings
from sumo_eval.text import clean, clean_log
from sumo_eval.trajectory import Alone, Recording

Role = Literal["ads", "ideal", "no_reaction", "task_reference", "human"]
Status = Literal[
    "ok",
    "collision",
    "off_road",
    "timeout",
    "ads_error",
    "ads_timeout",
    "sim_error",
    "crashed",
    "rejected",
]

ALONE = "Simulated alone: "
"""Begins the log of a case that was taken out of a batch and driven alone; the reason follows."""
BATCHED = ("batched", "compared")
"""Values of `Outcome.batched` for a case of a hook (TraCI code) in a batch: driven there only, or
also alone for comparison, with equal drives."""

IN_BLOCK = "in_block"
"""Name of an entry among a recording's clips that marks a case driven in a block. It limits
nothing: clips are stored with every case, so the mark needs no column. `requested`: number of the
block's cases."""


@frozen
class Block:
    """The cases that a policy over arrays drives together.

    All of them are driven even if the run wants only some: what the policy does in one case may
    depend on the rest of its block.

    first: number of their first point.
    name: hash of their concrete scenarios.
    """

    first: int
    name: str
    # `name` stands for them where blocks are compared or hashed
    concretes: tuple[ConcreteScenario, ...] = field(repr=False, compare=False)

    @classmethod
    def of(cls, first: int, concretes: Sequence[ConcreteScenario]) -> Self:
        """The block of the points from `first` on."""
        return cls(first, sha256(repr(concretes)), tuple(concretes))


@frozen
class Case:
    """One drive to do.

    Its `repr` is hashed into the fingerprint: a change of a field's name, order or `repr` makes all
    recorded drives stale.

    point: its number in the sample.
    driver: name of the ADS or of the human driver; of a reference its role.
    controller: locator of the ADS or baseline; of a human driver the source of the drivers.
    driver_index, driver_count: index of a synthetic driver, number of them at this point.
    seed: for everything random in the drive.
    population: the population that a synthetic driver is drawn from.
    fingerprint: hash of all that the outcome depends on; equal ones mean equal facts.
    block: cases that an ADS over arrays drives together with this one; None for any other.
    """

    point: int
    concrete: ConcreteScenario
    role: Role
    driver: str
    controller: str
    driver_index: int = 0
    driver_count: int = 0
    seed: int = 0
    population: PopulationSettings = PopulationSettings()
    fingerprint: str = ""
    block: Block | None = None

    @property
    def key(self) -> str:
        """`front_vehicle_cut_out-0042-idm`: scenario, number of the point, driver.

        References and human drivers have a `~` before their name, which no ADS's name has.
        """
        mark = "" if self.role == "ads" else "~"
        return f"{self.concrete.scenario}-{self.point:04d}-{mark}{self.driver}"


def on_its_own(cases: Sequence[Case]) -> bool:
    """Whether a batch is a single case outside any block."""
    return len(cases) == 1 and cases[0].block is None


@frozen
class Outcome:
    """Outcome of a case.

    recording: None where the case was rejected, its ADS could not be made, or the process that
        drove it was lost.
    error: message of what failed; None: nothing.
    log: the traceback of an exception, and beginning and end of the case's output.
    error_place: file, line and function of the user's code that an exception came from.
    batched: one of `BATCHED`, as in `Recording`; empty of other cases.
    alone: why a case was taken out of a batch and driven alone; None for any other, also where no
        case of its kind can be in one (`batch = false`, one object for all cases).
    reads: (path, hash) of each file that the process of a user's ADS has read since its last case;
        None: not watched.
    """

    case: Case
    status: Status
    recording: Recording | KeptRecording | None
    error: str | None = None
    log: str = ""
    error_place: str = ""
    batched: str = ""
    alone: Alone | None = None
    reads: Sequence[tuple[str, str]] | None = None

    def __post_init__(self) -> None:
        """Clean texts once more: a process that runs users' code may send anything."""
        for name, text in (
            ("error", None if self.error is None else clean(self.error)),
            ("log", clean_log(self.log)),
            ("error_place", clean(self.error_place)),
            ("batched", self.batched if self.batched in BATCHED else ""),
        ):
            object.__setattr__(self, name, text)


@frozen
class Setup:
    """Values that all cases of a run share.

    folder: where relative paths in locators start.
    files: paths that ADSs depend on, by locator.
    no_return: whether more drives search for the point of no return of each contact of an ADS.
    """

    simulation: SimulationSettings
    run: RunSettings
    folder: Path
    files: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    no_return: bool = False
