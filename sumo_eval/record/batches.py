"""Choice of the cases that go to a child process together, and of the cases that go alone; for
`record.engines` and `record.cluster`.

Cases of one kind (same scenario, same ADS or driver) can share one simulation if that ADS or driver
can drive many cases at once. A batch costs time of its own, so batches are as large as allowed.
Towards the end of the run they are smaller, so that every worker has work until the end. If a
batch is lost, its cases run alone, so that only the faulty case fails. Cases of one block, which a
policy over arrays drives in one call, stay together.
"""

import math
import pickle
import zlib
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain, islice
from operator import itemgetter
from typing import NamedTuple

from sumo_eval.cosim.simulation import probable_end
from sumo_eval.record.cases import Case, Outcome, Setup
from sumo_eval.trajectory import Alone, AloneReason

Batch = tuple[Case, ...]


class Kind(NamedTuple):
    """Properties that cases in one batch have in common.

    controller: locator of the ADS or baseline, or source of the drivers.
    block: name of the block; empty outside blocks.
    """

    role: str
    controller: str
    scenario: str
    block: str


LATE: AloneReason = "late"
# most cases in a batch of long drives: SUMO steps each vehicle slower among more vehicles
OF_LONG_CASES = 192
# fewest cases in a batch, if there are as many: starting a smaller batch takes longer than its
# cases
LEAST = 32
# batches of full size for each worker that are held ready, so that the last cases can be divided
# evenly
_BATCHES_AHEAD = 4
_MOST_AHEAD = 16_384  # most cases that are held ready
_SHARES = 2  # batches for each worker into which the last cases are divided
_LOOSE = 256  # ended cases of an ADS on TraCI that are compressed together, to 20 bytes each
_CUT = 4  # divisor of the size of a kind's batches after one of them was lost


