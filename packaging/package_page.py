"""The page of the package index: README, whose links into the repository become absolute."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


def package_page(readme: str, repository: str) -> str:
    """README for a place outside the repository.

    repository: its web address; where it is empty, a link becomes its words, and pictures go.
    """
    readme = readme.replace("pip install .\n", "pip install sumo_eval\n")
    if not repository:
        readme = re.sub(r"<picture>.*?</picture>\n\n", "", readme, flags=re.S)
        return re.sub(r"\[([^\]]*)\]\((?!https?:)[^)]*\)", r"\1", readme)
    readme = re.sub(r'(src|srcset)="(?!https?:)', rf'\1="{repository}/raw/HEAD/', readme)
    return re.sub(r"\]\((?!https?:)", f"]({repository}/blob/HEAD/", readme)


class PackagePage(MetadataHookInterface):
    """Sets the readme of the package when it is built."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the page to the metadata."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        page = package_page(text, metadata.get("urls", {}).get("Repository", ""))
        metadata["readme"] = {"content-type": "text/markdown", "text": page}
