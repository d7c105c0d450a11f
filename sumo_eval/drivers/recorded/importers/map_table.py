"""Table of positions on a map: a CSV file, one row for each vehicle and instant, in SI units,
centres, y to the left.

Needed: `vehicle`, `t`, `x`, `y`. Known: `recording`, `heading` (rad, counter-clockwise from x) or
`heading_deg`, `speed`, `acceleration`, `length`, `width`, `class`, `driver`. Missing headings,
speeds and accelerations follow from the motion; missing bodies and classes are those of a car.

Users: `drivers/recorded/importing.py`.
"""

from pathlib import Path

import numpy as np

from sumo_eval.drivers.recorded.importers.tables import (
    IDENTIFIERS,
    Samples,
    add_motion,
    in_order,
    make_numbers,
    read_table,
    unread,
)

LENGTH, WIDTH = 4.5, 1.8  # m, of a car, where the table has no bodies
_KNOWN = ("heading", "heading_deg", "speed", "acceleration", "length", "width")
COLUMNS = ("recording", "vehicle", "t", "x", "y", *_KNOWN, "class", "driver")


def read(path: Path) -> Samples:
    """The recordings of a file."""
    rows = read_table(path, ("vehicle", "t", "x", "y"), dtype=IDENTIFIERS)
    make_numbers(rows, ["t", "x", "y", *(name for name in _KNOWN if name in rows)], path)
    notes = unread("Column", rows, COLUMNS, path)
    if "recording" not in rows:
        rows["recording"] = path.name.rpartition(".csv")[0] or path.stem
    for name, size in (("length", LENGTH), ("width", WIDTH)):
        if name not in rows:
            rows[name] = size
            notes.append(f"{path.name} has no {name} of the vehicles: {size:g} m are assumed.")
    if "class" not in rows:
        notes.append(f"{path.name} has no classes: all are assumed to be cars.")
    if "heading_deg" in rows and "heading" in rows:
        notes.append(f"{path.name} has `heading` and `heading_deg`: `heading_deg` is not read.")
    elif "heading_deg" in rows:
        rows["heading"] = np.radians(rows["heading_deg"])
    rows, more_notes = in_order(rows)
    notes += more_notes
    if missing := add_motion(rows, ("heading", "speed"), str(path)):
        notes.append(f"{path.name} has no {' and no '.join(missing)}: from the motion.")
    return rows.filter(COLUMNS), notes
