"""What pages of this room share: a plain page of sections, tables and figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1b1f24; max-width: 1080px; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse; margin: .6em 0 1.2em }
td, th { padding: .15em .8em .15em 0; text-align: right; border-bottom: 1px solid #e3e6ea; vertical-align: top }
th { font-weight: 600 } td:first-child, th:first-child { text-align: left }
h2 { margin-top: 2em; border-top: 2px solid #1b1f24; padding-top: .6em }
.note { background: #fdf3e3; padding: .4em .8em }
"""


def page(title: str, parts: Iterable[str]) -> str:
    """A whole page. parts: pieces of HTML, whatever came from outside escaped."""
    body = "\n".join(parts)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style></head><body><h1>{escape(title)}</h1>\n{body}\n</body></html>\n"
    )


def text(sentence: str, kind: str = "") -> str:
    """A paragraph."""
    return f'<p class="{kind}">{escape(sentence)}</p>' if kind else f"<p>{escape(sentence)}</p>"


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table, cells as text."""
    head = "".join(f"<th>{escape(item)}</th>" for item in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(item))}</td>" for item in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def figure(drawn: Any, *, first: bool) -> str:
    """A plotly figure. first: the page's first one, which brings the library."""
    return str(drawn.to_html(full_html=False, include_plotlyjs=first))


def interval(low: float, high: float, digits: int = 3) -> str:
    """Two limits in words."""
    return f"{low:.{digits}g} to {high:.{digits}g}"
