"""Catalogs: directories of files with entries, found by the catalog's name and the entry's."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from sumo_eval.errors import did_you_mean
from sumo_eval.extras.openscenario.reading import (
    attribute,
    child,
    children,
    fault,
    file_of,
    read_openscenario,
    where,
)  # fmt: skip
from sumo_eval.extras.openscenario.values import Scope, Value, declared, text, worked_out
from sumo_eval.scenario.xml_file import Element


@dataclass(slots=True)
class Catalogs:
    """The catalogs of a scenario file. locations: its <CatalogLocations>, None where it has none."""

    locations: Element | None
    scope: Scope
    _found: dict[str, list[Element]] | None = None
    _open: list[tuple[str, str]] = field(default_factory=list)

    def _all(self) -> dict[str, list[Element]]:
        """The catalogs by name; several files may have one of a name."""
        if self._found is not None:
            return self._found
        found: dict[str, list[Element]] = {}
        seen: set[Path] = set()
        for location in [] if self.locations is None else children(self.locations):
            directory = child(location, "Directory")
            folder = file_of(location).parent / text(directory, "path", self.scope)
            if not folder.is_dir():
                raise fault(directory, f"the folder {folder} of its catalogs is not there")
            for file in sorted(folder.glob("*.xosc")):
                if file.resolve() in seen:  # one folder may be named for several kinds of catalogs
                    continue
                seen.add(file.resolve())
                catalog = read_openscenario(file).find("Catalog")
                if catalog is not None:
                    found.setdefault(attribute(catalog, "name"), []).append(catalog)
        self._found = found
        return found

    def entry(self, reference: Element, scope: Scope) -> tuple[Element, Scope]:
        """The entry that a <CatalogReference> names, and the values that its parameters have there."""
        name, entry = text(reference, "catalogName", scope), text(reference, "entryName", scope)
        catalogs = self._all()
        if name not in catalogs:
            raise fault(reference, f"catalog `{name}` is not there.{did_you_mean(name, catalogs)}".rstrip("."))
        entries: dict[str, list[Element]] = {}
        for part in (it for catalog in catalogs[name] for it in children(catalog)):
            entries.setdefault(str(part.get("name")), []).append(part)
        if entry not in entries:
            raise fault(
                reference, f"entry `{entry}` is not in catalog `{name}`.{did_you_mean(entry, entries)}".rstrip(".")
            )
        if len(entries[entry]) > 1:
            places = ", ".join(where(part) for part in entries[entry])
            raise fault(reference, f"entry `{entry}` of catalog `{name}` is there more than once: {places}")
        if (name, entry) in self._open:
            raise fault(reference, f"entry `{entry}` of catalog `{name}` refers to itself")
        given: dict[str, Value] = {}
        for part in reference.iterfind("ParameterAssignments/ParameterAssignment"):
            given[attribute(part, "parameterRef").removeprefix("$")] = worked_out(attribute(part, "value"), scope, part)
        found = entries[entry][0]
        inner, broken = declared(found.find("ParameterDeclarations"), given)
        if broken:
            raise fault(reference, f"a value that it gives breaks a constraint: {broken[0]}")
        return found, inner

    def enter(self, reference: Element, scope: Scope) -> tuple[str, str]:
        """Mark an entry as being read, so that one that refers to itself is found out."""
        key = (text(reference, "catalogName", scope), text(reference, "entryName", scope))
        self._open.append(key)
        return key

    def leave(self) -> None:
        """The entry that was marked last is read."""
        self._open.pop()


def named_file(element: Element, scope: Scope, name: str = "filepath") -> Path:
    """A file that an element names, relative to its own; refused where it is not there."""
    path = file_of(element).parent / text(element, name, scope)
    if not path.exists():
        raise fault(element, f"the file {path} is not there")
    return path
