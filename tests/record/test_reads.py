"""A recorded case is reused only while all that its process had read is there as it was."""

import os
import py_compile
import shutil
import sqlite3
import zipfile
from contextlib import closing
from pathlib import Path

import pytest
from commands import python
from laid import lay
from record.runs import sumo_eval_cli
from refusals import refusal

import sumo_eval
from sumo_eval.input_file import hash_of
from sumo_eval.record import reads
from sumo_eval.record.identity import named_files
from sumo_eval.record.recording import find_stale
from sumo_eval.record.store import open_store

EVALUATION = """
name = "reads"
[[scenario]]
use = "front_vehicle_low_speed"
sampling.levels = {{ ego_speed = 2, lead_speed = 2 }}
[[ads]]
name = "mine"
controller = "{locator}"
[drivers]
count = 2
[run]
workers = 1
cases_per_child = {cases_per_child}
"""

ADS = """
import json, os, sys, zipfile
from pathlib import Path
HERE = Path(__file__).parent
sys.path.append(str(HERE / "packed.zip"))

class Mine:
    def __init__(self):
        import lazy.planner
        import in_zip
        self.plan = lazy.planner.plan

    def reset(self, scenario):
        os.chdir(HERE)
        json.loads(open("weights/link.json").read())
        (HERE / "weights" / "again.txt").read_text()
        try:
            (HERE / "weights" / "optional.txt").read_text()
        except FileNotFoundError:
            pass
        with open(HERE / "log.txt", "a") as log:
            log.write("one more\\n")
        (HERE / "log.txt").read_text()
        os.stat(HERE / "only_looked_at.txt")

    def act(self, seen):
        return self.plan()
"""
BRAKES = "from sumo_eval import Command\ndef plan():\n    return Command(-6.0)\n"
ROLLS = BRAKES.replace("-6.0", "0.0")


def written(folder, ads=ADS, cases_per_child=100):
    (folder / "weights").mkdir(parents=True)
    (folder / "lazy").mkdir()
    (folder / "lazy" / "planner.py").write_text(BRAKES)
    for name, text in (("target.json", "1"), ("again.txt", "2")):
        (folder / "weights" / name).write_text(text)
    (folder / "weights" / "link.json").symlink_to("target.json")
    with zipfile.ZipFile(folder / "packed.zip", "w") as packed:
        packed.writestr("in_zip.py", "a = 1\n")
    (folder / "only_looked_at.txt").write_text("")
    (folder / "my_ads.py").write_text(ads)
    path = folder / "evaluation.toml"
    path.write_text(EVALUATION.format(locator="my_ads.py:Mine", cases_per_child=cases_per_child))
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reads")
    sumo_eval.evaluate(written(folder / "source"), folder / "run")
    return folder


def stale(folder):
    with open_store(folder / "run") as store:
        return find_stale(store, folder / "source")


@pytest.fixture
def folder(whole, tmp_path):
    """A copy of it to change."""
    return Path(shutil.copytree(whole, tmp_path / "copy", symlinks=True))


def write(text):
    return lambda path: path.write_text(text)


def pipe(path):
    path.unlink()
    os.mkfifo(path)


CHANGES = {
    "imported in the constructor": ("lazy/planner.py", write(ROLLS)),
    "a module in a zip file": ("packed.zip", write("")),
    "read in reset": ("weights/again.txt", write("3")),
    "read through a link": ("weights/link.json", write("3")),
    "deleted": ("weights/again.txt", Path.unlink),
    "a pipe in its place": ("weights/again.txt", pipe),
    "made after it was missed": ("weights/optional.txt", write("")),
}


@pytest.mark.parametrize("kind", CHANGES)
def test_case_depends_on_what_its_ads_had_read(folder, kind):
    name, change = CHANGES[kind]
    assert stale(folder) == ()
    change(folder / "source" / name)
    (said,) = stale(folder)
    assert said.startswith(f"3 recorded cases of ADS `mine` cannot be reused: {name} changed")


