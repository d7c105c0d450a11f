"""Public catalogues of OpenSCENARIO files, of which the user has a copy: their files in it.

An evaluation that names a catalogue or a file gets an entry for each file and road: `entries_of`,
which `scenario.formats` finds through `format.py`. The command `sumo-eval import` lists the files.

Users: `extras/openscenario/command.py`, `extras/openscenario/describe.py`,
`extras/openscenario/format.py`.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from sumo_eval.errors import InputError, must_be
from sumo_eval.extras.openscenario.logical import Read, read_file
from sumo_eval.frozen import frozen
from sumo_eval.scenario.catalogue import options_of
from sumo_eval.settings import ScenarioSettings


@frozen
class Collection:
    """A public catalogue.

    source: its repository on GitHub.
    folders: where its files may be below the user's copy, which may be the whole repository or a
        part of it. The first folder with files counts.
    pattern: of the names of its files.
    extra: patterns, below the same folder, of scenario files to which no file of `pattern` refers.
    """

    source: str
    folders: tuple[str, ...]
    pattern: str
    extra: tuple[str, ...] = ()

    def files(self, copy: Path) -> list[Path]:
        """The files of the catalogue.

        copy: the user's folder.

        Raises InputError where the folder has none.
        """
        patterns = self.pattern, *self.extra
        for folder in self.folders:
            files = [file for it in patterns for file in sorted((copy / folder).glob(it))]
            if files:
                return files
        raise must_be(
            "`folder`",
            f"the catalogue ({self.source})",
            f"one with {self.folders[0]}/{self.pattern}",
            str(copy),
        )


COLLECTIONS = {
    # the 15 scenarios of UN R157 and their variations
    "osc_alks": Collection(
        source="asam-oss/OSC-ALKS-scenarios",
        folders=("Scenarios/ALKS_Scenarios", "logical_scenarios", "."),
        pattern="*_variation.xosc",
        extra=("concrete_scenarios/*4_4_2*_template.xosc",),  # 4.4_2 has no variation file
    ),
    # Euro NCAP 2026, crash avoidance, frontal collisions, standard range
    "ncap_2026": Collection(
        source="vectorgrp/OSC-NCAP-scenarios",
        folders=(
            "OpenSCENARIO/NCAP/CA-FC_2026/Variations/StandardRange",
            "CA-FC_2026/Variations/StandardRange", "Variations/StandardRange", ".",
        ),
        pattern="*.xosc",
    ),
}  # fmt: skip
"""Catalogues by the name that `use` gives them."""


def entries_of(entry: ScenarioSettings, folder: Path) -> tuple[ScenarioSettings, ...]:
    """An entry for each file of a catalogue, and for each road of a file with several roads.

    folder: where relative paths start.
    """
    if entry.use in COLLECTIONS:
        return tuple(_of_collection(entry, folder))
    name, options = options_of(entry.use)
    if "road" in options:
        return (entry,)
    return tuple(replace(entry, use=use) for use, _ in uses_of(folder / name, entry.use))


def uses_of(path: Path, use: str) -> Iterator[tuple[str, Read]]:
    """Each road of an OpenSCENARIO file: an entry's `use` for this road, and the file as read.

    use: of the entry that names the file, with its options.
    """
    given = options_of(use)[1]
    first = read_file(path, given)
    if len(first.roads) == 1:
        yield use, first
        return
    for number in range(1, len(first.roads) + 1):
        road = {**given, "road": str(number)}
        yield f"{use}{'&' if '?' in use else '?'}road={number}", read_file(path, road)


def _of_collection(entry: ScenarioSettings, folder: Path) -> list[ScenarioSettings]:
    """The entries of a catalogue; the first one also has the files that are not supported."""
    if entry.folder is None:
        source = COLLECTIONS[entry.use].source
        raise InputError(f"Catalogue `{entry.use}` must have a `folder`: your copy of {source}.")
    copy = (folder / entry.folder).resolve()
    entries = []
    refused = {}
    for file in COLLECTIONS[entry.use].files(copy):
        try:
            entries += [replace(entry, use=use, folder=None) for use, _ in uses_of(file, str(file))]
        except InputError as error:
            refused[file.name] = str(error)
    if not entries:
        raise InputError(
            f"No file of catalogue `{entry.use}` in {copy} is supported; error of the first: "
            f"{next(iter(refused.values()))}"
        )
    return [replace(entries[0], not_played=refused), *entries[1:]]
