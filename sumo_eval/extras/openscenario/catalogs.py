"""Catalogs: directories of files with entries, found by the catalog's name and the entry's."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from sumo_eval.errors import did_you_mean
from sumo_eval.extras.openscenario.reading import Node, read_openscenario


@dataclass(slots=True)
class Catalogs:
    """The catalogs of a scenario file.

    locations: its <CatalogLocations>, None where it has none.
    """

    locations: Node | None
    _missing: list[str] = field(default_factory=list)
    _found: dict[str, list[Node]] | None = None

    def _all(self) -> dict[str, list[Node]]:
        """The catalogs by name; several files may have one of a name."""
        if self._found is not None:
            return self._found
        found: dict[str, list[Node]] = {}
        seen: set[Path] = set()
        for location in [] if self.locations is None else self.locations.children():
            directory = location.child("Directory")
            folder = location.file.parent / directory.text("path")
            if not folder.is_dir():
                self._missing.append(
                    f"{directory.where}: the folder {folder} of its catalogs is not there"
                )
            for file in sorted(folder.glob("*.xosc")):
                if file.resolve() in seen:  # one folder may be named for several kinds of catalogs
                    continue
                seen.add(file.resolve())
                catalog = read_openscenario(file).find("Catalog")
                if catalog is not None:
                    found.setdefault(catalog.attribute("name"), []).append(catalog)
        self._found = found
        return found

    def entry(self, reference: Node) -> Node:
        """The entry that a <CatalogReference> names, with the values that its parameters have
        there.
        """
        name, entry = reference.text("catalogName"), reference.text("entryName")
        catalogs = self._all()
        if name not in catalogs:
            near = did_you_mean(name, catalogs)
            missing = "; ".join(self._missing)
            raise reference.fault(f"catalog `{name}` is not there.{near}{missing and ' '}{missing}")
        entries: dict[str, list[Node]] = {}
        for part in (it for catalog in catalogs[name] for it in catalog.children()):
            entries.setdefault(str(part.get("name")), []).append(part)
        if entry not in entries:
            raise reference.fault(
                f"entry `{entry}` is not in catalog `{name}`.{did_you_mean(entry, entries)}"
            )
        if len(entries[entry]) > 1:
            places = ", ".join(part.where for part in entries[entry])
            raise reference.fault(
                f"entry `{entry}` of catalog `{name}` is there more than once: {places}"
            )
        if (name, entry) in reference.entries:
            raise reference.fault(f"entry `{entry}` of catalog `{name}` refers to itself")
        given = {
            part.attribute("parameterRef").removeprefix("$"): part.worked_out(
                part.attribute("value")
            )
            for part in reference.all("ParameterAssignments/ParameterAssignment")
        }
        found, broken = entries[entry][0].declared(given)
        if broken:
            raise reference.fault(f"a value that it gives breaks a constraint: {broken[0]}")
        return replace(found, entries=(*reference.entries, (name, entry)))

    def held(self, holder: Node, name: str) -> Node:
        """The thing that stands in `holder`, or that its <CatalogReference> names."""
        reference = holder.find("CatalogReference")
        if reference is None:
            return holder.child(name)
        found = self.entry(reference)
        if found.tag != name:
            raise reference.fault(f"the entry must be a <{name}>, got <{found.tag}>")
        return found


def named_file(part: Node) -> Path:
    """A file that an element names, relative to its own; refused where it is not there."""
    path = part.file.parent / part.text("filepath")
    if not path.exists():
        raise part.fault(f"the file {path} is not there")
    return path