def test_touched_and_written_files_change_nothing(folder):
    os.utime(folder / "source" / "weights" / "again.txt")
    (folder / "source" / "log.txt").write_text("emptied")
    (folder / "source" / "only_looked_at.txt").write_text("never opened")
    shutil.rmtree(folder / "source" / "lazy" / "__pycache__", ignore_errors=True)
    assert stale(folder) == ()


def test_an_edited_planner_is_rerun_and_reported(whole, folder, tmp_path):
    (folder / "source" / "lazy" / "planner.py").write_text(ROLLS)
    run = sumo_eval_cli(
        "run", folder / "source" / "evaluation.toml", "--out", folder / "run", "--resume"
    )
    assert "3 recorded cases of ADS `mine` cannot be reused: lazy/planner.py changed" in run.stdout
    fresh = sumo_eval.evaluate(folder / "source" / "evaluation.toml", tmp_path / "fresh")
    resumed = sumo_eval.score(folder / "run")
    assert [score.collisions for score in resumed.scores] == [
        score.collisions for score in fresh.scores
    ]
    assert resumed.scores[0].collisions > sumo_eval.score(whole / "run").scores[0].collisions
    assert stale(folder) == ()


def test_list_that_cases_share_stands_once(whole):
    with closing(sqlite3.connect(whole / "run" / "facts.sqlite")) as facts:
        names = facts.execute("SELECT DISTINCT ads FROM files_read").fetchall()
        files = facts.execute("SELECT count(*), count(DISTINCT path) FROM files_read").fetchone()
    assert names == [("my_ads.py:Mine",)], "of the ADS alone"
    assert files[0] == files[1]


@pytest.mark.parametrize(
    "path", ["\ud800", "a\0b", "/dev/zero", "/proc/self/mem", "../" * 3_000, ""]
)
def test_a_name_without_a_file_is_not_the_same(tmp_path, path):
    assert reads.changed([("mine", path, "a hash")], tmp_path) == {"mine": [path]}


def test_a_damaged_list_is_rerun(folder):
    with closing(sqlite3.connect(folder / "run" / "facts.sqlite")) as facts, facts:
        facts.execute("UPDATE files_read SET hash = 'x'")
    assert "3 recorded cases" in stale(folder)[0]


MANY_WAYS = """
import ctypes, importlib, os, runpy, sqlite3, sys, threading
from contextlib import suppress
from pathlib import Path
import numpy as np
from sumo_eval import Command
HERE = Path(__file__).resolve().parent

def ask(address, words):
    base = sqlite3.connect(address, uri=True)
    with base:
        base.execute(words)
    base.close()

class Mine:
    def __init__(self):
        sys.path.insert(0, str(HERE))
        importing = threading.Thread(target=importlib.import_module, args=["in_thread"])
        importing.start()
        importing.join()
        import again
        importlib.reload(again)
        import compiled_only
        runpy.run_path(str(HERE / "run_by_path.py"))
        exec(open(HERE / "executed.txt").read())
        np.memmap(HERE / "mapped.bin", dtype="u1")
        open(HERE / "both.txt", "r+").read()
        os.close(os.open(HERE / "by_number.txt", os.O_RDONLY))
        ask(f"file:{HERE}/asked.db?mode=ro", "SELECT 1")
        ask(f"file:{HERE}/log.db", "CREATE TABLE IF NOT EXISTS a (b)")
        ask(f"file:{HERE}/log.db", "INSERT INTO a VALUES (1)")
        with suppress(OSError):
            ctypes.CDLL(str(HERE / "library.so"))

    def act(self, seen):
        return Command(-6.0)
"""
WAYS = (
    "in_thread.py", "again.py", "compiled_only.pyc", "run_by_path.py", "executed.txt",
    "mapped.bin", "both.txt",
    "by_number.txt", "asked.db", "library.so",
)  # fmt: skip


