"""Draw README's picture, the first screen of a run's report, light and dark: python
tools/draw_report.py RUN.
"""

from __future__ import annotations

import io
import runpy
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
PAGE = runpy.run_path(str(ROOT / "tests" / "report" / "browser.py"))["Page"]
WIDTH, HEIGHT, COLOURS = 1200, 830, 64  # 150 kB at most

for scheme in ("light", "dark"):
    with (
        tempfile.TemporaryDirectory() as profile,
        PAGE(Path(profile), WIDTH, HEIGHT, "--hide-scrollbars") as page,
    ):
        page.call(
            "Emulation.setDeviceMetricsOverride",
            width=WIDTH,
            height=HEIGHT,
            deviceScaleFactor=1,
            mobile=False,
        )
        page.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )
        page.open(
            Path(sys.argv[1], "report.html").resolve().as_uri(),
            "document.querySelector('.main-svg')",
        )
        page.run("document.documentElement.style.scrollbarGutter = 'auto'")
        page.run("new Promise(done => setTimeout(done, 2000))")  # the charts fade in
        picture = Image.open(io.BytesIO(page.picture())).convert("RGB").quantize(COLOURS)
        picture.save(ROOT / "docs" / "pictures" / f"report_{scheme}.png", optimize=True)
