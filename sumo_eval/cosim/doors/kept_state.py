"""State that an ADS keeps outside its objects, where its cases share it.

One object a case keeps cases apart. A global of a module, an attribute of a class or a function, a
closure and the global random generators do not.
"""

from __future__ import annotations

import inspect
import os
import random
import sys
from collections import deque
from itertools import islice
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

_DEEPEST = 12  # containers and objects within each other
_MOST = 10_000  # members of a container, the rest of which is not looked at
_CONTAINERS = (dict, list, tuple, set, frozenset, deque)
_PLAIN = (type(None), bool, int, float, complex, str, bytes)
_NOT_ITS_OWN = ("sumo_eval", "numpy", "traci", "libsumo")  # packages, beside Python's own
_ITERATOR = "itertools"  # whose objects show where they are


def kept_state(ads: Any) -> dict[str, object]:
    """State beside its objects that code of an ADS can change, by the names that it has there.

    ads: a class or a function, whose module's folder holds the code.
    """
    state = _of_process()
    for module in reached_modules(ads):
        own = [(k, v) for k, v in list(vars(module).items()) if not k.startswith("__")]
        state |= {f"{module.__name__}.{name}": _frozen(value, 0) for name, value in own}
    for kind in ads.__mro__[:-1] if inspect.isclass(ads) else (ads,):
        state[kind.__qualname__] = _frozen(kind, 0)
    return state


def reached_modules(ads: Any) -> list[ModuleType]:
    """The module of an ADS and those that it uses, by way of others too.

    Installed packages are left out, except the ADS's own.
    """
    own = ads.__module__.partition(".")[0]
    reached, waiting = dict[str, ModuleType](), [ads]
    while waiting:
        it = waiting.pop()
        module = it if isinstance(it, ModuleType) else _module_of(it)
        if module is None or module.__name__ in reached:
            continue
        root, file = module.__name__.partition(".")[0], getattr(module, "__file__", None)
        known = root in _NOT_ITS_OWN or root in sys.stdlib_module_names
        if known or file is None or ("site-packages" in file and root != own):
            continue
        reached[module.__name__] = module
        waiting += vars(module).values()
    return list(reached.values())


def _module_of(value: Any) -> ModuleType | None:
    """Where a function, a class or an object's class is defined.

    A file that was loaded by its path may be in no table.
    """
    code = value if isinstance(value, type | FunctionType) else type(value)
    if code.__module__ in sys.modules:
        return sys.modules[code.__module__]
    function = next(
        (it for it in (code, *vars(code).values()) if isinstance(it, FunctionType)), None
    )
    if function is None:
        return None
    module = ModuleType(function.__module__)
    module.__dict__.update(function.__globals__)
    return module


def _of_process() -> dict[str, object]:
    """State that all code of a process shares."""
    return {
        "random": random.getstate(),
        "numpy.random": _frozen(np.random.get_state(), 0),  # noqa: NPY002 - what an ADS may use
        # numba sets its own when its first function is compiled
        "os.environ": {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")},
        "the working directory": os.getcwd(),
    }


def first_change(before: dict[str, object], after: dict[str, object]) -> str | None:
    """Name of the first state that differs; None: all of it is the same."""
    names = [*before, *(name for name in after if name not in before)]
    return next((name for name in names if before.get(name, ...) != after.get(name, ...)), None)


def _frozen(value: Any, depth: int, seen: frozenset[int] = frozenset()) -> object:
    """A value as something that later changes of it do not reach.

    seen: the containers and objects that it is in, by id.
    """
    if isinstance(value, _PLAIN):
        return value
    contains = isinstance(value, _CONTAINERS)
    # containers may be of this look's own making
    name = len(value) if contains else id(value)
    if depth > _DEEPEST or id(value) in seen:
        return name
    stream = _stream(value)
    if stream is not None:
        return stream
    within = seen | {id(value)}
    members = value.items() if isinstance(value, dict) else value
    parts = islice(members, _MOST) if contains else _parts(value)
    return name, [_frozen(it, depth + 1, within) for it in parts]


def _stream(value: Any) -> object:
    """Content of an array, or place of a generator, an iterator or a cache; None: neither."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, random.Random):
        return value.getstate()
    if isinstance(value, np.random.Generator):
        return repr(value.bit_generator.state)
    if isinstance(value, np.random.RandomState):
        return _frozen(value.get_state(), 0)
    if hasattr(value, "cache_info"):
        return id(value), repr(value.cache_info())
    return repr(value) if type(value).__module__ == _ITERATOR else None


def _parts(value: Any) -> tuple[Any, ...]:
    """Parts of an object, class or function that can change; none of what is not the ADS's."""
    kind = value if isinstance(value, type | FunctionType) else type(value)
    root = (kind.__module__ or "").partition(".")[0]
    if root in _NOT_ITS_OWN or root in sys.stdlib_module_names:
        return ()
    if isinstance(value, FunctionType):
        cells = [_cell(it) for it in value.__closure__ or ()]
        return vars(value), value.__defaults__, value.__kwdefaults__, cells
    return (dict(getattr(value, "__dict__", {})),)


def _cell(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not yet filled
        return None
