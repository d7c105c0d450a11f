"""An evaluation from a notebook: a dict in, classes and functions of a cell as ADSs, a table and a
picture out."""

import subprocess
import sys
import threading
import tomllib
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from commands import sumo_eval as sumo_eval_cli
from refusals import refusal

import sumo_eval
from sumo_eval.record.facts import resolve
from sumo_eval.record.given import entry_of
from sumo_eval.settings import (
    AdsSettings,
    EvaluationSettings,
    SamplingSettings,
    ScenarioSettings,
)
from sumo_eval.settings.config import read_evaluation, to_toml

EVALUATION = tomllib.loads("""
name = "notebook"
scenario = [{ use = "front_vehicle_low_speed", sampling = { levels = 2 } }]
ads = [{ name = "idm", controller = "idm" }]
drivers = { count = 2 }
""")
LIMIT = 4.0


class Acc:
    """Stands in for a class of a cell: it lies within no file that a child could import by its
    name."""

    __module__ = "__main__"

    def act(self, seen):
        return (
            0.0 if seen.lead is None else max(-LIMIT, 0.2 * (seen.lead.gap - 5.0 - seen.ego.speed))
        )


def brake(seen):
    return -1.0


@pytest.mark.parametrize("engine", ["serial", "processes"])
def test_a_dict_is_an_evaluation_and_a_class_of_a_cell_an_ads(tmp_path, engine):
    def cell(seen):
        return -LIMIT if seen.lead and seen.lead.gap < 40.0 else 0.0

    found = sumo_eval.evaluate(
        EVALUATION, tmp_path / "run", ads=["idm", cell], engine=engine, workers=2
    )
    assert [ads.name for ads in found.settings.ads] == ["idm", "cell"]
    assert {case.status for case in found.cases} <= {"ok", "collision"}, [
        case.error for case in found.cases
    ]
    assert sumo_eval.evaluate(None, tmp_path / "run", resume=True).scores == found.scores
    assert str(found).count("\n") == len(found.scores) + 2  # three lines of headings
    html = found._repr_html_()
    assert html.count("<tr>") == 1 + len(found.scores)
    assert "<td>cell</td>" in html


def test_python_reads_what_python_wrote(tmp_path, monkeypatch):
    bare = {name: value for name, value in EVALUATION.items() if name != "ads"}
    monkeypatch.chdir(tmp_path)
    # an evaluation without ADSs takes those that are given
    found = sumo_eval.evaluate(bare, "out", ads=[Acc])
    run = sumo_eval.open_run("out")
    assert list(run.cases["case"]) == [case.case for case in found.cases]
    assert list(run.scores["ads"]) == ["Acc"]
    for words in (["export", "out", "--format", "csv", "--out", "csv"], ["score", "out"],
        ["report", "out"],
                  ["explain", "out", found.cases[0].case], ["compare", "out", "out"]):  # fmt: skip
        sumo_eval_cli(*words)
    left = {path.name for path in Path("out").iterdir()}
    assert {"scores.json", "cases.csv", "junit.xml", "report.html"} <= left


def test_a_class_a_function_and_an_object_in_the_dict_itself(tmp_path):
    ads = [
        {"name": "class", "controller": Acc},
        {"name": "file", "controller": brake},
        {"name": "it", "controller": Acc()},
    ]
    found = sumo_eval.evaluate({**EVALUATION, "ads": ads}, tmp_path / "run")
    assert {case.error for case in found.cases} == {None}
    rows = {
        name: [case.impact_speed for case in found.cases if case.ads == name]
        for name in ("class", "it")
    }
    assert rows["class"] == rows["it"]
    kept = {
        ads.name: ads.controller
        for ads in read_evaluation(tmp_path / "run" / "evaluation.toml").ads
    }
    assert kept["file"].endswith("test_given.py:brake")
    assert kept["class"].startswith(f"given:{tmp_path}/run/ads/Acc-")
    pytest.importorskip("matplotlib")
    axes = found.plot().axes
    assert [axis.get_title() for axis in axes] == ["front_vehicle_low_speed"]
    assert [label.get_text() for label in axes[0].get_yticklabels()] == ["class", "file", "it"]


def test_what_cannot_be_sent_is_refused_and_leaves_no_run(tmp_path):
    lock = threading.Lock()

    def holds(seen):
        return 0.0 if lock else 1.0

    with refusal(r"ADS `holds` cannot be sent to the processes that drive: TypeError"):
        sumo_eval.evaluate(EVALUATION, tmp_path / "run", ads=[holds])
    assert not (tmp_path / "run").exists()


SCRIPT = """
from pathlib import Path
from sumo_eval.record.given import entry_of

class Mine:
    def act(self, seen):
        return -4.0

print(entry_of(Mine, Path("run"), resume=True).controller)
"""


