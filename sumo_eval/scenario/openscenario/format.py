"""What the entry point `xosc` of `sumo_eval.scenarios` brings: OpenSCENARIO files, catalogues and points."""

from __future__ import annotations

from sumo_eval.scenario.formats import Format
from sumo_eval.scenario.openscenario.collections import COLLECTIONS, entries_of
from sumo_eval.scenario.openscenario.logical import read_logical
from sumo_eval.scenario.sampling.openscenario_points import from_openscenario

FORMAT = Format(
    read=read_logical,
    expand=entries_of,
    catalogues=tuple(COLLECTIONS),
    samplings={"openscenario": (from_openscenario, frozenset({"file", "count"}))},
)
