"""Which cases go to a child process together, and which alone.

Cases of one kind (same scenario, same driver of the ego) can share one simulation where that driver has a form for many
cases. Packs are large while there is much to do, and small at both ends: soon there is something to show, and all
workers have work to the end. What does not come through in a pack runs alone, so that a faulty case costs itself.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from itertools import islice

from sumo_eval.batch.cases import Case
from sumo_eval.cosim.packed import first_meeting

Pack = tuple[Case, ...]
Kind = tuple[str, str, str]

LEAST = 64  # cases in a pack if there are as many: in smaller ones its own cost outweighs that of the cases
_PARTS = 2  # packs that each worker still gets of what is known to be left
_MOST_AHEAD = 16_384  # cases that are held ready
_AT_ONCE = 512  # cases that are made ready while somebody waits
_CUT = 4  # by how much packs of a kind get smaller after one that did not come through


class Packs:
    """Cases on their way to `workers` children. largest: cases in a pack at most; 1: all alone."""

    def __init__(self, cases: Iterable[Case], workers: int, largest: int) -> None:
        self._waiting = iter(cases)
        self._largest = largest
        self._shares = workers * _PARTS
        self._most_ahead = min(self._shares * largest, _MOST_AHEAD)
        self._ahead: dict[Kind, _Queue] = {}
        self._number_ahead = 0
        self._alone: deque[tuple[Case, str]] = deque()
        self._largest_of: dict[Kind, int] = {}
        self._remarks: dict[str, str] = {}

    def take(self) -> Pack | None:
        """The next cases to run; None when there are none at the moment."""
        if self._alone:
            case, self._remarks[case.key] = self._alone.popleft()
            return (case,)
        if not self._ahead:
            self.look_ahead()
            if not self._ahead:
                return None
        kind = max(self._ahead, key=lambda kind: len(self._ahead[kind]))
        share = max(-(-self._number_ahead // self._shares), LEAST)
        queue = self._ahead[kind]
        pack = queue.take(min(share, self._largest_of.get(kind, self._largest)))
        self._number_ahead -= len(pack)
        if not len(queue):
            del self._ahead[kind]
        return pack

    def look_ahead(self) -> None:
        """Make the next cases ready; best done while the children work."""
        for case in islice(self._waiting, max(min(self._most_ahead - self._number_ahead, _AT_ONCE), 0)):
            self._ahead.setdefault(_kind(case), _Queue()).add((case,))
            self._number_ahead += 1

    def came_through(self, pack: Pack) -> None:
        """Every case of a pack has its result: packs of the kind may become as large as they were."""
        kind = _kind(pack[0])
        if self._largest_of.get(kind, 1) > 1:
            self._largest_of[kind] = min(2 * self._largest_of[kind], self._largest)

    def did_not_come_through(self, pack: Pack, why: str, printed: str) -> None:
        """A pack was lost: its cases run alone, and the next packs of the kind are smaller, in the end single cases."""
        kind = _kind(pack[0])
        self._largest_of[kind] = max(min(len(pack), self._largest_of.get(kind, self._largest)) // _CUT, 1)
        self.run_alone(pack[:1], why + printed)
        self.run_alone(pack[1:], why)

    def never_together(self, pack: Pack) -> None:
        """Cases of this kind have no form for many: they run alone, in turns with other kinds."""
        kind = _kind(pack[0])
        self._largest_of[kind] = 1
        self._ahead.setdefault(kind, _Queue()).add(pack)
        self._number_ahead += len(pack)

    def run_alone(self, cases: Iterable[Case], why: str) -> None:
        """Let cases run alone, next of all. why: what the log of each then says."""
        self._alone.extend((case, why) for case in cases)

    def remark(self, case: Case) -> str:
        """Why a case ran alone, for its log; said once."""
        return self._remarks.pop(case.key, "")


class _Queue:
    """Cases of one kind. Those that probably end at the same time are neighbours: a pack lasts as long as its last."""

    def __init__(self) -> None:
        self._coming: list[Case] = []
        self._sorted: list[Case] = []

    def __len__(self) -> int:
        return len(self._coming) + len(self._sorted)

    def add(self, cases: Iterable[Case]) -> None:
        self._coming.extend(cases)

    def take(self, number: int) -> Pack:
        if len(self._sorted) < number:
            self._sorted = sorted(self._sorted + self._coming, key=lambda case: -first_meeting(case.concrete))
            self._coming = []
        pack = self._sorted[-number:]
        del self._sorted[-number:]
        return tuple(pack)


def _kind(case: Case) -> Kind:
    return case.role, case.controller, case.concrete.scenario
