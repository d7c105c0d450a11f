"""Cases of tests: tables as text, and those of campaigns alone."""

from ast import literal_eval
from functools import partial
from itertools import chain, repeat

import pytest

in_campaign = partial(pytest.param, marks=pytest.mark.campaign)
"""A case that only campaigns run."""


def rows_of(text, *kinds):
    r"""The rows of a text, one a line, their cells between bars, read by `kinds` or as they stand.

    A line that begins with a bar goes on with the row above it; `\n` in a cell ends a line of it.
    """
    return [
        tuple(
            kind(cell.replace(r"\n", "\n"))
            for kind, cell in zip(chain(kinds, repeat(str)), row.split(" | "), strict=False)
        )
        for row in text.strip("\n").replace("\n| ", " | ").splitlines()
    ]


def values_of(text):
    """The rows of a text, one a line, of Python's literals between commas, with its comments."""
    rows = (row.strip() for row in text.strip().splitlines())
    return [literal_eval(f"({row}\n,)") for row in rows if row[0] != "#"]
