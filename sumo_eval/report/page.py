"""Pages: their templates, the files that go into them as they are, and how one is written.

In a page, `packed` text is deflated, then in base64; `packed_bytes` only puts bytes in base64. The
page unpacks both in templates/field.js.

Users: `nightly/`, `report/`, `extras/`.
"""

from __future__ import annotations

import base64
import csv
import functools
import json
import re
import shlex
import zlib
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from markupsafe import Markup, escape

from sumo_eval.input_file import whole, write_whole, writing
from sumo_eval.report.words import interval_words, number, percent, span
from sumo_eval.text import as_utf8, point_words

if TYPE_CHECKING:
    import jinja2

REPORT = "report.html"
CONFIDENCE = "confidence.json"  # the confidence in the scores, for other tools
LEVEL = 6  # of deflating: 9 takes five times as long for a page that is 2 % smaller
_TEMPLATES = "sumo_eval.report"  # package that has the folder `templates`

Json = dict[str, Any]
"""An object of JSON, for a page or a file."""


def write_page(path: Path, page: str, what: str) -> Path:
    """Write a page and return its path.

    what: begins the error message if it cannot be written, e.g. `The report`.
    """
    with writing(f"{what} {path}", path.parent):
        write_whole(path, as_utf8(page))
    return path


def write_json(path: Path, content: Any, what: str) -> Path:
    """Write content without nan as JSON and return the file's path; what: as in `write_page`."""
    return write_page(path, json.dumps(content, indent=2, allow_nan=False) + "\n", what)


def template(name: str) -> jinja2.Template:
    """A page's template."""
    return _environment().get_template(name)


def write_filled(path: Path, name: str, what: str, /, **values: Any) -> Path:
    """Fill a template, write the page and return its path.

    name: of the template.
    what: as in `write_page`.
    values: that the template shows.
    """
    return write_page(path, template(name).render(values), what)


@functools.cache  # a template is compiled once a process
def _environment() -> jinja2.Environment:
    import jinja2  # here, because commands that write no page need no jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "ends": interval_words,
        "span": span,
        "percent": percent,
        "point": point_words,
        "code": code_marked,
        "key": case_key,
        "shell": shlex.quote,
    }
    environment.globals |= {"asset": asset, "plotly": plotly}
    return environment


def case_key(case: str) -> str:
    """A case's key, quoted for use in a URL."""
    return quote(case, safe="")


def code_marked(sentence: str) -> Markup:
    """A sentence, escaped, with what stands between backticks as code."""
    escaped = str(escape(sentence))  # a plain str: in a Markup, `sub` would escape the tags too
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", escaped))  # noqa: S704


def asset(name: str) -> Markup:
    """A file of this package that goes into the page as it is."""
    return Markup((files(_TEMPLATES) / "templates" / name).read_text("utf-8"))  # noqa: S704


def packed_bytes(data: bytes) -> str:
    """Bytes in base64, as they stand in a page; not deflated here."""
    return base64.b64encode(data).decode("ascii")


def packed(text: str) -> str:
    """A text, deflated and in base64.

    Nothing in it can be read as markup, whatever names and error texts it holds.
    """
    return packed_bytes(zlib.compress(text.encode("utf-8"), LEVEL))


def packed_json(value: Any) -> str:
    """Plain values as JSON, deflated."""
    return packed(json.dumps(value, allow_nan=False, separators=(",", ":")))


@functools.cache  # packing it takes a fifth of a second
def plotly() -> str:
    """The library that draws a page's figures, as `packed` gives it."""
    from plotly.offline import get_plotlyjs

    return packed(get_plotlyjs())


def write_csv(path: Path, columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> Path:
    """Write a table and return its path.

    Raises InputError where it cannot be written; an earlier table is then left as it was.
    """
    with (
        writing(str(path), path.parent),
        whole(path) as half,
        half.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
    return path
