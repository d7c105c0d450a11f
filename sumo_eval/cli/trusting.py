"""`--trust`: the option of all commands that open runs."""

from __future__ import annotations

import click


def _trust(context: click.Context, option: click.Parameter, said: bool) -> None:
    from sumo_eval.record.trust import trust_what_is_opened

    trust_what_is_opened(said)


trusting = click.option(
    "--trust",
    is_flag=True,
    expose_value=False,
    callback=_trust,
    help="Run the code that a run of others names, now and from now on (SECURITY.md).",
)
