"""Text from outside - exceptions, tracebacks, logs, names, cells - made fit to be kept, sent and
shown.

`clean` is the one function for that. It is called where a text is made: what would be cut later is
then never sent to another process.

Users: `cli/`, `cosim/`, `drivers/`, `errors.py`, `input_file.py`, `method/`, `nightly/`, `record/`,
`report/`, `scenario/`, `scoring/`, `settings/`, `extras/`.
"""

from __future__ import annotations

import math
import re
import traceback
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

SENTENCE = 500
"""Characters that are kept of an error's sentence: one or two lines of a table."""

WORDS = 300
"""Characters that are kept of an exception's own words, so that the sentence around them is kept
whole."""

LOG = 16_000
"""Characters that are kept of a log: its beginning and its end."""

_LEFT_OUT = "[{} characters left out]"
_MARK_ROOM = 40  # characters of `_LEFT_OUT` with its number and what stands around it
UNFIT = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # controls, escape among them; tab and line feed are kept
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # marks that turn the direction of writing
    # line ends of Unicode, byte order mark, noncharacters, surrogates
    "\u2028\u2029\ufeff\ufffe\uffff\ud800-\udfff]"
)
# address of an object, of a `Future` or of code; what follows is optional, so that the search reads
# a text only once
_ADDRESS = re.compile(r"(?: at 0x[0-9A-Fa-f]+)+(>| state=|, file )?")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
# first characters of a cell that a spreadsheet runs as a formula
_FORMULA = "=", "+", "-", "@", "\t", "\r", "\n"


def clean(text: str, most: int = SENTENCE, *, lines: bool = False) -> str:
    """Text from outside, at most `most` characters, with harmful ones replaced by their number in
    hexadecimal.

    lines: keep the lines, and of a longer text the beginning and the end. Else make one line, and
        keep the beginning.

    A text that is cut says how many characters are left out. Addresses of objects are left out:
    they differ between processes. Cleaning a clean text changes nothing.
    """
    # by `str`'s own methods: a text may be of a user's class
    length = str.__len__(text)
    # of a very long text only a head and a tail are read: more than is kept
    tail_length = most if lines else 0
    if length <= most + tail_length:
        fit = _replaced(text, lines=lines)
        left_out = 0
    else:
        head = str.__getitem__(text, slice(0, most))
        tail = str.__getitem__(text, slice(length - tail_length, length))
        fit = _replaced(head, lines=lines) + _replaced(tail, lines=lines)
        left_out = length - most - tail_length
    if len(fit) <= most and not left_out:
        return fit
    room = max(most - _MARK_ROOM, 0)  # of `most`, beside the words on what is left out
    if not lines:
        return f"{fit[:room].rstrip()} … {_LEFT_OUT.format(left_out + len(fit) - room)}"
    half = room // 2
    gap = _LEFT_OUT.format(left_out + len(fit) - 2 * half)
    return f"{fit[:half]}\n{gap}\n{fit[len(fit) - half :]}"


def without_numbers(text: str) -> str:
    """A sentence with `#` for every number: alike for two that differ in nothing else."""
    return _NUMBER.sub("#", text)


def clean_log(text: str) -> str:
    """A log with what harms replaced, and of a long one the beginning and the end."""
    return clean(text, LOG, lines=True)


def as_utf8(text: str) -> str:
    """A text that a file or SQLite can keep: a path or a reason in it may have bytes that are not
    UTF-8, which Python holds as surrogates.
    """
    return text.encode(errors="backslashreplace").decode()


def last_lines(log: str, most: int) -> str:
    """The end of a log, at most `most` lines, each cut to what a sentence may have."""
    lines = log.rstrip().splitlines()
    left_out = [f"[{len(lines) - most} lines left out]"] if len(lines) > most else []
    return "\n".join([*left_out, *(clean(line) for line in lines[-most:])])


def _replaced(text: str, *, lines: bool) -> str:
    plain = str.replace(text, "\r\n", "\n")
    plain = plain.replace("\r", "\n") if lines else " ".join(plain.split("\n"))
    # ` at 0x7f…>` becomes `>`; an address before other text is no object's
    plain = _ADDRESS.sub(lambda match: match[1] or match[0], plain)
    return UNFIT.sub(lambda match: ascii(match.group())[1:-1], plain)


def words_of(value: object, most: int = WORDS) -> str:
    """`str` of an exception or of another object, cleaned and cut; its `__str__` may be a user's
    and may fail.
    """
    try:
        return clean(str(value), most)
    # `__str__` is the user's code
    except BaseException as error:  # noqa: BLE001
        return f"(its text is not available: __str__ raised {kind_of(error)})"


def timestamp() -> str:
    """The present time, UTC, in ISO format to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def point_words(values: Mapping[str, float]) -> str:
    """`ego_speed=30, gap=40`: a point."""
    return ", ".join(f"{name}={value:g}" for name, value in values.items())


def duration_words(seconds: float) -> str:
    """A duration in s below 2 min, in min below 2 h, else in h; `z`: no minus before a zero."""
    if seconds < 120.0:
        return f"{seconds:z.0f} s"
    return f"{seconds / 60.0:z.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:z.1f} h"


def file_stem(case: str) -> str:
    """A key or name as the name of a file; `--` may not be in a comment of XML."""
    return re.sub(r"[^\w.+-]|-(?=-)", "_", case)


def capitalised(text: str) -> str:
    """A text that begins with a capital; names and paths in it keep their letters."""
    return text[:1].upper() + text[1:]


def shown(value: object, most: int = WORDS) -> str:
    """`repr` of any object, cleaned and cut; its `__repr__` may be a user's and may fail."""
    try:
        return clean(repr(value), most)
    # `__repr__` is the user's code; an int may have too many digits
    except BaseException as error:  # noqa: BLE001
        return f"({kind_of(value)} that cannot be shown: {kind_of(error)})"


def kind_of(value: object) -> str:
    """The name of a value's class."""
    # by `type`'s own attribute: a user's metaclass may define another `__name__`
    return clean(type.__dict__["__name__"].__get__(type(value)), WORDS)


def traceback_of(error: BaseException) -> str:
    """The traceback of an exception as text for a log."""
    try:
        return clean_log("".join(traceback.format_exception(error)))
    # an exception's attributes are the user's, and memory may be short
    except BaseException as fault:  # noqa: BLE001
        return f"(the traceback of {kind_of(error)} is not available: {kind_of(fault)})\n"


def number_in(text: str | None) -> float:
    """The finite number that a text from outside is; nan where it is none.

    `2_0`, which only Python reads as 20, is none.
    """
    try:
        value = float((text or "").replace("_", "?"))
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def cell(value: Any) -> Any:
    """A value for a cell of a CSV file.

    Text that a spreadsheet would run as a formula gets a `'` before it.
    """
    # `'=1` becomes `''=1`: else `from_cell` would make `=1` of it
    if isinstance(value, str) and value.lstrip("'").startswith(_FORMULA) and not _is_number(value):
        return f"'{value}"
    return value


def from_cell(value: Any) -> Any:
    """The value that `cell` received."""
    if isinstance(value, str) and value.startswith("'") and cell(value[1:]) == value:
        return value[1:]
    return value


def each_text(table: pd.DataFrame, change: Callable[[Any], Any]) -> pd.DataFrame:
    """A table with everything that is text changed, by `cell` or `from_cell`, headings included."""
    table = table.rename(columns=change)
    for name in table.columns:
        if table[name].dtype.kind not in "biuf":
            table[name] = table[name].map(change)
    return table


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