def test_a_class_of_a_script_has_one_file_in_all_processes(tmp_path):
    """Else a resumed run repeats all drives: cloudpickle numbers classes at random."""
    (tmp_path / "script.py").write_text(SCRIPT)
    files, contents = set(), set()
    for _ in range(2):
        said = subprocess.check_output([sys.executable, "script.py"], cwd=tmp_path, text=True)
        files.add(said.strip().removeprefix("given:"))
        contents.add(Path(said.strip().removeprefix("given:")).read_bytes())
    assert len(files) == len(contents) == 1
    (tmp_path / "script.py").write_text(SCRIPT.replace("4.0", "5.0"))
    said = subprocess.check_output([sys.executable, "script.py"], cwd=tmp_path, text=True)
    assert said.strip().removeprefix("given:") not in files, "an edited class is another ADS"


def test_a_cell_has_one_file_in_all_kernels(tmp_path):
    names = set()
    for kernel in ("ipykernel_7", "ipykernel_12345"):
        cell = {"__name__": "__main__"}
        exec(compile("def cell(seen):\n    return 0.0", f"/tmp/{kernel}/99.py", "exec"), cell)
        names.add(entry_of(cell["cell"], tmp_path, resume=True).controller)
    assert len(names) == 1


def test_an_object_of_a_file_is_read_without_the_file(tmp_path, monkeypatch):
    """It was pickled by the name of its module, which `verify` and `run --resume` did not find."""
    (tmp_path / "helper_of_mine.py").write_text("LIMIT = 4.0\n")
    (tmp_path / "mine_of_a_file.py").write_text(
        "import helper_of_mine\n"
        "class Mine:\n"
        "    class Inner:\n"
        "        def act(self, seen):\n"
        "            return -helper_of_mine.LIMIT\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    from mine_of_a_file import Mine

    place = f"{tmp_path}/mine_of_a_file.py:Mine.Inner"
    assert entry_of(Mine.Inner, tmp_path / "run", resume=True).controller == place
    for ads in Mine.Inner(), Mine.Inner().act:
        file = entry_of(ads, tmp_path / "run", resume=True).controller.removeprefix("given:")
        read = f"import pickle; print(pickle.load(open({file!r}, 'rb')))"
        assert "Inner" in subprocess.check_output([sys.executable, "-c", read], text=True)


def test_code_that_cannot_be_pickled_is_named(tmp_path, monkeypatch):
    (tmp_path / "holds_a_lock.py").write_text(
        "import threading\n"
        "LOCK = threading.Lock()\n"
        "class Mine:\n"
        "    def act(self, seen):\n"
        "        with LOCK:\n"
        "            return 0.0\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    from holds_a_lock import Mine

    controller = entry_of(Mine(), tmp_path / "run", resume=True).controller
    assert b"holds_a_lock" in Path(controller.removeprefix("given:")).read_bytes()


def test_two_of_one_name_cannot_be_told_apart(tmp_path):
    with refusal("must differ from each other, got 'idm' twice"):
        sumo_eval.evaluate(EVALUATION, tmp_path / "run", ads=["idm", AdsSettings("idm", "idm")])
    pair = [lambda _: 0.0, lambda _: -1.0]
    with refusal(r"got 'lambda' twice. Name each in the evaluation, a dict: "):
        resolve(EVALUATION, tmp_path / "run", False, pair)
    named = [{"name": f"by {-k} m/s2", "controller": it} for k, it in enumerate(pair)]
    entries = resolve({**EVALUATION, "ads": named}, tmp_path / "run", False).settings.ads
    assert len({entry.controller for entry in entries}) == 2


@pytest.mark.parametrize("single", ["idm", Acc])
def test_one_ads_alone_must_be_in_a_list(single, tmp_path):
    with refusal("`ads` of `evaluate` must be a list of ADSs, got"):
        sumo_eval.evaluate(EVALUATION, tmp_path / "run", ads=single)


def test_a_wrong_dict_is_refused_like_a_wrong_file(tmp_path):
    with refusal(r"Unknown key `drivers\.cout` in the evaluation\. Did you mean `count`"):
        sumo_eval.evaluate({**EVALUATION, "drivers": {"cout": 2}}, tmp_path / "run")


def test_numbers_of_numpy_in_settings_are_numbers(tmp_path):
    sampling = SamplingSettings(method="sobol", count=np.int64(2))
    ads = AdsSettings("idm", "idm", options={"headway": np.float32(1.5)})
    settings = EvaluationSettings("x", (ScenarioSettings("cut_in", sampling),), (ads,))
    run = resolve(replace(settings, seed=np.int64(3)), tmp_path / "run", resume=False)
    assert tomllib.loads(to_toml(run.settings))["seed"] == 3
    assert run.settings.scenario[0].sampling == SamplingSettings(method="sobol", count=2)
    assert run.settings.ads[0].locator == "idm?options.headway=1.5"


def test_the_package_says_its_version():
    assert sumo_eval.__version__ == version("sumo_eval")
