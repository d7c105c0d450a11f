"""Fenced blocks and commands of the pages, and the desk on which a reader would try them."""

import re
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

from loaded import ROOT

PAGES = [
    path.relative_to(ROOT).as_posix()
    for path in sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
]

CODE = ("sh", "text", "bash", "yaml", "groovy")
"""Languages of blocks that hold commands."""


@dataclass(frozen=True)
class Block:
    """A fenced block: the language may be empty, for a drawing or what a command printed."""

    page: str
    line: int
    language: str
    text: str

    @property
    def place(self):
        return f"{self.page}:{self.line}"

    def commands(self):
        """The words behind `sumo-eval` of every command in it, with shell variables as the number
        1."""
        text = re.sub(r"\\\n|\n +(?=--)", " ", self.text) if self.language in CODE else ""
        found = re.findall(r"(?<![\w./-])sumo-eval ((?:[^\n'\"&|>]|\"[^\"\n]*\"|'[^'\n]*')+)", text)
        return [words_of(one) for one in found]


def words_of(command):
    """A command's words, with shell variables and arithmetic as the number 1."""
    return shlex.split(re.sub(r"\$\(\([^)]*\)\)|\$\{\w+\}|\$\w+", "1", command), comments=True)


def blocks(page):
    """Every fenced block of a page."""
    found = []
    begun = None
    held = []
    for number, line in enumerate((ROOT / page).read_text().splitlines(), start=1):
        fence = re.match(r"( *)```(\w*)", line)
        if fence and begun is None:
            begun, held = (number, fence[2], len(fence[1])), []
        elif fence and begun is not None:
            found.append(Block(page, begun[0], begun[1], "".join(f"{one}\n" for one in held)))
            begun = None
        elif begun is not None:
            held.append(line[begun[2] :] if not line[: begun[2]].strip() else line)
    assert begun is None, f"{page}: the block that begins in line {begun} has no end"
    return found


BLOCKS = [block for page in PAGES for block in blocks(page)]


def mentioned(page):
    """The words of every `sumo-eval ...` between backticks in a page's sentences."""
    text = re.sub(r"^ *```.*?^ *```", "", (ROOT / page).read_text(), flags=re.S | re.M)
    for command in re.findall(r"`sumo-eval ([^`]+)`", text):
        yield words_of(" ".join(command.split()).split(" > ")[0])


def code_of(page, marker):
    """The block of a page that holds this text."""
    (found,) = [block.text for block in blocks(page) if marker in block.text]
    return found


EVALUATION = """
name = "desk"
seed = 1
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = 2
[[ads]]
name = "idm"
controller = "idm"
[[ads]]
name = "lane_changer"
controller = "lane_changer"
[drivers]
count = 2
[run]
engine = "serial"
"""
"""What stands in for a page's own evaluation.toml: three points, in this process."""

CASE = "front_vehicle_low_speed-0000-idm"
READS_A_RUN = (
    "score",
    "report",
    "explain",
    "whatif",
    "replay",
    "plot",
    "export",
    "compare",
    "verify",
)


def as_a_shell(folder, pattern):
    """The paths that a shell puts in the place of a pattern."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.glob(pattern))


@dataclass(frozen=True)
class Desk:
    """A folder with what a reader of a page has at hand, and a small run that stands in for the
    page's."""

    folder: Path
    run: Path

    def lay_out(self):
        """The files that the pages' blocks are saved as, and the small evaluation under its
        name."""
        (self.folder / "evaluation.toml").write_text(EVALUATION)
        (self.folder / "gate.toml").write_text(
            code_of("docs/tutorials/a_night.md", "only_if_certain")
        )
        (self.folder / "lorry.toml").write_text(
            code_of("docs/tutorials/own_scenario.md", "[[parameter]]")
        )
        texts = [
            (ROOT / "docs" / "examples" / name).read_text()
            for name in ("my_ads.py", "ten_line_acc.py")
        ]
        (self.folder / "my_ads.py").write_text("\n\n".join(texts))

    def stand_in(self, words):
        """A command as it is run here: placeholders filled, a small evaluation for a dear one,
        folders made ready."""
        words = [
            CASE if word == "CASE" or re.fullmatch(r"\w+-\d{4}-\w+", word) else word
            for word in words
            if word != "--open"
        ]
        words = [
            path
            for word in words
            for path in (as_a_shell(self.folder, word) if "*" in word else [word])
        ]
        if words[0] in READS_A_RUN:
            for word in words[1:3] if words[0] == "compare" else words[1:2]:
                if not (self.folder / word).exists():
                    shutil.copytree(self.run, self.folder / word)
        if "--resume" in words and "--shard" not in words:
            shutil.copytree(self.run, self.folder / words[words.index("--out") + 1])
        if words[0] == "boundary":
            words += ["--budget", "16", "--workers", "1"]
        if words[0] == "run" and not any(word.endswith(".toml") for word in words):
            words.insert(1, "evaluation.toml")
        return words
