"""OpenSCENARIO files as XML: every fault with file, line and element."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

from sumo_eval.errors import InputError, did_you_mean
from sumo_eval.input_file import input_file
from sumo_eval.scenario.xml_file import Element, read_xml
from sumo_eval.text import shown

_VERSIONS = ("1.0", "1.1", "1.2", "1.3")


@lru_cache(maxsize=64)
def _read_once(path: Path, changed: int) -> Element:
    root = read_xml(path, "OpenSCENARIO file")
    if root.tag != "OpenSCENARIO":
        raise InputError(f"OpenSCENARIO file {path}: its root must be <OpenSCENARIO>, got <{root.tag}>.")
    header = root.find("FileHeader")
    if header is None:
        raise InputError(f"OpenSCENARIO file {path}: <FileHeader> is missing.")
    version = f"{header.get('revMajor', '?')}.{header.get('revMinor', '?')}"
    if version not in _VERSIONS:
        raise fault(header, f"its version must be one of {', '.join(_VERSIONS)}, got {shown(version)}")
    return root


def read_openscenario(path: Path) -> Element:
    """The root of an OpenSCENARIO file of a version that is known."""
    return _read_once(path, input_file(path, "OpenSCENARIO file").stat().st_mtime_ns)


def version_of(root: Element) -> str:
    """`1.3`."""
    header = child(root, "FileHeader")
    return f"{header.get('revMajor')}.{header.get('revMinor')}"


def file_of(element: Element) -> Path:
    """The file that an element was read from."""
    return Path(str(element.getroottree().docinfo.URL))


def where(element: Element) -> str:
    """`CCRs.xosc, line 120, <SpeedAction>`."""
    return f"{file_of(element).name}, line {element.sourceline}, <{element.tag}>"


def fault(element: Element, text: str) -> InputError:
    """A sentence on what is wrong with an element. text: `value must be a number, got 'x'`."""
    return InputError(f"{where(element)}: {text}{'' if text.endswith('?') else '.'}")


def not_played(element: Element, among: str = "") -> InputError:
    """A sentence that an element is one that is not played."""
    rest = f": {among}" if among else ""
    return fault(element, f"this is not played{rest}, and nothing is guessed in its place")


def children(element: Element) -> list[Element]:
    """The elements inside one, without comments."""
    return [part for part in element if isinstance(part.tag, str)]


def only(element: Element) -> Element:
    """The one element inside another."""
    found = children(element)
    if len(found) != 1:
        raise fault(element, f"it must hold one element, got {len(found)}")
    return found[0]


def child(element: Element, name: str) -> Element:
    """The element of a name inside another; refused where it is missing."""
    found = element.find(name)
    if found is None:
        raise fault(element, f"<{name}> is missing in it")
    return found


def attribute(element: Element, name: str) -> str:
    """An attribute as it is written; refused where it is missing."""
    found = element.get(name)
    if found is None:
        raise fault(element, f"`{name}` is missing")
    return str(found)


def decimal(element: Element, name: str) -> float:
    """An attribute of a format without parameters, as a finite number."""
    try:
        value = float(attribute(element, name))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise fault(element, f"`{name}` must be a finite number, got {element.get(name)}")
    return value


def one_of(element: Element, name: str, known: tuple[str, ...], default: str | None = None) -> str:
    """An attribute that must be one of some words."""
    found = element.get(name) if default is not None else attribute(element, name)
    if found is None:
        assert default is not None
        return default
    if found not in known:
        near = did_you_mean(found, known)
        raise fault(element, f"`{name}` must be one of {', '.join(known)}, got {shown(found)}.{near}"
                    .rstrip("."))  # fmt: skip
    return str(found)
