"""The rest of an `[[ads]]` entry: how often a controller is called, and the arguments of its
constructor.

It follows the locator in the same text: `my_ads.py:Planner?period=0.2&options.gain=2`. `made` makes
the controller. A class may first load data that all its objects share (`LOAD_ONCE`), once in a
process; that time does not count as driving.

Free to change: the code. Locators in users' files and in stored facts must keep their meaning.

Users: `cosim/`, `record/`, `report/export_case.py`, `extras/gym/episodes.py`.
"""

import inspect
import json
import math
import re
import shlex
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, quote, unquote_plus

from sumo_eval.errors import InputError, check_known, must_be, said, users_code

Options = Mapping[str, Any]  # keyword arguments of a constructor
_OWN = ("period=", "batch=", "options.")  # beginnings of an entry's pairs
# The `?` before the entry: after it a key of the entry follows, directly or after other pairs of
# the same query. Any other `?` belongs to a command or a value.
_ENTRY = re.compile(rf"\?(?=([^?]*&)?({'|'.join(map(re.escape, _OWN))}))")
ENTRY_FORM = "period=SECONDS&options.NAME=VALUE"
LOAD_ONCE = "load_once"
"""The name of a class method that loads what all objects of the class share."""

_load_options: dict[type, Options] = {}
"""By class, the options of its last `LOAD_ONCE` in this process."""
_load_reports: list[str] = []
"""Sentences on loads that `take_load_report` has not returned yet."""


class Entry(NamedTuple):
    """The rest of an `[[ads]]` entry.

    period: s between two calls; 0: the entry names none, and each step has a call.
    options: keyword arguments of the constructor.
    batch: whether its cases may share a simulation.
    """

    period: float = 0.0
    options: Mapping[str, Any] = {}
    batch: bool = True


PLAIN = Entry()


def split_entry(locator: str) -> tuple[str, Entry]:
    """The locator without its entry, and the entry.

    Raises InputError for a key named twice, a period that is not a number above 0, or a batch that
    is not a truth value.
    """
    begin = _ENTRY.search(locator)
    if begin is None:
        return locator, PLAIN
    head, pairs = locator[: begin.start()], locator[begin.end() :].split("&")
    own = "&".join(pair for pair in pairs if pair.startswith(_OWN))
    rest = "&".join(pair for pair in pairs if not pair.startswith(_OWN))
    return f"{head}?{rest}" if rest else head, _read_entry(own, f"ADS `{locator}`")


def _read_entry(query: str, owner: str) -> Entry:
    """The entry of a query; errors as of `split_entry`.

    owner: for error messages.
    """
    period, batch, options = 0.0, True, {}
    for name, text in read_query(query, owner, ENTRY_FORM).items():
        value = _value(text)
        if name == "period":
            if type(value) not in (int, float) or not 0.0 < value <= sys.float_info.max:
                raise must_be("`period`", owner, "a number greater than 0 s", value)
            period = float(value)
        elif name == "batch":
            if not isinstance(value, bool):
                raise must_be("`batch`", owner, "true or false", value)
            batch = value
        else:
            options[name.removeprefix("options.")] = value
    return Entry(period, options, batch)


def _value(text: str) -> Any:
    """The value of a pair: what it is as JSON, else the text."""
    # `+` stands for a space in a query, so that `1e+3` comes as `1e 3`
    for written in (text, text.replace(" ", "+")):
        with suppress(ValueError, RecursionError):
            return json.loads(written)
    return text


def read_query(query: str, owner: str, form: str) -> dict[str, str]:
    """The pairs after the `?` of a locator, of the form `name=value&name=value`.

    owner, form: for the error message.
    """
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
        if len(dict(pairs)) == len(pairs):
            return dict(pairs)
    except ValueError:
        pass  # refused below, as is a name that stands twice
    raise must_be("The options", owner, f"of the form {form}, each name once", query)


