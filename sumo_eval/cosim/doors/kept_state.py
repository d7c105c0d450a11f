"""State that an ADS keeps outside its objects, so that its cases share it.

Each case has an object of its own, but cases share globals of modules, attributes of classes and
functions, closures, and the global random generators. Where a batch changes such state, its cases
may depend on each other.

Users: `cosim/simulation.py` compares the state before and after a batch (`kept_state`), drives an
ADS alone that uses libsumo (`reaches_libsumo`), and looks into an ADS's module (`module_of`).
"""

import inspect
import os
import pickle
import random
import re
import sys
from array import array
from collections import deque
from collections.abc import Iterator
from functools import cache
from itertools import islice
from pathlib import Path
from types import CellType, FunctionType, GeneratorType, MethodType, ModuleType
from typing import Any

import numpy as np

from sumo_eval.cosim.doors.traci_module import TRACI
from sumo_eval.cosim.sumo.insides import libsumo

State = dict[str, object]  # snapshots (`_frozen`) by name
# by id of an object: its number in the order of first sight, the least depth at which it was looked
# into, and the object itself, so that no other object gets its id
_Seen = dict[int, tuple[int, int, Any]]
_DEEPEST = 12  # containers and objects within each other that are looked into
_MOST = 10_000  # members of a container that are compared
_CONTAINERS = (dict, list, tuple, set, frozenset, deque)
_PLAIN = (type(None), bool, int, float, complex, str, bytes)
# packages whose objects are not looked into; neither are those of the standard library
_FOREIGN_PACKAGES = ("sumo_eval", "numpy", "numba", "traci", "libsumo")
# modules of the standard library whose objects are looked into, as they hold other objects
_LOOKED_INTO = ("types", "collections", "queue", "functools")
_LIBSUMO = "libsumo itself"  # snapshot of libsumo, and of a function of it
# arrays and random generators: the pickle of such an object holds its whole state
_PICKLED = (
    np.ndarray, bytearray, array, random.Random, np.random.Generator, np.random.RandomState
)  # fmt: skip
# name of a module that `settings.locators` has loaded from a file's path
_BY_PATH = re.compile(r"_sumo_eval_file_(.*)_\w{12}\.")
_ITERATOR = "itertools"  # module of `count` and `repeat`, whose `repr` shows their position
_INSTALLED = {"site-packages", "dist-packages"}  # folders of installed packages


