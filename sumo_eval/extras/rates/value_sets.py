"""What was learnt as an OpenSCENARIO ParameterValueDistribution.

Events are written as value sets, one a recorded event: the only distribution of the standard that
keeps how parameters go together.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lxml import etree

from sumo_eval.trajectory import FloatArray

DATE = "2022-01-01T00:00:00"  # the header needs one; what is written depends on the events alone


def value_sets(
    name: str,
    names: Sequence[str],
    rows: FloatArray,
    scenario: str,
    rate: tuple[float, float, float],
    path: Path,
) -> None:
    """Write events (n, k) of parameters `names`.

    scenario: the file that they belong to.
    rate: events per vehicle-km and its 95 % interval.
    """
    root = etree.Element("OpenSCENARIO")
    about = (
        f"{name}: {len(rows)} recorded events, {rate[0]:.4g} ({rate[1]:.4g} to {rate[2]:.4g}) per "
        "vehicle-km"
    )
    etree.SubElement(
        root,
        "FileHeader",
        revMajor="1",
        revMinor="1",
        date=DATE,
        author="sumo_eval",
        description=about,
    )
    distribution = etree.SubElement(root, "ParameterValueDistribution")
    etree.SubElement(distribution, "ScenarioFile", filepath=scenario)
    deterministic = etree.SubElement(distribution, "Deterministic")
    several = etree.SubElement(deterministic, "DeterministicMultiParameterDistribution")
    sets = etree.SubElement(several, "ValueSetDistribution")
    for row in rows.tolist():
        one = etree.SubElement(sets, "ParameterValueSet")
        for parameter, value in zip(names, row, strict=True):
            etree.SubElement(
                one, "ParameterAssignment", parameterRef=parameter, value=repr(round(value, 9))
            )
    etree.ElementTree(root).write(
        str(path), xml_declaration=True, encoding="utf-8", pretty_print=True
    )
