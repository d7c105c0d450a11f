"""Arguments and options of one kind that many commands take.

Users: `cli/`, `extras/`.
"""

import math
from functools import partial
from pathlib import Path
from typing import Any

import click

PATH = click.Path(path_type=Path)


class Range(click.FloatRange):
    """A range of numbers."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Refuse nan too: it is never below `min` or above `max`, so the range alone accepts it."""
        number: float = super().convert(value, param, ctx)
        return self.fail("nan is not a number.", param, ctx) if math.isnan(number) else number


# s; `max` is the largest value that `RunSettings` take
POSITIVE = Range(min=0, max=1e6, min_open=True)

path_argument = partial(click.argument, type=PATH)
path_option = partial(click.option, type=PATH)
count_option = partial(click.option, type=click.IntRange(min=1))
flag = partial(click.option, is_flag=True)

RUN = path_argument("run")
GATE = path_option("--gate", help="Limits on changes and values (docs/compare.md).")
WORKERS = count_option("--workers", help="Processes that simulate cases (default: as in the file).")
SEED = click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Source of randomness."
)
RESUME = flag("--resume", help="Continue in --out: simulate what is not recorded there.")


def _trust(context: click.Context, option: click.Parameter, trust_all: bool) -> None:
    from sumo_eval.record.trust import trust_what_is_opened

    trust_what_is_opened(trust_all)


# gives no argument to its command, as it acts at once
trusting = flag(
    "--trust",
    expose_value=False,
    callback=_trust,
    help="Run the code that a run of others names, now and from now on (SECURITY.md).",
)
