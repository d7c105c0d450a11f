"""tools/release.py in a small repository of its own: what it refuses, what it does, and that a dry
run does nothing."""

import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
from commands import program
from laid import lay
from loaded import ROOT, load

CHANGELOG = (
    "# Changelog\n\n## [0.2.0] - 2026-02-01\n\n### Added\n- A thing.\n\n## [0.1.0] - "
    "2026-01-01\n- The first.\n"
)
PYPROJECT = """[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "sumo_eval"
version = "0.2.0"
requires-python = ">=3.11"

[tool.hatch.build.targets.wheel]
packages = ["sumo_eval"]
"""
CITATION = "cff-version: 1.2.0\nversion: 0.2.0\n"
CONDA = '{% set version = "0.2.0" %}\n\npackage:\n  version: {{ version }}\n'


def git(root, *arguments):
    return program("git", *arguments, cwd=root).stdout


@pytest.fixture
def project(tmp_path):
    """A repository with the real scripts and a package of one file, everything committed."""
    root = tmp_path / "project"
    lay(
        root,
        {
            "tests/golden/golden.py": "raise SystemExit(0)\n",
            "sumo_eval/__init__.py": '"""A package."""\n',
            "CHANGELOG.md": CHANGELOG,
            "pyproject.toml": PYPROJECT,
            "CITATION.cff": CITATION,
            "packaging/conda/meta.yaml": CONDA,
            ".gitignore": "dist/\n",
        },
    )
    (root / "tools").mkdir()
    for script in ("release.py", "house_check.py"):
        shutil.copy(ROOT / "tools" / script, root / "tools")
    git(tmp_path, "init", "--quiet", str(root))
    git(root, "config", "user.name", "A tester")
    git(root, "config", "user.email", "tester@example.org")
    commit(root)
    return root


def commit(root):
    git(root, "add", "--all")
    git(root, "commit", "--quiet", "--message", "A state")


def release(root, *arguments):
    command = [sys.executable, str(root / "tools" / "release.py"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def state(root):
    return git(root, "rev-parse", "HEAD"), git(root, "status", "--porcelain"), git(root, "tag")


def test_a_dry_run_says_what_it_would_do_and_does_nothing(project):
    before = state(project)
    done = release(project, "0.2.0", "--dry-run")
    assert done.returncode == 0, done.stderr
    assert (
        done.stdout
        == "Would build the source archive and the wheel, and tag v0.2.0. Nothing was done.\n"
    )
    assert state(project) == before


@pytest.mark.campaign
def test_a_release_builds_tags_and_leaves_a_clean_tree(project, monkeypatch):
    pytest.importorskip("hatchling")
    monkeypatch.setenv("PIP_NO_BUILD_ISOLATION", "0")  # pip's own way of saying that there is none
    done = release(project, "0.2.0")
    assert git(project, "tag") == "v0.2.0\n"
    assert git(project, "rev-parse", "v0.2.0^{commit}") == git(project, "rev-parse", "HEAD")
    assert git(project, "status", "--porcelain") == ""
    assert git(project, "worktree", "list").count("\n") == 1
    assert done.returncode == 0, done.stderr
    (wheel,) = (project / "dist").glob("*.whl")
    assert wheel.name == "sumo_eval-0.2.0-py3-none-any.whl"
    assert "sumo_eval/__init__.py" in zipfile.ZipFile(wheel).namelist()
    with tarfile.open(project / "dist" / "sumo_eval-0.2.0.tar.gz") as source:
        assert "sumo_eval-0.2.0/sumo_eval/__init__.py" in source.getnames()


@pytest.mark.campaign
def test_a_wheel_that_cannot_be_built_leaves_no_tag(project, monkeypatch):
    # the build's own environment finds nothing to build with
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    before = state(project)
    done = release(project, "0.2.0")
    assert done.returncode == 1
    assert "pip wheel" in done.stderr
    assert state(project) == before
    assert git(project, "worktree", "list").count("\n") == 1


GOLDEN = {"tests/golden/golden.py": "print('scores: idm: s was 1, is 2.')\nraise SystemExit(1)\n"}


@pytest.mark.parametrize(
    "files, words",
    [
        (
            {"pyproject.toml": PYPROJECT.replace("0.2.0", "0.0.7")},
            "No release: pyproject.toml must have the line `",
        ),
        (
            {"CITATION.cff": "version: 0.0.7\n"},
            "No release: CITATION.cff must have the line `version: 0.2.0`.\n",
        ),
        (
            {"packaging/conda/meta.yaml": ""},
            "No release: packaging/conda/meta.yaml must have the line `",
        ),
        (GOLDEN, "scores: idm: s was 1, is 2.\n"),
        (
            {"CHANGELOG.md": CHANGELOG.replace("- A thing.\n", "")},
            "must have entries under `## [0.2.0] - YYYY-MM-DD`",
        ),
        ({"sumo_eval/lost.py": "LEFT = 1\n"}, "dead: sumo_eval.lost.LEFT"),
    ],
)
def test_state_without_a_release_is_refused(project, files, words):
    for name, text in files.items():
        (project / name).write_text(text)
        commit(project)
    done = release(project, "0.2.0")
    assert done.returncode == 1
    assert words in done.stderr
    if files is GOLDEN:
        assert release(project, "0.2.0", "--skip-golden", "--dry-run").returncode == 0


def test_the_projects_own_files_name_one_version_with_entries():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    load("tools/release.py").check_words(ROOT, project["version"])


def test_a_tree_that_is_not_clean_is_refused(project):
    (project / "left.txt").write_text("Left lying about.\n")
    done = release(project, "0.2.0")
    assert done.returncode == 1
    assert done.stderr == "No release: The tree must be clean, has 1 changes:\n?? left.txt\n"
    assert git(project, "tag") == ""


def test_a_tag_that_is_there_is_refused(project):
    git(project, "tag", "v0.2.0")
    assert release(project, "0.2.0").stderr == "No release: The tag v0.2.0 exists already.\n"
