"""Lines that the commands print: on a terminal they are broken between words, in a file or a pipe
they are whole. Also: how long the first sentence of a command's help may be.

Users: `cli/`, `extras/`.
"""

import os
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence

import click

WHOLE = 200
"""Longest first sentence of a command in a help, in characters: click cuts a longer one."""


def say(lines: Iterable[str], *, err: bool = False, fg: str | None = None) -> None:
    """Print lines; on a terminal a wider one is broken between words and continues indented.

    A file or a pipe gets every line as it is, so a search finds a whole sentence.

    fg: colour on a terminal.
    """
    is_terminal = (sys.stderr if err else sys.stdout).isatty()
    width = shutil.get_terminal_size().columns
    for line in lines:
        parts = [broken(part, width) for part in line.split("\n")] if is_terminal else [line]
        show(["\n".join(click.style(part, fg=fg) if fg else part for part in parts)], err=err)


def show(lines: Iterable[str], *, err: bool = False) -> None:
    """Print styled lines; a file, a pipe, or a terminal with NO_COLOR gets no colours."""
    colour = False if os.environ.get("NO_COLOR") else None
    for line in lines:
        click.echo(line, err=err, color=colour)


def tell(line: str, *, err: bool = False) -> None:
    """Print one line as `say` does."""
    say((line,), err=err)


def open_in_browser(address: str) -> None:
    """Open an address in the browser that BROWSER or the desktop names, or report that there is
    none.
    """
    import webbrowser

    if not webbrowser.open(address):
        tell(f"No browser was found: open {address} in one.", err=True)


def broken(line: str, width: int) -> str:
    """A line broken between words into parts of at most `width` characters; longer words stay
    whole.

    A line that fits stays as it is, spaces between words too, so that columns stay columns.
    """
    if len(line) <= width:
        return line
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    return "\n".join(textwrap.wrap(
        line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False,
        replace_whitespace=False
    ))  # fmt: skip


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of words as lines with columns of one width."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
