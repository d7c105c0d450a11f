"""A release: checks, the source archive, the wheel and a tag of the version that the tree names.

    python tools/release.py 0.2.0 --dry-run    every check; nothing is changed
    python tools/release.py 0.2.0              builds and tags

Before it, in a commit of its own: the version in the files of _NAMES_THE_VERSION, and in
CHANGELOG.md its section with a day. Refused: a tree that is not clean, another version in one of
the files, a tag that exists, a section without an entry, golden files that differ (`--skip-golden`
leaves that check out), a finding of the house check. The source archive is built from the commit,
in a tree of its own, and the wheel from the source archive. Nothing is pushed.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

_NAMES_THE_VERSION = {
    "pyproject.toml": 'version = "{}"',
    "CITATION.cff": "version: {}",
    "packaging/conda/meta.yaml": '{{% set version = "{}" %}}',
}
"""Line of each file that names the version, in the place of `{}`."""


class RefusedError(Exception):
    """Reason why there is no release."""


def check_words(root: Path, version: str) -> None:
    """Raise RefusedError where a file does not name the version, or the changelog has no entry for
    it.
    """
    for name, line in _NAMES_THE_VERSION.items():
        if line.format(version) not in (root / name).read_text(encoding="utf-8").splitlines():
            raise RefusedError(f"{name} must have the line `{line.format(version)}`.")
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    section = re.search(
        rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d\n(.*?)(?=^## \[|\Z)",
        changelog,
        re.M | re.S,
    )
    if section is None or not re.search(r"^\s*- ", section[1], re.M):
        raise RefusedError(f"CHANGELOG.md must have entries under `## [{version}] - YYYY-MM-DD`.")


def _run(root: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stdout + done.stderr).strip()
        raise RefusedError(f"`{' '.join(command)}` failed in {root}:\n{said}")
    return done.stdout


def check(root: Path, version: str, *, golden: bool = True) -> None:
    """Raise RefusedError where the tree is not one to release."""
    check_words(root, version)
    if left := _run(root, "git", "status", "--porcelain").strip():
        raise RefusedError(f"The tree must be clean, has {len(left.splitlines())} changes:\n{left}")
    if _run(root, "git", "tag", "--list", f"v{version}").strip():
        raise RefusedError(f"The tag v{version} exists already.")
    _run(root, sys.executable, "tools/house_check.py")
    if golden:
        _run(root, sys.executable, "tests/golden/golden.py")


def build(root: Path, version: str) -> Path:
    """The source archive and the wheel of the last commit in `dist/`; the wheel.

    The archive is built from a tree of its own, so that no stray file gets into it, and the wheel
    from the archive, as an index's users would.
    """
    dist = root / "dist"
    with tempfile.TemporaryDirectory(prefix="sumo_eval_release_") as folder:
        tree = Path(folder) / "tree"
        _run(root, "git", "worktree", "add", "--detach", str(tree), "HEAD")
        try:
            _run(
                tree,
                sys.executable,
                "-m",
                "hatchling",
                "build",
                "--target",
                "sdist",
                "--directory",
                str(dist),
            )
            source = str(dist / f"sumo_eval-{version}.tar.gz")
            _run(
                root,
                sys.executable,
                "-m",
                "pip",
                "wheel",
                "--no-deps",
                "--wheel-dir",
                str(dist),
                source,
            )
        finally:
            _run(root, "git", "worktree", "remove", "--force", str(tree))
    (wheel,) = dist.glob(f"*-{version}-*.whl")
    return wheel


def main(arguments: Sequence[str] | None = None) -> int:
    """Release, or print why not."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("version", help="MAJOR.MINOR.PATCH")
    parser.add_argument("--dry-run", action="store_true", help="only check")
    parser.add_argument(
        "--skip-golden", action="store_true", help="do not compare the golden files (minutes)"
    )
    parser.add_argument(
        "--root", type=Path, default=Path(__file__).parents[1], help="the project's folder"
    )
    given = parser.parse_args(arguments)
    root, version = given.root, given.version
    try:
        check(root, version, golden=not given.skip_golden)
        if given.dry_run:
            print(
                f"Would build the source archive and the wheel, and tag v{version}. Nothing was "
                "done."
            )
            return 0
        wheel = build(root, version)
        _run(root, "git", "tag", "--annotate", f"v{version}", "--message", f"sumo_eval {version}")
    except RefusedError as error:
        print(f"No release: {error}", file=sys.stderr)
        return 1
    print(
        f"Built {wheel} and its source archive, tagged v{version}. To publish: git push "
        "--follow-tags; upload both."
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
