"""A release: checks, the changelog's cut, the version, a commit and a tag, the source archive and the wheel.

    python tools/release.py 0.2.0 --dry-run    every check and what would be done; nothing is changed
    python tools/release.py 0.2.0              does it

Refused: a tree that is not clean, a version that is not above the one that stands, a tag that is there already, nothing
under [Unreleased], golden files that differ (`--skip-golden` leaves that check to whoever has just made it), a house
check that finds something, a file that does not name the version that stands. The source archive is built from the
release's commit, in a tree of its own, and the wheel from the source archive; where that fails, the commit is taken
back. Nothing is pushed.
"""

from __future__ import annotations

import argparse
import datetime
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

_VERSION = re.compile(r"\d+\.\d+\.\d+")
_NAMES_THE_VERSION = {
    "pyproject.toml": 'version = "{}"',
    "CITATION.cff": "version: {}",
    "packaging/conda/meta.yaml": '{{% set version = "{}" %}}',
}
"""The line of each file that says which version this is; `{}` stands for the version."""
_UNRELEASED = "## [Unreleased]"


class RefusedError(Exception):
    """Why there is no release, in one sentence."""


def cut(changelog: str, version: str, day: str) -> str:
    """The changelog with what stood under [Unreleased] under the version and its day, and [Unreleased] empty above."""
    head, mark, rest = changelog.partition(f"{_UNRELEASED}\n")
    if not mark:
        raise RefusedError(f"CHANGELOG.md must have a section `{_UNRELEASED}`, has none.")
    entries = rest.split("\n## [")[0]
    if not re.search(r"^\s*- ", entries, flags=re.M):
        raise RefusedError(f"CHANGELOG.md must say under `{_UNRELEASED}` what is new, says nothing.")
    return f"{head}{mark}\n## [{version}] - {day}\n{rest}"


def next_version(pyproject: str, version: str) -> str:
    """The version that stands in pyproject.toml, below the new one."""
    standing = _said("pyproject.toml", pyproject)
    if not _VERSION.fullmatch(version):
        raise RefusedError(f"The version must have the form MAJOR.MINOR.PATCH, got {version}.")
    if _numbers(version) <= _numbers(standing):
        raise RefusedError(f"The version must be above {standing}, got {version}.")
    return standing


def with_version(name: str, text: str, standing: str, version: str) -> str:
    """A file's text with another version in the line that says the standing one."""
    said = _said(name, text)
    if said != standing:
        raise RefusedError(f"{name} must name the version of pyproject.toml, {standing}, names {said}.")
    line = _NAMES_THE_VERSION[name]
    return re.sub(f"^{re.escape(line.format(standing))}$", line.format(version), text, flags=re.M)


def _said(name: str, text: str) -> str:
    """The version that a file names."""
    before, after = (re.escape(part) for part in _NAMES_THE_VERSION[name].format("\0").split("\0"))
    found = re.findall(f'^{before}([^"\\s]+){after}$', text, flags=re.M)
    if len(found) != 1:
        shown = _NAMES_THE_VERSION[name].format("...")
        raise RefusedError(f"{name} must have one line `{shown}`, has {len(found)}.")
    return str(found[0])


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version))


def _run(root: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stdout + done.stderr).strip()
        raise RefusedError(f"`{' '.join(command)}` failed in {root}:\n{said}")
    return done.stdout


def check(root: Path, version: str, *, golden: bool = True) -> None:
    """Raise RefusedError where the tree is not one to release."""
    if left := _run(root, "git", "status", "--porcelain").strip():
        raise RefusedError(f"The tree must be clean, has {len(left.splitlines())} changes:\n{left}")
    if _run(root, "git", "tag", "--list", f"v{version}").strip():
        raise RefusedError(f"The tag v{version} is there already.")
    _run(root, sys.executable, "tools/house_check.py")
    if golden:
        _run(root, sys.executable, "tests/golden/golden.py")


def build(root: Path, version: str) -> Path:
    """The source archive and the wheel of the last commit in `dist/`; the wheel. The archive is built from a tree of
    its own, so that no file that lies about gets into it, and the wheel from the archive, as an index's users would.
    """
    dist = root / "dist"
    with tempfile.TemporaryDirectory(prefix="sumo_eval_release_") as folder:
        tree = Path(folder) / "tree"
        _run(root, "git", "worktree", "add", "--detach", str(tree), "HEAD")
        try:
            _run(tree, sys.executable, "-m", "hatchling", "build", "--target", "sdist", "--directory", str(dist))
            source = str(dist / f"sumo_eval-{version}.tar.gz")
            _run(root, sys.executable, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", str(dist), source)
        finally:
            _run(root, "git", "worktree", "remove", "--force", str(tree))
    (wheel,) = dist.glob(f"*-{version}-*.whl")
    return wheel


def release(root: Path, version: str, *, dry_run: bool = False, golden: bool = True) -> None:
    """Check, cut, set, commit, build and tag; print what was done. dry_run: only check, and say what would be done."""
    day = datetime.datetime.now(datetime.UTC).date().isoformat()
    pages = {"CHANGELOG.md": cut((root / "CHANGELOG.md").read_text(encoding="utf-8"), version, day)}
    standing = next_version((root / "pyproject.toml").read_text(encoding="utf-8"), version)
    for name in _NAMES_THE_VERSION:
        pages[name] = with_version(name, (root / name).read_text(encoding="utf-8"), standing, version)
    check(root, version, golden=golden)
    print(f"The tree is clean{' and the golden files hold' if golden else ', the golden files were not asked'}.")
    if dry_run:
        changed = f"{', '.join(list(pages)[:-1])} and {list(pages)[-1]}"
        print(
            f"Would change {changed}, commit, build the source archive and the wheel, and tag v{version}. "
            "Nothing was done."
        )
        return
    for name, text in pages.items():
        (root / name).write_text(text, encoding="utf-8")
    _run(root, "git", "commit", "--quiet", "--message", f"Release {version}", *pages)
    try:
        wheel = build(root, version)
    except RefusedError:
        _run(root, "git", "reset", "--hard", "--quiet", "HEAD~1")  # the tree was clean
        raise
    _run(root, "git", "tag", "--annotate", f"v{version}", "--message", f"sumo_eval {version}")
    print(
        f"Built {wheel} and its source archive, committed and tagged v{version}. "
        "To publish: git push --follow-tags, and upload both."
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Release, or say in one sentence why not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("version", help="MAJOR.MINOR.PATCH")
    parser.add_argument("--dry-run", action="store_true", help="check and say, change nothing")
    parser.add_argument("--skip-golden", action="store_true", help="do not compare the golden files (minutes)")
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1], help="the project's folder")
    given = parser.parse_args(arguments)
    try:
        release(given.root, given.version, dry_run=given.dry_run, golden=not given.skip_golden)
    except RefusedError as error:
        print(f"No release: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
