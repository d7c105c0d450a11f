"""Errors that this package raises on purpose, and their messages, for all of its code.

A message says what must be true and what was found, and offers the nearest known name:
"`gap` of scenario `cut_in` must be within 0..100 m, got 120."

Users: `ads/`, `cli/`, `cosim/`, `drivers/`, `evaluation.py`, `gone.py`, `input_file.py`, `method/`,
`nightly/`, `record/`, `report/`, `results.py`, `scenario/`, `scoring/`, `settings/`,
`trajectory.py`, `whatif/`, `extras/`.
"""

import bisect
import difflib
import itertools
import os
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager

from sumo_eval.text import SENTENCE, WORDS, clean, kind_of, shown, words_of


class SumoEvalError(Exception):
    """Base of all errors that this package raises on purpose; its text is for the user."""


class InputError(SumoEvalError, ValueError):
    """The user's input cannot be used (exit status 2)."""


class NotInstalledError(InputError, ImportError):
    """A library cannot be loaded.

    It is an ImportError too, because Python's fork server ignores ImportErrors while it imports
    modules in advance.
    """


class ControllerError(SumoEvalError):
    """The ADS under test raised or returned no command; `cosim.loop` ends the drive with it."""


class ControllerTimeoutError(ControllerError):
    """The ADS under test took longer over one step than it may."""


class SimulationError(SumoEvalError):
    """SUMO refused a request of this package, or lost a vehicle of the simulation."""


class StoppedError(SumoEvalError):
    """The work was stopped on request, by Ctrl-C or SIGTERM.

    Its text says what is kept and how to continue.
    """


MOST_KNOWN = 800  # characters of a list of known names; a run may have a million cases
LEAST_ALIKE = 0.55  # similarity of difflib, 0..1, from which a name is offered


def nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name that is most similar to a misspelt one, None where none is similar.

    The answer is that of `difflib.get_close_matches`, but it comes faster for a hundred thousand
    known names. The known name with the longest common beginning is compared first. After that,
    quick upper bounds of the similarity rule out most other names.
    """
    if not known:
        return None
    matcher = difflib.SequenceMatcher(b=name)
    best, near = LEAST_ALIKE, ""  # highest similarity so far, and its name
    # `commonprefix` compares texts letter by letter, although it is in `os.path`
    first = max(known, key=lambda it: len(os.path.commonprefix([it, name])))  # noqa: RUF071
    for candidate in itertools.chain((first,), known):
        matcher.set_seq1(candidate)
        # both are upper bounds of `ratio`, the first the quicker one
        if matcher.real_quick_ratio() >= best and matcher.quick_ratio() >= best:
            # of two equally similar names, the later one in the alphabet
            best, near = max((best, near), (matcher.ratio(), candidate))
    return near or None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Last sentence of a message: the nearest known name, or the known names if none is near."""
    names = list(map(str, known))
    near = nearest(name, names)
    if near is not None:
        return f" Did you mean `{near}`?"
    # length of the list after each name; names are cut to `WORDS` characters, so two always fit
    ends = list(itertools.accumulate(len(it[:WORDS]) + len(", ") for it in names))
    fitting = bisect.bisect(ends, MOST_KNOWN)
    listed = ", ".join(it[:WORDS] for it in names[:fitting])
    if fitting < len(names):
        listed += f" and {len(names) - fitting} more"
    return f" Known: {listed}." if names else ""


def must_be(what: str, owner: str, requirement: str, got: object) -> InputError:
    """Make the error "`gap` of scenario `cut_in` must be within 0..100 m, got 120."

    what: "`gap`".
    owner: "scenario `cut_in`".
    requirement: "within 0..100 m".
    got: the value that was found.
    """
    return InputError(f"{what} of {owner} must be {requirement}, got {shown(got)}.")


def needs_extra(what: str, extra: str) -> InputError:
    """Make the error "An FMU needs the extra `fmu`, which this installs: python -m pip install
    '/home/me/sumo_eval[fmu]'".
    """
    return InputError(
        f"{what} needs the extra `{extra}`, which this installs: {install_command(extra)}"
    )


def install_command(extra: str) -> str:
    """The command that installs an extra of this package into the running Python.

    It names the folder or address that the package itself was installed from.
    """
    import json
    import shlex
    import sys
    from importlib.metadata import PackageNotFoundError, distribution
    from pathlib import Path
    from urllib.parse import unquote

    name = f"sumo_eval[{extra}]"
    editable = ""
    try:
        # pip writes this file unless the package came from a package index
        origin = json.loads(distribution("sumo_eval").read_text("direct_url.json") or "{}")
    except PackageNotFoundError:  # run from its sources without being installed
        origin = {"url": Path(__file__).parents[1].as_uri(), "dir_info": {"editable": True}}
    url = str(origin.get("url", ""))
    if "dir_info" in origin and url.startswith("file://"):
        name = f"{unquote(url.removeprefix('file://'))}[{extra}]"
        editable = "-e " if origin["dir_info"].get("editable") else ""
    elif url:
        # of a repository, pip keeps the address without the kind and the commit that it needs
        if repository := origin.get("vcs_info"):
            url = f"{repository['vcs']}+{url}@{repository['commit_id']}"
        if "subdirectory" in origin:
            url += f"#subdirectory={origin['subdirectory']}"
        name = f"{name} @ {url}"
    return f"{shlex.quote(sys.executable)} -m pip install {editable}{shlex.quote(name)}"


def check_name(owner: str, name: str) -> None:
    """Refuse a `name` that a table, a file or a terminal could not show as it is."""
    if clean(name) != name:
        raise must_be(
            "`name`", owner, f"one line of at most {SENTENCE} characters that can be shown", name
        )


def check_vehicle_name(owner: str, name: str) -> None:
    """Refuse a `name` that SUMO does not accept for a vehicle."""
    check_name(owner, name)
    if re.search(r"""[\s|\\'";,<>&]""", name):
        raise must_be("`name`", owner, """without spaces and | \\ ' " ; , < > &""", name)


def unknown(kind: str, name: str, known: Iterable[str]) -> InputError:
    """Make the error "Unknown parameter `gpa` of scenario `cut_in`. Did you mean `gap`?".

    kind: "parameter of scenario `cut_in`"; without an owner: "parameter".
    name: "gpa".
    """
    # group 1: "parameter"; group 2: " of scenario `cut_in`"; a last colon of `kind` is left out
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


def doubled(names: Iterable[str]) -> list[str]:
    """The names that occur more than once, in their order."""
    return [name for name, number in Counter(names).items() if number > 1]


def said(error: BaseException) -> str:
    """Words for an exception, as `ValueError: no such lane`, without a full stop at the end.

    If an object of this package lacks an attribute, the words offer another: `ego.NAME` where the
    object's ego has that attribute, else the object's attribute of the nearest name.
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


@contextmanager
def users_code(what: str, *stay: type[Exception]) -> Iterator[None]:
    """A block that runs code of a user or of another package. Each exception of that code becomes
    an InputError; only Ctrl-C (KeyboardInterrupt) is raised unchanged.

    what: begins the error message, ``Sampler `my.py:points` failed`` for example.
    stay: further exceptions that are raised unchanged.
    """
    try:
        yield
    except BaseException as error:
        if isinstance(error, (KeyboardInterrupt, *stay)):
            raise
        raise InputError(f"{what}: {said(error)}.") from error
