"""What starts a night by itself: the files for cron, systemd and GitHub, written for an evaluation and a history.

A recipe calls the program that wrote it. On GitHub, where that is not, it installs the package by its name and version
unless told otherwise. Version and evaluation are pinned: where one has changed, the night fails before it begins.
"""

from __future__ import annotations

import hashlib
import shlex
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from sumo_eval.errors import InputError, unknown


@dataclass(frozen=True, slots=True)
class Recipe:
    """Files to write, by their paths, and the sentence that says what is left to do."""

    files: Mapping[Path, str]
    left_to_do: str


@dataclass(frozen=True, slots=True)
class Night:
    """What is to run: the program as a command, the evaluation, its history, and further options of `nightly`."""

    program: str
    evaluation: Path
    history: Path
    options: tuple[str, ...] = ()

    def command(self, *, whole_paths: bool = True) -> str:
        """The shell's line for one night."""
        place = Path.resolve if whole_paths else Path
        words = ["nightly", str(place(self.evaluation)), "--history", str(place(self.history)), *self.options]
        return f"{self.program} {shlex.join(words)}"

    def pins(self, *, whole_paths: bool = True) -> tuple[str, str]:
        """The shell's lines that fail where the evaluation, or the version of the program, is another."""
        path = self.evaluation.resolve() if whole_paths else self.evaluation
        digest = hashlib.sha256(self.evaluation.read_bytes()).hexdigest()
        pinned, known = shlex.quote(f"{digest}  {path}"), _version()
        return (
            f"echo {pinned} | sha256sum --check --quiet",
            f'{{ test "$({self.program} --version)" = {known} || ! echo This recipe is of sumo_eval {known}.; }}',
        )

    def watch(self) -> str:
        """The shell's line of a dead man's switch."""
        words = ["nightly", "--history", str(self.history.resolve()), "--newer-than", "26h"]
        return f"{self.program} {shlex.join(words)}"


def cron(night: Night) -> Recipe:
    """A line for crontab: silent after a good night, so that mail comes only when there is something to read."""
    log = shlex.quote(str(night.history.resolve() / "last-night.log"))
    whole = " && ".join([*night.pins(), night.command()])
    begin = f"0 2 * * *  {{ {whole}; }} > {log} 2>&1 || cat {log}\n".replace("%", r"\%")
    watch = f'0 9 * * *  said=$({night.watch()} 2>&1) || echo "$said"\n'.replace("%", r"\%")
    path = night.history / "sumo-eval-night.cron"
    text = f"# Every night at two.\n{begin}# And a word where none has run: better on another machine.\n{watch}"
    return Recipe({path: text}, f"Add its lines to your table: crontab -e, then paste {path}")


def systemd(night: Night) -> Recipe:
    """A service and its timer. A failed gate, and exit status 3, is a failed unit, which OnFailure= can report."""
    command = night.command().replace("%", "%%")
    pins = "\n".join(f"ExecStartPre=/bin/sh -c {_systemd_word(line)}" for line in night.pins())
    service = f"""[Unit]
Description=Nightly evaluation of the automated driving system

[Service]
Type=oneshot
{pins}
ExecStart={command}
"""
    timer = """[Unit]
Description=Nightly evaluation of the automated driving system

[Timer]
OnCalendar=*-*-* 02:00:00 UTC
Persistent=true

[Install]
WantedBy=timers.target
"""
    folder = night.history
    files = {folder / "sumo-eval-night.service": service, folder / "sumo-eval-night.timer": timer}
    return Recipe(
        files,
        f"Copy both into ~/.config/systemd/user and start them: cp {folder}/sumo-eval-night.* ~/.config/systemd/user/ "
        "&& systemctl --user enable --now sumo-eval-night.timer",
    )


def github(night: Night) -> Recipe:
    """A workflow that keeps the history on a branch of its own from night to night."""
    history, path = night.history.as_posix(), shlex.quote(night.history.as_posix())
    there = Night("sumo-eval", night.evaluation, night.history, night.options)
    text = f"""name: night
on:
  schedule: [{{ cron: "0 2 * * *" }}]
  workflow_dispatch:
jobs:
  night:
    runs-on: ubuntu-latest
    permissions: {{ contents: write }}
    steps:
      - uses: actions/checkout@v4
      - uses: actions/setup-python@v5
        with: {{ python-version: "3.12" }}
      - run: >-
          sudo apt-get update && sudo apt-get install --yes --no-install-recommends
          libatomic1 libexpat1 libgl1 libx11-6 libxext6 libxrender1
      # Before the package is on an index: the path or address of its wheel instead of its name.
      - run: pip install "sumo_eval=={_version()}"
      # An edited evaluation fails here: write the recipe again where that is meant.
      - run: {there.pins(whole_paths=False)[0]}
      # The history lies on a branch of its own, which nothing evicts; without that branch it begins.
      - run: |
          if git ls-remote --exit-code --heads origin sumo-eval-nights; then
            git fetch --depth 1 origin sumo-eval-nights
            git worktree add {path} FETCH_HEAD
          else
            test $? -eq 2 && mkdir -p {path}
          fi
      - run: {there.command(whole_paths=False)} --keep 3
      - if: always()                      # bad nights stay in the history, too
        run: |
          cd {path} && rm -rf .git && git init --quiet --initial-branch sumo-eval-nights && git add --all
          git -c user.name=nights -c user.email=nights@localhost commit --quiet --message "Nights"
          git remote add origin "https://x-access-token:${{{{ github.token }}}}@github.com/${{{{ github.repository }}}}"
          git push --quiet --force origin HEAD
      - uses: actions/upload-artifact@v4
        if: always()
        with:
          name: night
          path: |
            {history}/trend.html
            {history}/nights/*/report.html
            {history}/nights/*/junit.xml
            {history}/nights/*/night.json
            {history}/chat.json
"""
    workflow = Path(".github") / "workflows" / "night.yml"
    return Recipe(
        {workflow: text},
        f"Commit {workflow}; GitHub starts it at two every night, and whenever you ask. It installs sumo_eval "
        f"{_version()} by its name: where no package index has that version, commit its wheel too and name the wheel "
        "in the line `pip install`.",
    )


RECIPES: Mapping[str, Callable[[Night], Recipe]] = {"cron": cron, "systemd": systemd, "github": github}


def install(kind: str, night: Night) -> Recipe:
    """Write the files of a recipe, which must not be there yet. Raises InputError."""
    if kind not in RECIPES:
        raise unknown("recipe", kind, RECIPES)
    if not night.evaluation.is_file():
        raise InputError(f"There is no evaluation file {night.evaluation}.")
    recipe = RECIPES[kind](night)
    for path in recipe.files:
        if path.exists():
            raise InputError(f"The recipe would write {path}, which is there already; move it away first.")
    for path, text in recipe.files.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise InputError(f"The file {path} of the recipe cannot be written: {error}.") from error
    return recipe


def _systemd_word(text: str) -> str:
    """A text as one word of a unit file."""
    for mark, code in (("\\", "\\\\"), ('"', '\\"'), ("$", "$$"), ("%", "%%")):
        text = text.replace(mark, code)
    return f'"{text}"'


def _version() -> str:
    try:
        return version("sumo_eval")
    except PackageNotFoundError:  # run from its sources without being installed
        sources = Path(__file__).parents[2] / "pyproject.toml"
        return str(tomllib.loads(sources.read_text(encoding="utf-8"))["project"]["version"])
