"""Progress and stopping of long work: functions that a caller passes in.

Users: `evaluation.py`, `extras/figures/drawn.py`, `nightly/`, `record/`, `report/assessed.py`,
`scoring/`, `whatif/search.py`.
"""

from collections.abc import Callable

Stopping = Callable[[], bool]
"""Called before further cases begin: whether no further case should begin."""


Progress = Callable[..., None]
"""Called with the name of a stage of the work, the number of its items that are done, the number of
all its items, and the number of done items that failed (0 if left out)."""


def quiet(stage: str, done: int, total: int, failed: int = 0) -> None:
    """Shows nothing."""


def never() -> bool:
    """Does not stop: work continues to its end."""
    return False
