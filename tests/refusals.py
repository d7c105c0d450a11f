"""What a refusal must look like wherever a test expects one."""

import contextlib
import re

import pytest

from sumo_eval.errors import InputError


@contextlib.contextmanager
def refusal(words=None):
    """Expect an InputError in which `words`, a pattern, is found, and whose lines are sentences."""
    with pytest.raises(InputError, match=words) as caught:
        yield caught
    assert all(line[-1] in ".?" for line in str(caught.value).split("\n"))


def refused(text):
    """Expect an InputError that says this text."""
    return refusal(re.escape(text))