class Batches:
    """Cases on their way to child processes.

    workers: number of children.
    largest: cases in a batch at most; 1: all alone.
    """

    def __init__(self, cases: Iterable[Case], workers: int, largest: int) -> None:
        self._waiting = iter(cases)
        self._workers = workers
        self._largest = largest
        self._most_ahead = min(workers * _BATCHES_AHEAD * largest, _MOST_AHEAD)
        self._all_seen = False
        # cases that are held ready, by kind, each with the time at which it probably ends
        self._ahead: dict[Kind, list[tuple[float, Case]]] = {}
        self._alone = deque[Case]()
        self._undisturbed = deque[Case]()
        self._remarks: dict[str, tuple[Alone, str]] = {}  # by key of a case, see `remark`
        self._running = 0  # batches that were taken and have not ended
        self._largest_of: dict[Kind, int] = {}  # size of the next batches of a kind, at most
        # size beyond which batches of a kind take too long
        self._largest_in_time: dict[Kind, int] = {}
        # Cases that ended in batches, by locator of their ADS on TraCI: the latest as objects in
        # `_batched`, earlier ones compressed. All run again if the ADS turns out to keep state
        # between cases; `_keeps_state` then has the reason.
        self._batched = defaultdict[str, list[Case]](list)
        self._compressed = defaultdict[str, list[bytes]](list)
        self._keeps_state: dict[str, Alone] = {}
        self._last: Kind | None = None  # of the case that was made ready last

    def take(self) -> Batch | None:
        """The next cases to run; None when there are none at the moment."""
        if self._alone:
            batch: Batch = (self._alone.popleft(),)
        elif self._ahead or self._make_ready(self._largest):
            batch = self._next()
        elif self._undisturbed and not self._running:
            batch = (self._undisturbed.popleft(),)
        else:
            return None
        self._running += 1
        return batch

    def ended(self) -> None:
        """A batch that was taken does not run any more."""
        self._running -= 1

    def _next(self) -> Batch:
        """The cases of the first kind that probably end latest.

        A batch lasts as long as its longest case, so its cases should end at about the same time.
        Long cases come first, so that none is left for the end of the run.
        """
        kind, queue = next(iter(self._ahead.items()))
        number = min(self._share, self._largest_of.get(kind, self._largest))
        number = 1 if kind.controller in self._keeps_state else number
        if kind.block:
            # cases of a block are planned in a row: the block is whole once another kind follows
            while kind == self._last and self._make_ready(1):
                pass
            number = len(queue)
        queue.sort(key=itemgetter(0))
        batch = tuple(case for _, case in queue[-number:])
        del queue[-number:]
        if not queue:
            del self._ahead[kind]
        return batch

    def look_ahead(self) -> None:
        """Make the next cases ready; best done while the children work."""
        room = self._most_ahead - self._number_ahead
        if room > 0:
            self._make_ready(room)

    @property
    def _number_ahead(self) -> int:
        return sum(map(len, self._ahead.values()))

    @property
    def _share(self) -> int:
        """Cases that the next batch may hold. Near the end the remaining cases are divided among
        the workers, `_SHARES` batches each, so that no worker waits long.
        """
        if not self._all_seen or self._workers == 1:
            return self._largest
        share = math.ceil(self._number_ahead / (_SHARES * self._workers))
        return min(max(share, LEAST), self._largest)

    def _make_ready(self, number: int) -> int:
        """Hold up to `number` more of the waiting cases ready. Returns how many there were."""
        cases = list(islice(self._waiting, number))
        for case in cases:
            self._last = self._add(case)
        self._all_seen = self._all_seen or len(cases) < number
        return len(cases)

    def _add(self, case: Case) -> Kind:
        kind = _kind(case)
        self._ahead.setdefault(kind, []).append((probable_end(case.concrete), case))
        return kind

    def record_success(self, batch: Batch) -> None:
        """Note that every case of a batch has its result. After an earlier failure, the next
        batches of the kind become larger again, up to the largest size that is in time.
        """
        kind = _kind(batch[0])
        size = self._largest_of.get(kind, 1)  # 1: no failure, so nothing to restore
        if size > 1:
            self._largest_of[kind] = min(2 * size, self._largest_in_time.get(kind, self._largest))

    def record_failure(
        self, batch: Batch, why: Sequence[Alone], printed: str, *, too_slow: bool = False
    ) -> None:
        """Run the cases of a lost batch alone, and make the next batches of the kind smaller, down
        to single cases.

        why: the reason for each case.
        printed: output of the batch, for the log of the first case.
        too_slow: whether the batch ran out of time; then batches of the kind stay smaller.
        """
        kind = _kind(batch[0])
        size = max(min(len(batch), self._largest_of.get(kind, self._largest)) // _CUT, 1)
        self._largest_of[kind] = size
        if too_slow:
            self._largest_in_time[kind] = size
        for number, (case, reason) in enumerate(zip(batch, why, strict=True)):
            self.run_alone(case, reason, "" if number else printed)
        if why[0].why == "keeps_state":
            self.rerun_alone(kind.controller, why[0])

    def rerun_alone(self, locator: str, why: Alone) -> None:
        """Run all cases of an ADS alone from now on; rerun its cases that have ended in batches."""
        self._keeps_state[locator] = why
        pickles = map(zlib.decompress, self._compressed.pop(locator, ()))
        # `note_batched` has made these pickles, of cases of this process
        for case in chain(*map(pickle.loads, pickles), self._batched.pop(locator, ())):
            self.run_alone(case, why)

    def note_batched(self, case: Case) -> bool:
        """Note that a case of an ADS on TraCI ended in a batch. False if its ADS is known to keep
        state: the outcome does not count, and the case runs alone.
        """
        if why := self._keeps_state.get(case.controller):
            self.run_alone(case, why)
            return False
        loose = self._batched[case.controller]
        loose.append(case)
        if len(loose) == _LOOSE:
            self._compressed[case.controller].append(zlib.compress(pickle.dumps(loose), 1))
            loose.clear()
        return True

    def never_together(self, batch: Batch) -> None:
        """Hold cases ready again, each as a batch of its own: their kind cannot share a
        simulation.
        """
        for case in batch:
            self._largest_of[self._add(replace(case, block=None))] = 1

    def run_alone(self, case: Case, why: Alone, printed: str = "") -> None:
        """Run a case alone, before all that are held ready.

        printed: added to its log.
        """
        self._alone.append(replace(case, block=None))
        self._remarks[case.key] = why, printed

    def run_undisturbed(self, late: Outcome) -> None:
        """Run a case again when all others have ended, so that nothing slows it down."""
        self._undisturbed.append(late.case)
        self._remarks[late.case.key] = Alone(LATE, late.error or ""), late.log

    def remark(self, case: Case) -> tuple[Alone | None, str]:
        """Reason why a case ran alone, and addition to its log; each is given once."""
        # a case without a reason of its own was never in a batch, if its ADS is known to keep state
        return self._remarks.pop(case.key, (self._keeps_state.get(case.controller), ""))


def largest_batch(setup: Setup) -> int:
    """Cases in a batch at most: as many as the user allows, fewer if each drives to the end of its
    road.
    """
    most = setup.run.cases_per_pack
    return most if setup.simulation.end_when_decided else min(most, OF_LONG_CASES)


def _kind(case: Case) -> Kind:
    block = "" if case.block is None else case.block.name
    return Kind(case.role, case.controller, case.concrete.scenario, block)


def driven(batch: Batch) -> int:
    """Number of cases simulated for a batch: all of a block, even if only some are wanted."""
    block = batch[0].block
    return len(batch) if block is None else len(block.concretes)
