"""Catalogs of OpenSCENARIO: folders of files with entries, such as vehicles or manoeuvres.

A reference names a catalog and one of its entries. Public catalogues of scenario files are another
thing: `extras/openscenario/collections.py`.

Users: `extras/openscenario/places.py`, `extras/openscenario/scene.py`,
`extras/openscenario/space.py`.
"""

from dataclasses import replace
from functools import cached_property
from os.path import realpath
from pathlib import Path

from sumo_eval.errors import did_you_mean
from sumo_eval.extras.openscenario.reading import Node, read_openscenario, watch
from sumo_eval.groups import grouped


class Catalogs:
    """The catalogs of a scenario file.

    root: of that file.
    folders: <Directory> elements, each with the path of its folder.
    """

    def __init__(self, root: Node) -> None:
        directories = [part.child("Directory") for part in root.all("CatalogLocations/*")]
        self.folders = [(it, it.file.parent / it.text("path")) for it in directories]

    @cached_property
    def _all(self) -> dict[str, list[Node]]:
        """The catalogs by name; where several files have a catalog of one name, all count."""
        for _, at in self.folders:
            watch(at)  # adding a file changes the folder, so scenes are read again
        # one folder may be named for several kinds of catalogs: its files count once
        files = dict.fromkeys(
            Path(realpath(it)) for _, at in self.folders for it in sorted(at.glob("*.xosc"))
        )
        catalogs = (it for file in files for it in read_openscenario(file).all("Catalog"))
        return grouped((it.attribute("name"), it) for it in catalogs)

    def entry(self, reference: Node) -> Node:
        """The entry that a <CatalogReference> names, with the values that the reference gives to
        its parameters.
        """
        name, entry = reference.text("catalogName"), reference.text("entryName")
        catalogs = self._all
        if name not in catalogs:
            near = did_you_mean(name, catalogs)
            missing = "; ".join(
                f"{it.where}: the folder {at} of its catalogs is "
                f"{'a file' if at.is_file() else 'not there'}"
                for it, at in self.folders
                if not at.is_dir()
            )
            raise reference.fault(f"catalog `{name}` is not there.{near} {missing}".rstrip())
        entries = [it for catalog in catalogs[name] for it in catalog.children()]
        same_name = [it for it in entries if it.get("name") == entry]
        if not same_name:
            near = did_you_mean(entry, [str(it.get("name")) for it in entries])
            raise reference.fault(f"entry `{entry}` is not in catalog `{name}`.{near}")
        if len(same_name) > 1:
            places = ", ".join(it.where for it in same_name)
            raise reference.fault(
                f"entry `{entry}` of catalog `{name}` is there more than once: {places}"
            )
        if (name, entry) in reference.entries:
            raise reference.fault(f"entry `{entry}` of catalog `{name}` refers to itself")
        assigned = {
            it.parameter("parameterRef"): it.worked_out(it.attribute("value"))
            for it in reference.all("ParameterAssignments/ParameterAssignment")
        }
        part, broken = same_name[0].declared(assigned)
        if broken:
            raise reference.fault(f"a value that it gives breaks a constraint: {broken[0]}")
        return replace(part, entries=(*reference.entries, (name, entry)))

    def held(self, holder: Node, name: str) -> Node:
        """The element inside `holder`, or the one that its <CatalogReference> names."""
        reference = holder.find("CatalogReference")
        if not reference:
            return holder.child(name)
        part = self.entry(reference)
        if part.tag != name:
            raise reference.fault(f"the entry must be a <{name}>, got <{part.tag}>")
        return part


def named_file(part: Node, name: str | None = None) -> Path:
    """A file that an element names, relative to the element's own file.

    name: path that the user gives instead; None: the element's `filepath`.

    Raises InputError where the file is missing.
    """
    path = part.file.parent / (part.text("filepath") if name is None else name)
    if watch(path) < 0:  # its time of change: -1 without a file
        raise part.fault(f"the file {path} is not there")
    return path
