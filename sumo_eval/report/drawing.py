"""A figure of matplotlib that a notebook shows. Only drawing imports this module, and with it
matplotlib.

Users: `extras/figures/style.py`, `report/notebook.py`.
"""

from io import BytesIO

from matplotlib.figure import Figure

RESOLUTION = 120  # dots an inch, of a figure in a notebook


class Drawing(Figure):
    """A figure with a picture of itself for notebooks, which otherwise show only figures of pyplot
    and write `<Figure ...>` for any other.
    """

    def _repr_png_(self) -> bytes:
        """The figure as a notebook shows it."""
        pixels = BytesIO()
        self.savefig(pixels, format="png", dpi=RESOLUTION)
        return pixels.getvalue()
