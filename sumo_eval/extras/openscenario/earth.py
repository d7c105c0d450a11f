"""Places on the earth as places of a map, for positions by latitude and longitude.

Users: `extras/openscenario/places.py`.
"""

import cmath
import math
import re
from typing import Any

from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.extras.openscenario.values import number_of

_RADIUS, _FLATTENING = 6_378_137.0, 1.0 / 298.257223563  # WGS 84
# `+name=value` in the text of a projection, in the notation of the library PROJ; a value may be
# `4.9e+1`
_PART = re.compile(r"\+(\w+)=((?:\d[eE]\+\d|[^\s+])+)")
# Parts of a projection that are refused: another ellipsoid than WGS 84 (GRS80 differs by 0.1 mm),
# a shift of the ellipsoid that is not 0, a pole as origin, another meridian or unit, other axes
# than x to the east and y to the north. They would put places metres to kilometres off.
_ELSEWHERE = re.compile(
    r"\+(ellps=(?!WGS84|GRS80)|datum=(?!WGS84)|towgs84=[0.,]*[^0.,\s+]|lat_0=-?90|axis=(?!en)"
    r"|(R|a|b|e|es|f|rf|pm|nadgrids|to_meter)=)"
)
# the third flattening n, the first eccentricity, and Krueger's coefficients alpha_1 to alpha_3
_N = _FLATTENING / (2.0 - _FLATTENING)
_E = 2.0 * math.sqrt(_N) / (1.0 + _N)
_SERIES = (
    _N / 2 - 2 / 3 * _N**2 + 5 / 16 * _N**3, 13 / 48 * _N**2 - 3 / 5 * _N**3, 61 / 240 * _N**3
)  # fmt: skip


def transverse_mercator(latitude: float, longitude: float) -> complex:
    """North + 1j east, m, by Krueger's series to n^3: exact to 0.1 mm in a zone.

    longitude: from the central meridian; both in rad.
    """
    sine, cosine = math.sin(latitude), math.cos(longitude)
    t = math.sinh(math.atanh(sine) - _E * math.atanh(_E * sine))
    z = complex(math.atan2(t, cosine), math.asinh(math.sin(longitude) / math.hypot(t, cosine)))
    z += sum(factor * cmath.sin(2 * k * z) for k, factor in enumerate(_SERIES, 1))
    return _RADIUS / (1.0 + _N) * (1.0 + _N**2 / 4 + _N**4 / 64) * z


def on_map(position: Node, root: Node) -> tuple[float, float]:
    """x and y of a <GeoPosition> on the map of an OpenDRIVE file, m.

    root: of that file, whose header has the projection.
    """
    numbers = _projection(position, root.find("header/geoReference"))
    latitude, longitude = position.number("latitudeDeg"), position.number("longitudeDeg")
    if not abs(latitude) < 90.0:
        raise position.fault(f"`latitudeDeg` must be between -90 and 90, got {latitude:g}")
    # north + 1j east of the place, and from there of the map's origin at its central meridian
    at = transverse_mercator(math.radians(latitude), math.radians(longitude - numbers["lon_0"]))
    at = numbers["k"] * (at - transverse_mercator(math.radians(numbers["lat_0"]), 0.0))
    for offset in root.all("header/offset"):
        if offset.number("hdg", 0.0):
            raise offset.fault("a turned map is not supported")
        at -= complex(offset.number("y", 0.0), offset.number("x", 0.0))
    return numbers["x_0"] + at.imag, numbers["y_0"] + at.real


def _projection(position: Node, reference: Node | None) -> dict[str, float]:
    """Numbers of a transverse Mercator projection by their names in PROJ.

    x_0, y_0: of the origin, m. lat_0, lon_0: of the origin, degrees. k: scale.

    position: the element that faults name.
    reference: <geoReference> of the map; None: it has none.
    """
    text = "" if reference is None else str(reference.element.text)
    parts = dict(_PART.findall(text))
    numbers: dict[str, Any] = {"k": 1.0}
    numbers |= dict.fromkeys(("x_0", "y_0", "lat_0", "lon_0", "k_0", "zone"), 0.0)
    # PROJ reads `32N` (a zone) and `49N` (a latitude) as numbers, too
    written = {name: number_of(parts[name].removesuffix("N")) for name in numbers if name in parts}
    kind = parts.get("proj"), parts.get("units", "m")
    utm = kind == ("utm", "m") and written.get("zone") in range(1, 61)
    if not (utm or kind == ("tmerc", "m")) or None in written.values() or _ELSEWHERE.search(text):
        raise position.fault(
            "the <geoReference> of its map must be of +proj=tmerc or +proj=utm +zone=1..60, on WGS "
            "84, with x to the east and y to the north, in m and decimal degrees, got "
            f"{text.strip() or 'none'}"
        )
    numbers |= written
    # two names of the scale, of which PROJ reads `k_0` first
    numbers["k"] = numbers["k_0"] or numbers["k"]
    if utm:  # zones of 6 degrees; in the south y begins at 10,000 km
        numbers |= {"x_0": 5e5, "y_0": 1e7 * ("+south" in text), "k": 0.9996}
        numbers["lon_0"] = 6.0 * numbers["zone"] - 183.0
    return numbers