def test_every_way_by_which_python_opens_counts(tmp_path):
    real = tmp_path / "real"
    real.mkdir()
    (tmp_path / "link").symlink_to(real)
    for name in WAYS:
        (real / name).write_text("a = 1\n")
    (real / "asked.db").write_bytes(b"")
    py_compile.compile(str(real / "again.py"), str(real / "compiled_only.pyc"))
    (real / "my_ads.py").write_text(MANY_WAYS)
    (tmp_path / "source").mkdir()
    path = tmp_path / "source" / "evaluation.toml"
    path.write_text(EVALUATION.format(locator="../link/my_ads.py:Mine", cases_per_child=1))
    sumo_eval.evaluate(path, tmp_path / "run")
    assert stale(tmp_path) == (), (
        "neither a log that it writes nor a file opened for both that it only reads"
    )
    for name in WAYS:
        was = (real / name).read_bytes()
        (real / name).write_bytes(was + b"\n")
        assert f"{name} changed" in "".join(stale(tmp_path)), name
        (real / name).write_bytes(was)
    assert stale(tmp_path) == ()


@pytest.mark.parametrize("kept_in", ["", "elsewhere"])
def test_kept_bytecode_hides_no_source(tmp_path, kept_in):
    (tmp_path / "planner.py").write_text("a = 1\n")
    look = (
        "import sys; from pathlib import Path; from sumo_eval.record import reads; "
        "sys.path.insert(0, '.');"
    )
    look += (
        "reads.begin(Path.cwd()); import planner; del sys.modules['planner']; print(reads.end())"
    )
    kept = {
        "PYTHONDONTWRITEBYTECODE": "",
        "PYTHONPYCACHEPREFIX": str(tmp_path / kept_in) if kept_in else "",
    }
    for _ in ("compiled", "taken from what is compiled"):
        done = python(look, cwd=tmp_path, env=os.environ | kept)
        assert (
            done.stdout.strip() == f"[('planner.py', '{hash_of(tmp_path / 'planner.py', 'file')}')]"
        )
    assert [*tmp_path.rglob("planner.*.pyc")]


def test_a_program_depends_on_modules_of_its_folder(tmp_path):
    files = {
        "client.py": "from helpers import planner\nimport json, nowhere\n",
        "helpers/__init__.py": "",
        "helpers/planner.py": "from . import deep\nimport top\nfrom .. import top\n",
        "top.py": "",
        "helpers/deep.py": "this is no Python",
        "unused.py": "",
    }
    lay(tmp_path, files)
    names = {
        str(file.relative_to(tmp_path)) for file in named_files("exec:python client.py", tmp_path)
    }
    assert names == {
        "client.py",
        "top.py",
        "helpers/__init__.py",
        "helpers/planner.py",
        "helpers/deep.py",
    }


EDITED_MEANWHILE = """
import subprocess
from pathlib import Path
HERE = Path(__file__).parent

class Mine:
    def __init__(self):
        import lazy.planner
        self.plan = lazy.planner.plan
        edit = f"test -e {HERE}/edited || (sed -i s/-6.0/-5.9/ {HERE}/lazy/planner.py; touch {HERE}/edited)"
        subprocess.run(["sh", "-c", edit], check=True)

    def act(self, seen):
        return self.plan()
"""


def test_two_versions_in_one_run_stop_it(tmp_path):
    path = written(tmp_path / "source", EDITED_MEANWHILE, cases_per_child=1)
    with refusal(r"`mine` was changed while the run went on: .* two versions of lazy/planner"):
        sumo_eval.evaluate(path, tmp_path / "run")
    assert "1 recorded case of ADS `mine` cannot be reused: lazy/planner.py" in stale(tmp_path)[0]
    assert sumo_eval.evaluate(path, tmp_path / "run", resume=True).scores[0].cases == 3
    assert stale(tmp_path) == ()


def test_process_that_is_lost_leaves_what_others_had_read(tmp_path):
    lost = ADS.replace("return self.plan()", "os._exit(3)")
    sumo_eval.evaluate(written(tmp_path / "source", lost), tmp_path / "run")
    assert "3 recorded cases" in stale(tmp_path)[0], "no process lived to tell what it had read"


def test_every_written_file_counts_as_written(tmp_path, monkeypatch):
    monkeypatch.setattr(reads, "_MOST_REPORTED", 1)
    watch = reads._Watch(tmp_path)
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text(name)
        watch.write(str(tmp_path / name))
        watch.read(str(tmp_path / name))
    noted = {path: found for path, found in watch.report() if path.endswith(".txt")}
    assert noted == {"a.txt": reads.WRITTEN}
