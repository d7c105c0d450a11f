"""One error family and one sentence shape: what, of which object, must be, got; the nearest known
name is offered.
"""

from __future__ import annotations

import bisect
import difflib
import itertools
import os
import re
from collections.abc import Collection, Iterable, Sequence

from sumo_eval.text import SENTENCE, WORDS, clean, kind_of, shown, words_of


class SumoEvalError(Exception):
    """Any fault this package reports on purpose.

    Its text is plain sentences for the person at the terminal.
    """


class InputError(SumoEvalError, ValueError):
    """The user's input cannot be used (exit status 2)."""


class NotInstalledError(InputError, ImportError):
    """A library cannot be loaded.

    It is an ImportError, too, which the fork server ignores while it loads modules in advance.
    """


class ControllerError(SumoEvalError):
    """The ADS under test raised, or returned something that is not a command."""


class ControllerTimeoutError(ControllerError):
    """The ADS under test took longer over one step than it may."""


class SimulationError(SumoEvalError):
    """SUMO refused or lost something that the harness had asked of it."""


class StoppedError(SumoEvalError):
    """The work was stopped on request, by Ctrl-C or SIGTERM.

    Its text says what is kept and how to continue.
    """


MOST_KNOWN = 800  # characters of a list of known names; a run may have a million cases


LEAST_ALIKE = 0.55  # of 1: names that are less alike are not offered


def nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name that a misspelt one is most like, None where none is near.

    The answer is that of `difflib.get_close_matches`. The name with the longest common beginning is
    compared first: most others are then ruled out by a quick count of their letters, which matters
    where a hundred thousand are known.
    """
    if not known:
        return None
    matcher = difflib.SequenceMatcher(b=name)
    best, near = LEAST_ALIKE, ""
    # `commonprefix` compares letters, not parts of paths, which is what names need
    first = max(known, key=lambda one: len(os.path.commonprefix([one, name])))  # noqa: RUF071
    for one in itertools.chain((first,), known):
        matcher.set_seq1(one)
        if matcher.real_quick_ratio() >= best and matcher.quick_ratio() >= best:
            # of two equally alike names, the later one in the alphabet
            best, near = max((best, near), (matcher.ratio(), one))
    return near or None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A closing half-sentence: the nearest known name, or the list of known names when none is
    near.
    """
    names = list(map(str, known))
    near = nearest(name, names)
    if near is not None:
        return f" Did you mean `{near}`?"
    # each is shortened, so that at least two fit into the list
    ends = list(itertools.accumulate(len(it[:WORDS]) + len(", ") for it in names))
    fitting = bisect.bisect(ends, MOST_KNOWN)
    listed = ", ".join(it[:WORDS] for it in names[:fitting])
    if fitting < len(names):
        listed += f" and {len(names) - fitting} more"
    return f" Known: {listed}." if names else ""


def must_be(what: str, owner: str, requirement: str, got: object) -> InputError:
    """`gap` of scenario `front_vehicle_cut_out` must be within 20..120 m, got 150."""
    return InputError(f"{what} of {owner} must be {requirement}, got {shown(got)}.")


def needs_extra(what: str, extra: str) -> InputError:
    """An FMU needs the extra `fmu`, which this installs: python -m pip install
    '/home/me/sumo_eval[fmu]'.
    """
    return InputError(
        f"{what} needs the extra `{extra}`, which this installs: {install_command(extra)}"
    )


def install_command(extra: str) -> str:
    """The command that installs an extra of this package into the Python that runs, from where the
    package came.
    """
    import json
    import shlex
    import sys
    from importlib.metadata import PackageNotFoundError, distribution
    from pathlib import Path
    from urllib.parse import unquote

    name, editable = f"sumo_eval[{extra}]", ""
    try:
        origin = json.loads(distribution("sumo_eval").read_text("direct_url.json") or "{}")
    except PackageNotFoundError:  # run from its sources without being installed
        origin = {"url": Path(__file__).parents[1].as_uri(), "dir_info": {"editable": True}}
    url = str(origin.get("url", ""))
    if "dir_info" in origin and url.startswith("file://"):
        name = f"{unquote(url.removeprefix('file://'))}[{extra}]"
        editable = "-e " if origin["dir_info"].get("editable") else ""
    elif url:
        name = f"{name} @ {url}"
    return f"{shlex.quote(sys.executable)} -m pip install {editable}{shlex.quote(name)}"


def check_name(owner: str, name: str) -> None:
    """Refuse a `name` that a table, a file or a terminal could not show as it is."""
    if clean(name) != name:
        shape = f"one line of at most {SENTENCE} characters that can be shown"
        raise must_be("`name`", owner, shape, name)


def check_vehicle_name(owner: str, name: str) -> None:
    """Refuse a `name` that SUMO could not give a vehicle."""
    check_name(owner, name)
    if re.search(r"""[\s|\\'";,<>&]""", name):
        raise must_be("`name`", owner, """without spaces and | \\ ' " ; , < > &""", name)


def unknown(kind: str, name: str, known: Iterable[str]) -> InputError:
    """Unknown parameter `gpa` of scenario `cut_in`. Did you mean `gap`?

    kind: what is unknown, and of or in what: `parameter of scenario `cut_in``.
    """
    # the owner begins with the first " of " or " in "; a colon at the end belongs to neither
    parts = re.fullmatch(r"(.*?)((?: of | in ).*?)?:?", kind, flags=re.DOTALL)
    what, owner = parts.groups(default="")  # type: ignore[union-attr]
    return InputError(f"Unknown {what} `{clean(name)}`{owner}.{did_you_mean(name, known)}")


def check_known(kind: str, known: Collection[str], *names: str) -> None:
    """Refuse the first of the names that is not known.

    kind: as in `unknown`.
    """
    for name in names:
        if name not in known:
            raise unknown(kind, name, known)


def said(error: BaseException) -> str:
    """`ValueError: no such lane`: an exception in words, ready to be followed by a full stop.

    Where the exception names an attribute that an object of this package lacks, the words offer the
    same attribute of the object's ego, or else the nearest name that the object has.
    """
    text = words_of(error).strip().rstrip(".")
    if (
        isinstance(error, AttributeError)
        and type(error.obj).__module__.startswith("sumo_eval.")
        and error.name
    ):
        near = nearest(error.name, [name for name in dir(error.obj) if not name.startswith("_")])
        if hasattr(getattr(error.obj, "ego", None), error.name):
            near = f"ego.{error.name}"
        text += f" (did you mean `{near}`?)" if near else ""
    return f"{kind_of(error)}: {text}" if text else kind_of(error)
