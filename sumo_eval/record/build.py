"""Build of each ADS: as its entry states it, or the Git commit of the folder that contains the
evaluation.

Users: `record/run_folder.py`.
"""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from pathlib import Path

from sumo_eval.settings import EvaluationSettings

_PATIENCE = 10.0  # s, for Git in a large folder


def builds_of(settings: EvaluationSettings, source: Path) -> Mapping[str, str]:
    """Build by ADS; without those that ship and those of which nothing is known."""
    own = [ads for ads in settings.ads if ads.build or ":" in ads.controller]
    commit = commit_of(source) if any(not ads.build for ads in own) else ""
    return {ads.name: ads.build or commit for ads in own if ads.build or commit}


def commit_of(folder: Path) -> str:
    """`3db9796abcde`, or `3db9796abcde-dirty` with changes that are not committed; "" without a
    commit.
    """
    command = [
        "git",
        "-C",
        str(folder),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=12",
        "--exclude=*",  # no tags: always the commit
    ]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_PATIENCE, check=False
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
