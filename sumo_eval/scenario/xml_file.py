"""Reader of XML files from outside, SUMO networks, OpenDRIVE and OpenSCENARIO: no network access,
no entities.

Users: `extras/openscenario/network.py`, `extras/openscenario/reading.py`,
`scenario/road/opendrive.py`, `scenario/sumo_network.py`.
"""

import re
from pathlib import Path

from lxml import etree

from sumo_eval.errors import InputError
from sumo_eval.input_file import read_input
from sumo_eval.text import shown

Element = etree._Element
LARGEST = 50_000_000  # bytes of a file
_DECLARES = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)


def read_xml(path: Path, what: str, largest: int = LARGEST) -> Element:
    """The root of an XML file of at most `largest` bytes.

    what: how error messages call the file.

    Raises InputError for what cannot or must not be read.
    """
    content = read_input(Path(path), what, largest)
    plain = content.replace(b"\0", b"")  # so that a declaration in UTF-16 is found, too
    declares = _DECLARES.search(plain)
    if declares:
        line = plain.count(b"\n", 0, declares.start()) + 1
        element = declares.group(1).decode().upper()
        raise InputError(
            f"{what} {path} must not declare a document type or entities, got <!{element}> in line "
            f"{line}: none is ever expanded here."
        )
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
    )
    try:
        root = etree.fromstring(content, parser, base_url=str(path))
    except etree.XMLSyntaxError as error:
        raise InputError(f"{what} {path} is not XML: {shown(str(error))}.") from error
    # a declaration in an encoding in which `_DECLARES` does not find it
    if root.getroottree().docinfo.internalDTD is not None:
        raise InputError(
            f"{what} {path} must not declare a document type or entities: none is ever expanded "
            "here."
        )
    # the default namespace of some writers: without it tags are as in all other files
    for element in root.iter("{*}*") if root.tag.startswith("{") else ():
        element.tag = etree.QName(element).localname
    return root
