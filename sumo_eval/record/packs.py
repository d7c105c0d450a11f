"""Which cases go to a child process together, and which alone.

Cases of one kind (same scenario, same driver of the ego) can share one simulation where that driver
has a form for many cases. A pack costs something of its own, so packs are as large as may be, and
towards the end smaller and smaller, so that all workers have work to the end, however long their
cases take. What does not come through in a pack runs alone, so that a faulty case costs itself.
Cases of one block, which a policy over arrays drives in one call, go together whatever their
number.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice

from sumo_eval.cosim.simulation import probable_end
from sumo_eval.record.cases import Case, Setup
from sumo_eval.trajectory import Alone

Pack = tuple[Case, ...]
Kind = tuple[str, str, str, str]

# in a pack at most where drives are long: a vehicle's step takes SUMO longer among more of them
OF_LONG_CASES = 192
# cases in a pack if there are as many: in smaller ones its own cost outweighs that of the cases
LEAST = 32
# full packs for each worker that are held ready: the end is seen in time to divide it evenly
_PACKS_AHEAD = 4
_MOST_AHEAD = 16_384  # cases that are held ready at most
_SHARES = 2  # packs that a worker would take of the rest, were they all as large as the next one
_CUT = 4  # by how much packs of a kind get smaller after one that did not come through


class Packs:
    """Cases on their way to `workers` children.

    largest: cases in a pack at most; 1: all alone.
    """

    def __init__(self, cases: Iterable[Case], workers: int, largest: int) -> None:
        self._waiting = iter(cases)
        self._largest = largest
        self._all_seen = False
        self._workers = workers
        self._most_ahead = min(workers * _PACKS_AHEAD * largest, _MOST_AHEAD)
        self._ahead: dict[Kind, _Queue] = {}
        self._number_ahead = 0
        self._alone: deque[tuple[Case, Alone, str]] = deque()
        self._undisturbed: deque[tuple[Case, Alone, str]] = deque()
        self._running = 0
        self._largest_of: dict[Kind, int] = {}
        self._in_time: dict[Kind, int] = {}  # size beyond which packs of a kind take too long
        self._remarks: dict[str, tuple[Alone, str]] = {}
        self._last: Kind | None = None  # of the case that was made ready last

    def take(self) -> Pack | None:
        """The next cases to run; None when there are none at the moment."""
        pack = self._next()
        if pack is None and not self._running and self._undisturbed:
            pack = self._single(self._undisturbed)
        self._running += pack is not None
        return pack

    def ended(self) -> None:
        """A pack that was taken does not run any more."""
        self._running -= 1

    def _single(self, queue: deque[tuple[Case, Alone, str]]) -> Pack:
        case, why, printed = queue.popleft()
        self._remarks[case.key] = why, printed
        return (case,)

    def _next(self) -> Pack | None:
        if self._alone:
            return self._single(self._alone)
        if not self._ahead and not self._make_ready(self._largest):
            return None
        kind, queue = next(iter(self._ahead.items()))
        in_block = bool(kind[-1])
        # until all of the block is there
        while in_block and kind == self._last and self._make_ready(1):
            pass
        pack = queue.take(
            len(queue) if in_block else min(self._share, self._largest_of.get(kind, self._largest))
        )
        self._number_ahead -= len(pack)
        if not len(queue):
            del self._ahead[kind]
        return pack

    def look_ahead(self) -> None:
        """Make the next cases ready; best done while the children work."""
        room = self._most_ahead - self._number_ahead
        if room <= 0 or self._all_seen:
            return
        self._make_ready(room)

    @property
    def _share(self) -> int:
        """How many cases the next pack may hold: of the last ones half of what would be a worker's,
        so that the one that ends first finds something to do, and nothing large is left for the
        other alone.
        """
        if not self._all_seen or self._workers == 1:
            return self._largest
        return min(
            max(math.ceil(self._number_ahead / (_SHARES * self._workers)), LEAST), self._largest
        )

    def _make_ready(self, number: int) -> int:
        """Take in so many of the waiting cases; how many there were."""
        before = self._number_ahead
        for case in islice(self._waiting, number):
            self._last = _kind(case)
            self._ahead.setdefault(self._last, _Queue()).add((case,))
            self._number_ahead += 1
        made = self._number_ahead - before
        self._all_seen = self._all_seen or made < number
        return made

    def came_through(self, pack: Pack) -> None:
        """Every case of a pack has its result: packs of the kind may become as large as they
        were.
        """
        kind = _kind(pack[0])
        if self._largest_of.get(kind, 1) > 1:
            self._largest_of[kind] = min(
                2 * self._largest_of[kind], self._in_time.get(kind, self._largest)
            )

    def did_not_come_through(
        self, pack: Pack, why: Sequence[Alone], printed: str, *, too_slow: bool = False
    ) -> None:
        """A pack was lost: its cases run alone, and the next packs of the kind are smaller, in the
        end single cases.

        why: of each of its cases.
        printed: what the log of the first says besides.
        too_slow: it ran out of time; then packs of the kind do not become as large again.
        """
        kind = _kind(pack[0])
        self._largest_of[kind] = max(
            min(len(pack), self._largest_of.get(kind, self._largest)) // _CUT, 1
        )
        if too_slow:
            self._in_time[kind] = self._largest_of[kind]
        for number, (case, reason) in enumerate(zip(pack, why, strict=True)):
            self.run_alone(case, reason, "" if number else printed)

    def never_together(self, pack: Pack) -> None:
        """Cases of this kind have no form for many: they run alone."""
        loose = [replace(case, block=None) for case in pack]
        kind = _kind(loose[0])
        self._largest_of[kind] = 1
        self._ahead.setdefault(kind, _Queue()).add(loose)
        self._number_ahead += len(loose)

    def run_alone(self, case: Case, why: Alone, printed: str = "") -> None:
        """Let a case run alone, next of all.

        printed: what its log then says besides.
        """
        self._alone.append((replace(case, block=None), why, printed))

    def run_undisturbed(self, case: Case, why: Alone, printed: str = "") -> None:
        """Let a case run once all others have ended, and no other beside it."""
        self._undisturbed.append((case, why, printed))

    def remark(self, case: Case) -> tuple[Alone | None, str]:
        """Why a case ran alone, and what its log says besides; said once."""
        return self._remarks.pop(case.key, (None, ""))


class _Queue:
    """Cases of one kind.

    Those that probably end at the same time are neighbours: a pack lasts as long as its last.

    The longest are taken first, so that no process is left alone with them at the end.
    """

    def __init__(self) -> None:
        self._coming: list[Case] = []
        self._sorted: list[Case] = []

    def __len__(self) -> int:
        return len(self._coming) + len(self._sorted)

    def add(self, cases: Iterable[Case]) -> None:
        self._coming.extend(cases)

    def take(self, number: int) -> Pack:
        if len(self._sorted) < number:
            self._sorted = sorted(
                self._sorted + self._coming, key=lambda case: probable_end(case.concrete)
            )
            self._coming = []
        pack = self._sorted[-number:]
        del self._sorted[-number:]
        return tuple(pack)


def largest_pack(setup: Setup) -> int:
    """Cases in a pack at most: as many as the user allows, fewer where each goes on to the road's
    end.
    """
    most = setup.run.cases_per_pack
    return most if setup.simulation.end_when_decided else min(most, OF_LONG_CASES)


def _kind(case: Case) -> Kind:
    return (
        case.role,
        case.controller,
        case.concrete.scenario,
        "" if case.block is None else case.block.name,
    )


def driven(pack: Pack) -> int:
    """How many cases are simulated for a pack: all of a block, whichever of it are wanted."""
    return len(pack) if pack[0].block is None else len(pack[0].block.concretes)
