"""A figure of matplotlib that a notebook shows, with matplotlib imported: whoever draws nothing
does not need it.
"""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

RESOLUTION = 120  # dots an inch, of a figure in a notebook


class Drawing(Figure):
    """A figure that shows itself: a notebook knows those of pyplot only, and of others writes
    `<Figure ...>`.
    """

    def _repr_png_(self) -> bytes:
        """What a notebook shows."""
        pixels = BytesIO()
        self.savefig(pixels, format="png", dpi=RESOLUTION)
        return pixels.getvalue()
