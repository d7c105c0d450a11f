"""Catalogs: directories of files with entries, found by the catalog's name and the entry's.

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
    folders: each <Directory> with its path.
    """

    def __init__(self, root: Node) -> None:
        directories = [part.child("Directory") for part in root.all("CatalogLocations/*")]
        self.folders = [(it, it.file.parent / it.text("path")) for it in directories]

    @cached_property
    def _all(self) -> dict[str, list[Node]]:
        """The catalogs by name; files may share a name, and then all their entries count."""
        for _, at in self.folders:
            watch(at)  # adding a file changes the folder, and then scenes are read again
        # one folder may be named for several kinds of catalogs
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
                f"{it.where}: the folder {at} of its catalogs is not there"
                for it, at in self.folders
                if not at.is_dir()
            )
            raise reference.fault(f"catalog `{name}` is not there.{near} {missing}".rstrip())
        parts = [it for catalog in catalogs[name] for it in catalog.children()]
        named = [part for part in parts if part.get("name") == entry]
        if not named:
            near = did_you_mean(entry, [str(part.get("name")) for part in parts])
            raise reference.fault(f"entry `{entry}` is not in catalog `{name}`.{near}")
        if len(named) > 1:
            places = ", ".join(part.where for part in named)
            raise reference.fault(
                f"entry `{entry}` of catalog `{name}` is there more than once: {places}"
            )
        # (catalog, entry) of the references that led here: the same one again is a circle
        if (name, entry) in reference.entries:
            raise reference.fault(f"entry `{entry}` of catalog `{name}` refers to itself")
        assigned = {
            it.parameter("parameterRef"): it.worked_out(it.attribute("value"))
            for it in reference.all("ParameterAssignments/ParameterAssignment")
        }
        # the entry with these parameters, and the constraints that they break
        part, broken = named[0].declared(assigned)
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
    """A file that an element or else the user names, relative to the element's own; refused where
    it is not there.
    """
    path = part.file.parent / (part.text("filepath") if name is None else name)
    if watch(path) < 0:  # its time of change: -1 without a file
        raise part.fault(f"the file {path} is not there")
    return path
