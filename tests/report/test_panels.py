"""Charts on a page."""

import pytest

from sumo_eval.extras.panels import INK, Marks, Panel, on_page


@pytest.mark.parametrize(
    "line, marker, mode",
    [("-", "", "lines"), ("", "o", "markers"), ("-", "o", "lines+markers")],
)
def test_law_a_page_shows_the_line_and_the_marker(line, marker, mode):
    page = on_page([Panel([Marks("a", [0.0, 1.0], [0.0, 1.0], INK, line, marker)])], 1, 300)
    assert page.data[0].mode == mode