def kept_state(ads: Any) -> State:
    """State outside the ADS's objects that its code can change, by name (`module.variable`,
    `file.py: variable`).

    ads: a class or a function.

    Not compared: module variables whose names begin with `__`, the code of functions, variables of
    foreign modules (`reached_modules`), members of a container beyond the first `_MOST`, slots of
    the user's own kind of container.

    Compared by identity alone:
    - objects of compiled code and of the standard library, except `_LOOKED_INTO` and `_PICKLED`;
    - iterators of containers and of itertools, whose position only a copy would show, except
      `count` and `repeat`;
    - objects deeper than `_DEEPEST`. Containers deeper than that are compared by length alone.
    """
    # state that all code of a process shares
    state: State = {
        "random": random.getstate(),
        "numpy.random": _frozen(np.random.get_state(), 0),  # noqa: NPY002 - what an ADS may use
        # numba sets variables of its own when its first function is compiled
        "os.environ": {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")},
        "the working directory": os.getcwd(),
        # ADSs may replace TraCI's functions
        "traci": [id(it) for part in (TRACI, *TRACI.DOMAINS) for it in vars(part).values()],
    }
    for module in reached_modules(ads):
        # `module.`; of a file that was loaded by its path `file.py: `
        prefix = _BY_PATH.sub(r"\1.py: ", f"{module.__name__}.")
        variables = list(vars(module).items())  # a list: a property of the user's may add some
        state |= {f"{prefix}{k}": _frozen(v, 0) for k, v in variables if k[:2] != "__"}
    own_code = ads.__mro__[:-1] if inspect.isclass(ads) else (ads,)  # classes without `object`
    by_name: dict[str, list[object]] = {}  # lists: a derived class may have the name of its base
    for code in own_code:
        by_name.setdefault(code.__qualname__, []).append(_frozen(code, 0))
    return state | by_name


def reaches_libsumo(ads: Any, made: Any) -> bool:
    """Whether an ADS's code can use libsumo itself, instead of the view that shows each case only
    its own vehicles.

    made: an object of the ADS.
    """
    return _holds_libsumo([_frozen(made, 0), *kept_state(ads).values()])


def _holds_libsumo(snapshot: Any) -> bool:
    """Whether a snapshot, or a part of it, is that of libsumo."""
    return snapshot == _LIBSUMO or (
        isinstance(snapshot, list | tuple) and any(map(_holds_libsumo, snapshot))
    )


def reached_modules(ads: Any) -> list[ModuleType]:
    """The module of an ADS and all modules that it uses, directly or not.

    Installed packages are left out, except the ADS's own.
    """
    own = (ads.__module__ or "").partition(".")[0]  # code of `exec` may have no module
    reached = {}
    waiting = [ads]  # modules, and values whose modules are looked into
    while waiting:
        value = waiting.pop()
        module = value if _is(value, ModuleType) else module_of(value)
        if module is None or module.__name__ in reached:
            continue
        name = module.__name__
        file = getattr(module, "__file__", None)
        if file is None or _is_foreign(name):
            continue
        if not _INSTALLED.isdisjoint(Path(file).parts) and name.partition(".")[0] != own:
            continue
        reached[name] = module
        # the values of a module lead to the modules that define them
        waiting += vars(module).values()
    return list(reached.values())


def _is(value: Any, kinds: Any) -> bool:
    """`isinstance` by the value's type. `isinstance` itself also asks for `__class__`, which may be
    the user's code and raise an error: that of a proxy without an object does.
    """
    return issubclass(type(value), kinds)


def _is_foreign(module: str) -> bool:
    """Whether a module is of the standard library or of `_FOREIGN_PACKAGES`."""
    package = module.partition(".")[0]
    return package in _FOREIGN_PACKAGES or package in sys.stdlib_module_names


def module_of(value: Any) -> ModuleType | None:
    """The module that defines a function, a class or an object's class; None: unknown.

    A module that was loaded from a file's path may be missing in `sys.modules`, and a module may
    have put another object there. The result then has the variables that one of its functions sees.
    """
    kind = value if _is(value, type | FunctionType) else type(value)
    module = sys.modules.get(kind.__module__)
    if _is(module, ModuleType):  # code may put any other object there
        return module
    function = next(
        (it for it in (kind, *vars(kind).values()) if isinstance(it, FunctionType)), None
    )
    if function is None:
        return None
    module = ModuleType(function.__module__ or "")
    module.__dict__.update(function.__globals__)
    return module


def first_change(before: State, after: State) -> str | None:
    """Name of the first state that differs; None: all of it is the same."""
    # `...` stands for a name that is missing: None may be a value
    return next((it for it in before | after if before.get(it, ...) != after.get(it, ...)), None)


def _frozen(value: Any, depth: int, seen: _Seen | None = None) -> object:
    """A snapshot of a value, to compare with a later one; it does not change with the value.

    An object that it holds many times, or that contains itself, is looked into once: elsewhere its
    number stands for it.

    depth: number of containers and objects around the value.
    seen: the objects so far.
    """
    if _is(value, _PLAIN):
        return "nan" if value != value else value
    if seen is None:
        seen = {}
    # a new object gets the next number, and a depth below all that occur (`_DEEPEST` + 1)
    number, least, _ = seen.get(id(value), (len(seen), _DEEPEST + 2, None))
    if depth >= least:
        return "seen", number
    seen[id(value)] = number, depth, value
    identity = id(value)
    is_container = _is(value, _CONTAINERS)
    try:
        if is_container:  # not by its id: `_parts` makes new containers for each snapshot
            identity = len(value)
        if depth > _DEEPEST:
            return identity
        if content := _content(value):
            return content
        parts = [*_members(value)] if is_container else [*_parts(value)]
        if is_container and hasattr(value, "__dict__"):  # a kind of the user's own
            parts.append(dict(vars(value)))
    except Exception:  # noqa: BLE001 - methods and attributes of a user's object are user's code
        return identity
    return identity, [_frozen(it, depth + 1, seen) for it in parts]


def _members(container: Any) -> Iterator[Any]:
    """The first members of a container; of a dict, its items."""
    return islice(container.items() if isinstance(container, dict) else container, _MOST)


def _content(value: Any) -> object:
    """State of a value that has no parts to look into: an array, a random generator, a cache, an
    iterator, libsumo; None for any other value.
    """
    if value is libsumo or (
        isinstance(value, FunctionType) and value.__module__ == "libsumo.libsumo"
    ):
        return _LIBSUMO
    if isinstance(value, _PICKLED):
        return pickle.dumps(value)
    if hasattr(type(value), "cache_info"):
        return id(value), repr(value.cache_info())
    return repr(value) if type(value).__module__ == _ITERATOR else None


def _parts(value: Any) -> tuple[Any, ...]:
    """Parts of an object, class or function that can change; none if its code is foreign.

    The functions of a `property` are not looked into.
    """
    if isinstance(value, staticmethod | classmethod | MethodType):
        return value.__func__, getattr(value, "__self__", None)
    if isinstance(value, GeneratorType):
        frame = value.gi_frame
        return () if frame is None else (frame.f_lasti, dict(frame.f_locals))
    kind = value if isinstance(value, type | FunctionType) else type(value)
    module = kind.__module__ or ""
    # of foreign code only objects are looked into, and only those of the modules `_LOOKED_INTO`
    is_object = kind is not value
    if _is_foreign(module) and not (is_object and module in _LOOKED_INTO):
        return ()
    if isinstance(value, FunctionType):
        # variables of a closure; an empty cell is one without a value yet
        cells = [it.cell_contents for it in value.__closure__ or () if it != CellType()]
        return vars(value), value.__defaults__, value.__kwdefaults__, cells
    # an object keeps slots outside its `__dict__`; a class has them as entries of its own
    slots = [getattr(value, name, None) for name in _slots(kind) if is_object]
    return dict(getattr(value, "__dict__", {})), slots


@cache
def _slots(kind: type) -> list[str]:
    """Names of the slots of a class's objects."""
    return [name for name, it in inspect.getmembers_static(kind) if inspect.ismemberdescriptor(it)]
