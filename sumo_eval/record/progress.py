"""Progress and stopping of long work: functions that a caller passes in.

Users: `evaluation.py`, `nightly/`, `record/`, `report/assessed.py`, `scoring/`, `whatif/search.py`.
"""

from collections.abc import Callable

Stopping = Callable[[], bool]
"""Asked before cases are begun: whether no more of them should be."""


Progress = Callable[..., None]
"""Called with a stage of the work, how much of it is done, how much there is, and how many of the
done ones failed (0 if left out)."""


def quiet(stage: str, done: int, total: int, failed: int = 0) -> None:
    """Shows nothing."""


def never() -> bool:
    """Does not stop: work continues to its end."""
    return False