def made_absolute(locator: str, folder: Path) -> str:
    """The locator with its path, relative to `folder`, made absolute, so that an evaluation file in
    any folder can name the ADS.

    `env -C` runs a program of `exec:` and `traci:` in `folder`.
    """
    bare = split_entry(locator)[0]
    # Without a query of its own, a locator ends with its entry, which is appended again unchanged.
    # In a query (of `fmu:`, `onnx:`, `sumo:`) pairs of the entry may stand anywhere: they stay.
    if bare != locator and "?" not in bare.partition(":")[2]:
        return made_absolute(bare, folder) + locator[len(bare) :]
    scheme, _, rest = locator.partition(":")
    if scheme in ("exec", "traci") and rest:
        return f"{scheme}:env -C {shlex.quote(str(folder))} {rest}"
    if scheme in ("fmu", "onnx"):
        file, mark, query = rest.partition("?")  # a mapping is no path: it may hold `//`
        if scheme == "onnx":
            query = re.sub(
                r"(?<=features=)[^&]+", lambda it: quote(str(folder / unquote_plus(it[0]))), query
            )
        return f"{scheme}:{folder / file}{mark}{query}"
    # `path.py:Class`, or `module:Class` of a file in the folder; else an installed module
    module, _, name = locator.rpartition(":")
    if scheme != "sumo" and module.isidentifier() and (folder / f"{module}.py").is_file():
        module = f"{module}.py"
    return f"{folder / module}:{name}" if module.endswith(".py") else locator


def check_options(kind: type, options: Options, described: str) -> None:
    """Raise InputError for options that the constructor of a class does not take.

    described: the ADS, for the message.
    """
    try:
        signature = inspect.signature(kind)
    except Exception:  # noqa: BLE001 - compiled code, or a user's metaclass that `made` shows
        return
    parameters = signature.parameters.values()
    names = [p.name for p in parameters if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if not any(p.kind == p.VAR_KEYWORD for p in parameters):
        check_known(f"option of ADS `{described}`", names, *options)
    try:
        signature.bind(**options)
    except TypeError as error:
        raise _not_made(described, options, error) from error


def steps_between(period: float, step: float, owner: str) -> int:
    """Steps from one call to the next, 1 for the period 0.

    Raises InputError for a period that is not a multiple of the step.

    period, step: s. owner: of the period, for the message.
    """
    ratio = period / step
    # above 0.5: a period near 0 must not count as a multiple, that of 0 steps
    if period and not (0.5 < ratio < math.inf and abs(ratio - round(ratio)) <= 1e-6):
        raise must_be("`period`", owner, f"a multiple of `simulation.step` ({step:g} s)", period)
    return max(round(ratio), 1)


def made(kind: type, options: Options, described: str) -> Any:
    """An object of a user's class, made with its options after a `LOAD_ONCE` with the same options.

    described: the ADS, for messages.
    """
    load = getattr(kind, LOAD_ONCE, None)
    if callable(load) and _load_options.get(kind) != options:
        began = perf_counter()
        with users_code(f"ADS `{described}`: `{LOAD_ONCE}` failed"):
            load(**options)
        _load_options[kind] = options
        _load_reports.append(
            f"Loading {kind.__name__} took {perf_counter() - began:.2f} s, once in this process.\n"
        )
    try:
        return kind(**options)
    except (KeyboardInterrupt, InputError):  # an adapter's own message
        raise
    except BaseException as error:
        raise _not_made(described, options, error) from error


def _not_made(described: str, options: Options, error: BaseException) -> InputError:
    """The error of a constructor that failed."""
    how = f"with the options {', '.join(options)}" if options else "without arguments"
    return InputError(f"ADS `{described}`: making one {how} failed: {said(error)}.")


def take_load_report() -> str:
    """Sentences on the loads in this process since the last call; "" if there were none."""
    sentences = "".join(_load_reports)
    _load_reports.clear()
    return sentences
