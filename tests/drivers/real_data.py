"""Where the recordings for tests are, if they are on this machine at all."""

import pytest
from loaded import SHARED

HUMAN = SHARED / "human"

needs_recordings = pytest.mark.skipif(
    not HUMAN.is_dir(), reason="the recordings for tests are not on this machine"
)


def recording(*parts):
    """A file of the recordings."""
    return HUMAN.joinpath(*parts)
