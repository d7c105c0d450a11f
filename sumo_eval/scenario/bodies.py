"""Bodies of other road users: standard sizes, and the class under which SUMO knows them.

Sizes are SUMO's defaults for the class (its page Vehicle_Type_Parameter_Defaults). The car's are
the project's own, a child's those of Euro NCAP's child target (EPTc), rounded. A scenario file may
give others.

Users: `ads/foresight.py`, `cosim/`, `report/page_data.py`, `scenario/`,
`extras/openscenario/drive_numbers.py`.
"""

import math
from typing import NamedTuple

from sumo_eval.kernels import kernel

CAR = "car"


class Standard(NamedTuple):
    """A standard body.

    length, width: m.
    sumo_class: SUMO's vClass.
    shape: how sumo-gui draws it.
    """

    length: float
    width: float
    sumo_class: str
    shape: str


BODIES = {
    CAR: Standard(4.5, 1.8, "passenger", "passenger/sedan"),
    "van": Standard(6.5, 2.16, "delivery", "delivery"),
    "truck": Standard(12.0, 2.5, "truck", "truck"),
    "motorcycle": Standard(2.2, 0.9, "motorcycle", "motorcycle"),
    "bicycle": Standard(1.6, 0.65, "bicycle", "bicycle"),
    "pedestrian": Standard(0.215, 0.478, "pedestrian", "pedestrian"),
    "child": Standard(0.2, 0.4, "pedestrian", "pedestrian"),
}
"""Bodies by the name that a scenario file gives them."""
VULNERABLE = ("bicycle", "pedestrian", "child")
"""Bodies that may stand and move beside the lanes of a road."""


@kernel
def half_sizes(heading: float, length: float, width: float) -> tuple[float, float]:
    """Half the extents of a turned body along and across the road, m.

    heading: of the body, rad to the left of the road's direction.
    length, width: of the body itself, m.
    """
    if heading == 0.0:  # most bodies: saves the cosine and the sine
        return 0.5 * length, 0.5 * width
    c, s = abs(math.cos(heading)), abs(math.sin(heading))
    return 0.5 * (length * c + width * s), 0.5 * (length * s + width * c)
