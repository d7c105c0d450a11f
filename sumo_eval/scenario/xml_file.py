"""Reader of XML files from outside (SUMO networks, OpenDRIVE, OpenSCENARIO) that opens no network
connection and expands no entities.

Users: `extras/openscenario/reading.py`, `scenario/road/opendrive.py`, `scenario/sumo_network.py`.
"""

import re
from pathlib import Path

from lxml import etree

from sumo_eval.errors import InputError
from sumo_eval.input_file import read_input
from sumo_eval.text import shown

Element = etree._Element
LARGEST = 50_000_000  # bytes of a file, at most, unless the caller allows more
_DECLARATION = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)


def read_xml(path: Path, what: str, largest: int = LARGEST) -> Element:
    """The root of an XML file of at most `largest` bytes; its tags have no namespaces.

    what: how error messages call the file.

    Raises InputError for a file that cannot be read, is not XML, or declares entities.
    """
    content = read_input(Path(path), what, largest)
    _refuse_declarations(content, f"{what} {path}")
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
    )
    try:
        root = etree.fromstring(content, parser, base_url=str(path))
    except etree.XMLSyntaxError as error:
        raise InputError(f"{what} {path} is not XML: {shown(str(error))}.") from error
    # a declaration in an encoding in which `_DECLARATION` does not find it
    if root.getroottree().docinfo.internalDTD is not None:
        raise _declares(f"{what} {path}", "")
    # some writers give all elements a namespace: without it tags are as in all other files
    for element in root.iter("{*}*") if root.tag.startswith("{") else ():
        element.tag = etree.QName(element).localname
    return root


def _refuse_declarations(content: bytes, file: str) -> None:
    """Refuse a document type or an entity before any parser sees the file."""
    plain = content.replace(b"\0", b"")  # so that a declaration in UTF-16 is found, too
    if match := _DECLARATION.search(plain):
        line = plain.count(b"\n", 0, match.start()) + 1
        raise _declares(file, f", got <!{match[1].decode().upper()}> in line {line}")


def _declares(file: str, got: str) -> InputError:
    """The error of a file with a declaration; `got` says which."""
    return InputError(
        f"{file} must not declare a document type or entities{got}: none is ever expanded here."
    )
