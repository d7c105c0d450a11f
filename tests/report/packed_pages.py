"""What travels deflated inside a page, out and in again."""

import base64
import re
import zlib

from sumo_eval.report.page import packed


def unpacked(page, name):
    """The text of one packed script."""
    (text,) = re.findall(rf'<script type="text/plain" id="{name}">([A-Za-z0-9+/=]*)</script>', page)
    return zlib.decompress(base64.b64decode(text)).decode("utf-8")


def with_packed(page, name, text):
    """The page with another text in that script."""
    return re.sub(
        rf'(<script type="text/plain" id="{name}">)[A-Za-z0-9+/=]*', rf"\g<1>{packed(text)}", page
    )
