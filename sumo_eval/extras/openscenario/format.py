"""Entry point `xosc` of `sumo_eval.scenarios`: OpenSCENARIO files, catalogues and points."""

from sumo_eval.extras.openscenario.collections import COLLECTIONS, entries_of
from sumo_eval.extras.openscenario.logical import read_file
from sumo_eval.extras.openscenario.points import from_openscenario
from sumo_eval.scenario.formats import Format

FORMAT = Format(
    read=lambda path, given: read_file(path, given).logical,
    expand=entries_of,
    catalogues=tuple(COLLECTIONS),
    # the sampling method, and the keys of [sampling] that it knows
    samplings={"openscenario": (from_openscenario, frozenset({"file", "count"}))},
)
