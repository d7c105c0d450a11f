"""Where the recordings for tests are, if they are on this machine at all."""

from pathlib import Path

import pytest

_PLACES = [parent / "shared" / "data" / "human" for parent in Path(__file__).resolve().parents]
HUMAN = next((place for place in _PLACES if place.is_dir()), None)

needs_recordings = pytest.mark.skipif(
    HUMAN is None, reason="the recordings for tests are not on this machine"
)


def recording(*parts):
    """A file of the recordings."""
    return HUMAN.joinpath(*parts)
