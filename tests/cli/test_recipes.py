"""`nightly --install` writes what starts a night by itself, for the folder in which it is asked."""

from __future__ import annotations

import shlex
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest
from click.testing import CliRunner

from sumo_eval.cli import main
from sumo_eval.nightly.recipes import RECIPES, Night, systemd


def asked(folder: Path, kind: str, monkeypatch: pytest.MonkeyPatch, *options: str) -> str:
    monkeypatch.chdir(folder)
    (folder / "my evaluation.toml").write_text('name = "x"\n')
    command = ["nightly", "my evaluation.toml", "--history", "nights", "--install", kind, *options]
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.parametrize("kind", RECIPES)
def test_a_recipe_names_the_evaluation_and_the_history_and_nothing_is_run(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = asked(tmp_path, kind, monkeypatch, "--gate", "gate.toml")
    written = [Path(line) for line in said.splitlines() if (tmp_path / line).is_file()]
    text = "".join((tmp_path / path).read_text() for path in written)
    assert "'" in text
    assert "my evaluation.toml" in text
    assert "--gate" in text
    assert "tools/" not in text, "a user's repository has none of this one's tools"
    assert not (tmp_path / "nights" / "history.sqlite").exists()


def test_the_line_for_cron_is_one_that_a_shell_can_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked(tmp_path, "cron", monkeypatch)
    lines = (tmp_path / "nights" / "sumo-eval-night.cron").read_text().splitlines()
    night, watch = (line.split(None, 5)[5] for line in lines if not line.startswith("#"))
    for command in (night, watch):
        subprocess.run(["sh", "-n", "-c", command], check=True)
    assert str(tmp_path / "my evaluation.toml") in shlex.split(night)
    said = subprocess.run(["sh", "-c", watch], capture_output=True, text=True, check=True).stdout
    assert "There is no history" in said


def test_an_edited_evaluation_or_another_version_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lines that stand before a night, as a shell runs them; the program is one that says its version alone."""
    monkeypatch.chdir(tmp_path)
    file, program = tmp_path / "my evaluation.toml", tmp_path / "program"
    file.write_text('name = "x"\n')
    program.write_text(f"#!/bin/sh\necho {version('sumo_eval')}\n")
    program.chmod(0o755)
    night = Night(str(program), file, tmp_path / "nights")
    pins = night.pins()

    def statuses() -> list[int]:
        return [subprocess.run(["sh", "-c", line], capture_output=True, check=False).returncode for line in pins]

    assert statuses() == [0, 0]
    file.write_text('name = "y"\n')
    program.write_text("#!/bin/sh\necho 0.0.1\n")
    assert statuses() == [1, 1]
    service = next(text for path, text in systemd(night).files.items() if path.suffix == ".service")
    assert service.count("ExecStartPre=/bin/sh -c ") == 2
    assert "SuccessExitStatus" not in service, "status 3 must not pass in silence"


def test_a_recipe_that_is_there_is_not_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked(tmp_path, "github", monkeypatch)
    again = ["nightly", "my evaluation.toml", "--history", "nights", "--install", "github"]
    result = CliRunner().invoke(main, again)
    assert result.exit_code == 2
    assert "is there already" in result.output


def test_the_workflow_is_yaml_with_balanced_expressions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = asked(tmp_path, "github", monkeypatch)
    assert "where no package index has that version, commit its wheel too" in said
    text = (tmp_path / ".github" / "workflows" / "night.yml").read_text()
    assert text.count("${{") == text.count("}}") == 2
    assert "cache" not in text, "a cache may be evicted, and the history with it"
    assert "continue-on-error" not in text, "status 3 must not pass in silence"
    assert "sha256sum --check" in text
    assert f'pip install "sumo_eval=={version("sumo_eval")}"' in text
    assert "run: sumo-eval nightly 'my evaluation.toml' --history nights --keep 3" in text
