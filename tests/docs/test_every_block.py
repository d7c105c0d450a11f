"""Every fenced block of every page is run, or read by the program's own reader with a reason that
says what runs it elsewhere or why nothing here can; and so is every command.
"""

import re
import shlex
import shutil
import subprocess
import tomllib
from dataclasses import fields

import click
import pytest
import yaml
from commands import sumo_eval
from doc_blocks import BLOCKS, CODE, PAGES, ROOT, Desk, code_of, mentioned
from example_files import write_needs
from road_scenes import at_values, clear_drive
from tables import in_campaign, rows_of, values_of

from sumo_eval.cli import commands, main
from sumo_eval.cosim import simulate
from sumo_eval.cosim.doors.features import read_interface
from sumo_eval.extras.openscenario.points import read_mapping
from sumo_eval.extras.rates.campaign import read_campaign
from sumo_eval.extras.wheel.plan import read_study
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.file import scenario_from
from sumo_eval.scenario.formats import expanded
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.scoring.gate_settings import read_gate
from sumo_eval.settings import EvaluationSettings, SimulationSettings
from sumo_eval.settings.config import settings_from

MARKED = {
    "": "a drawing, or what a command printed",
    "groovy": "nothing here reads Groovy; its commands are read like all others",
    "math": "the site's build turns it into MathML, and fails where it cannot",
}
"""Languages of blocks that are neither run nor read by this test, and why."""

NOT_RUN = dict(
    rows_of("""
--gui | needs a display
--scheduler | needs a cluster
CCRm.xosc | needs a file of Euro NCAP; test_openscenario_catalogues.py reads and drives it
drive | needs somebody at the wheel; tests/wheel has bots there
dlr_highway | needs a recording; test_recorded_people_example.py runs it where the wheel tasi is
afternoon/ratings.csv | needs a study's ratings; tests/cli/test_as_typed.py has some
people.toml
| needs a recording; test_recorded_people_example.py runs these lines where the wheel tasi is
afternoon/evaluation.toml | needs a study; tests/wheel has one
/work/evaluation.toml | a path inside a container
cut_in-0042-mine | needs a night with that case; tests/cli/test_compare.py drives one again so
nights/nights/2026-11-21T02-00-00Z
| compares it with that night; tests/cli/test_compare.py does so
qualify | takes minutes; tests/studies runs its parts
""")
)
"""Commands that are read and not run, by a word in them, and why."""

READERS = {
    "evaluation": {field.name for field in fields(EvaluationSettings)},
    "scenario": {"road", "end", "ego", "require", "joint", "met", "recorded"},
}
"""Keys of fragments: an evaluation's, and a scenario file's."""

ELSEWHERE = dict(
    rows_of("""
make quick
| .ci/run runs `make test` and `make check`; quick is a part of the first, the others take long
make score | tests/golden/test_golden.py runs this evaluation and compares README's table
make test | .ci/run runs it
tests/golden/golden.py | tests/golden/test_golden.py compares what this one does
tools/release.py | tests/tools/test_release.py runs it in a clone
-m venv .venv | Makefile does the same before .ci/run has anything to run
openssl | tests/record/test_cluster_tls.py runs it word for word
DASK_DISTRIBUTED__ | tests/record/test_cluster_tls.py runs it word for word
kind: Job | needs Kubernetes; the shards are those of tests/record/test_resume.py
[[feature]] | needs a policy; tests/learning/test_onnx.py drives one through such a file
learned/cut_in.toml | needs what `learn` wrote; tests/rates has that
project.entry-points | tests/scenario/test_formats.py installs such a package
consent | needs people who rate; tests/wheel/test_study.py has bots
train_ppo.py | trains for minutes; tests/learning/test_examples_of_learning.py trains a little
paper_example.py | draws for minutes; tests/golden/test_golden.py drives the same evaluation
num_timesteps | what that training printed
""")
) | {
    "pip install .\n": "Makefile does the same before .ci/run has anything to run",
    "old path  ": "a table",
}
"""Blocks that this test only reads, by a text in them, and what runs them or why nothing here
can."""

BASE_EVALUATION = tomllib.loads("""
name = "base"
scenario = [{ use = "front_vehicle_low_speed" }]
ads = [{ name = "idm", controller = "idm" }]
""")


@pytest.fixture(scope="module")
def small_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("desk")
    Desk(folder, folder).lay_out()
    sumo_eval("run evaluation.toml --out run", cwd=folder)
    return folder / "run"


@pytest.fixture
def desk(small_run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Desk(tmp_path, small_run)


# --- commands -------------------------------------------------------------------------------------


def read(words):
    """Have the program's own parser read a command: names, options, types of values, how many
    arguments."""
    context = click.Context(main, info_name="sumo-eval")
    name, command, rest = main.resolve_command(context, words)
    if isinstance(command, click.Group) and rest:
        context = click.Context(command, parent=context)
        name, command, rest = command.resolve_command(context, rest)
    with command.make_context(name, list(rest), parent=context):
        pass


@pytest.mark.parametrize("page", PAGES)
def test_the_programs_own_parser_reads_every_command_of_a_block(page):
    for block in BLOCKS:
        for words in block.commands() if block.page == page else ():
            read(words)


@pytest.mark.parametrize("page", PAGES)
def test_every_command_within_a_text_exists_with_its_options(page):
    for words in mentioned(page):
        if words[0].startswith("-"):
            continue
        assert words[0] in commands(), words
        command = main.get_command(click.Context(main), words[0])
        if isinstance(command, click.Group) and len(words) > 1:
            command = command.get_command(click.Context(command), words[1])
            assert command is not None, words
        known = {name for item in command.params for name in (*item.opts, *item.secondary_opts)} | {
            "--help"
        }
        assert {word.partition("=")[0] for word in words if word.startswith("--")} <= known, words


def why_not_run(words):
    return next((reason for word, reason in NOT_RUN.items() if word in words), "")


def commands_to_run():
    """Words of every command of a shell block or a pipeline, by the command as it is typed."""
    found = {}
    for block in BLOCKS:
        for words in block.commands():
            if not why_not_run(words):
                found.setdefault(shlex.join(words), words)
    return found


TO_RUN = commands_to_run()


def first_of_each_command():
    """What is typed: each command once in the suite, all of it in the campaign."""
    seen = set()
    found = []
    for typed, words in TO_RUN.items():
        rare = words[0] in seen
        found.append(in_campaign(typed) if rare else typed)
        seen.add(words[0])
    return found


@pytest.mark.parametrize("typed", first_of_each_command())
def test_every_command_of_a_block_runs_over_few_points(typed, desk):
    words = TO_RUN[typed]
    desk.lay_out()
    write_needs(words, desk.folder)
    sumo_eval(*desk.stand_in(list(words)))


def test_reasons_not_to_run_a_command_are_all_used():
    found = [words for block in BLOCKS for words in block.commands()]
    assert {word for word in NOT_RUN if any(word in words for words in found)} == set(NOT_RUN)


def test_shell_can_read_every_block_of_it():
    for block in BLOCKS:
        if block.language in ("sh", "bash"):
            text = re.sub(r"^[AB]\$ ", "", block.text, flags=re.M)
            checked = subprocess.run(
                ["bash", "-n"], input=text, text=True, capture_output=True, check=False
            )
            assert checked.returncode == 0, (block.place, checked.stderr)


def test_other_programs_that_blocks_call_are_there():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    makefile = (ROOT / "Makefile").read_text()
    for block in BLOCKS:
        if block.language not in CODE:
            continue
        for path in re.findall(r"python3? (\w[\w/]+\.py)", block.text):
            assert (ROOT / path).is_file(), (block.place, path)
        for target in re.findall(r"^make (\w+)", block.text, flags=re.M):
            assert re.search(rf"^{target}:", makefile, flags=re.M), (block.place, target)
        for extra in re.findall(r"pip install '[\w.]+\[(\w+)\]'", block.text):
            assert extra in extras, (block.place, extra)


# --- TOML and YAML --------------------------------------------------------------------------------


def reader_of(content):
    """Which file of the program a block of TOML is, by its keys."""
    keys = set(content)
    for name, marks in values_of("""
    "scenario", {"parameter"}
    "gate", {"limit"}
    "study", {"consent"}
    "features", {"feature"}
    "mapping", {"distribution", "parameters"}
    "campaign", {"budget", "ads"}
    """):
        if marks <= keys:
            return name
    (name,) = [name for name, known in READERS.items() if keys <= known]
    return name


OF_FILES = {
    "gate": read_gate,
    "study": read_study,
    "features": read_interface,
    "mapping": lambda path: read_mapping(path, catalogue.load("cut_in")),
    "campaign": read_campaign,
}
"""What reads a file of each kind that a block holds as a whole."""


def whole_scenario(content, folder):
    """A scenario file with these parts; those of a shipped one where the block does not say."""
    if "parameter" in content:
        return content
    if "joint" in content or "met" in content:
        base = files("cut_in")
        names = [one["name"] for one in base["parameter"]]
        rows = [f"{20 + k},{10 + k % 3},{30 + (7 * k) % 11},{1 + 0.1 * (k % 4)}" for k in range(8)]
        (folder / content["joint"]["events"]).write_text("\n".join([",".join(names), *rows]) + "\n")
        return {**base, **content}
    base = files("front_vehicle_low_speed")
    if "road" in content and "ego" in content:
        return {**base, **content, "ego": {**base["ego"], **content["ego"]}}
    return {**base, **content}


def files(name):
    return tomllib.loads(scenario_files()[name].read_text())


@pytest.mark.parametrize(
    "block", [one for one in BLOCKS if one.language == "toml"], ids=lambda one: one.place
)
def test_the_programs_own_reader_reads_every_block_of_toml(block, desk):
    """A whole file, or a part of one within the smallest whole."""
    if "consent" in block.text:
        shutil.copytree(desk.run, desk.folder / "results" / "first")
    content, file = tomllib.loads(block.text), desk.folder / "block.toml"
    kind = reader_of(content)
    if kind == "evaluation":
        settings_from({**BASE_EVALUATION, **content}, "a block")
    elif kind == "scenario":
        scenario_from(whole_scenario(content, desk.folder), "a block", desk.folder)
    else:
        file.write_text(block.text)
        OF_FILES[kind](file)


NOT_DRIVEN = dict(
    rows_of("""
[joint] | a road test's events, which learning and exposure read; a drive knows nothing of them
[recorded] | which recordings are like a scenario; needs recordings
source = "recorded" | needs a recording; test_recorded_people_example.py has one
kind = "recorded" | needs a recording; tests/drivers has some
CarlaAgent | needs an agent of CARLA; tests/ads/test_adapters.py has one
fmu: | needs an FMU; tests/cosim/test_fmu.py builds one
simulation.plant | needs an FMU; tests/cosim/test_fmu.py builds one
ros2_node.py | needs ROS 2; tests/ads/test_ros2.py has a stand-in
weights.onnx | a planner of the reader's own, with its weights
.xosc | needs a file of OpenSCENARIO; test_openscenario_catalogues.py drives them
qualification = | a run names its qualification; it changes no drive
""")
) | {
    "folder = ": "needs the reader's own copy of a catalogue; test_openscenario_catalogues.py "
    "drives them",
}
"""Blocks of scenarios and evaluations that are read and not driven, by a text in them, and why."""


def is_gate(block):
    """Whether a block is a gate file."""
    return block.language == "toml" and reader_of(tomllib.loads(block.text)) == "gate"


def drivable(block):
    """Whether a block of TOML says something of a drive, and what it needs is here."""
    if block.language != "toml" or any(text in block.text for text in NOT_DRIVEN):
        return False
    return reader_of(tomllib.loads(block.text)) in ("scenario", "evaluation")


@pytest.mark.parametrize(
    "block", [one for one in BLOCKS if drivable(one)], ids=lambda one: one.place
)
def test_the_first_point_of_a_scenario_or_an_evaluation_of_a_block_is_driven(block, desk):
    desk.lay_out()
    content = tomllib.loads(block.text)
    if reader_of(content) == "scenario":
        logical = scenario_from(whole_scenario(content, desk.folder), "a block", desk.folder)
        controllers, simulation = ["idm"], SimulationSettings()
    else:
        settings = settings_from({**BASE_EVALUATION, **content}, "a block")
        (first, *_) = expanded(settings.scenario, desk.folder)
        logical = catalogue.find(first.use, desk.folder)
        controllers, simulation = [ads.locator for ads in settings.ads], settings.simulation
    point = dict(zip(logical.names, sample(logical).points[0].tolist(), strict=True))
    for controller in controllers:
        recording = simulate(logical.concrete(**point), controller, simulation, folder=desk.folder)
        assert recording.end_reason not in ("ads_error", "sim_error"), recording.error


def test_reasons_not_to_drive_a_block_are_all_used():
    assert {text for text in NOT_DRIVEN if any(text in block.text for block in BLOCKS)} == set(
        NOT_DRIVEN
    )


def test_every_block_of_yaml_can_be_read():
    for block in BLOCKS:
        if block.language == "yaml":
            assert isinstance(yaml.safe_load(block.text), dict), block.place


# --- Python, and programs -------------------------------------------------------------------------

BEHIND = at_values("front_vehicle_low_speed", ego_speed=20.0, lead_speed=10.0)
PYTHON = [block for block in BLOCKS if block.language == "python"]
STAND_INS = {
    "sumo_eval.evaluate(\n": [
        ('"sampling": {"levels": 3}', '"sampling": {"levels": 2}'),
        (
            '"name": "mine",\n',
            '"name": "mine", "run": {"engine": "serial"}, "drivers": {"count": 2},\n',
        ),
    ],
    "front_vehicle_cut_out-0042-mine": [
        ("front_vehicle_cut_out-0042-mine", "front_vehicle_low_speed-0000-idm")
    ],
    "num_envs=512": [("num_envs=512", "num_envs=8")],
    '"name": "first look"': [('"seed": 1,', '"seed": 1, "run": {"engine": "serial"},')],
}
"""What stands in a dear block of Python for what it says: text of the block -> (old, new)."""


@pytest.mark.parametrize("block", PYTHON, ids=lambda one: one.place)
def test_every_block_of_python_runs(block, desk):
    desk.lay_out()
    text = block.text
    for marker, changes in STAND_INS.items():
        for old, new in changes if marker in text else ():
            assert old in text
            text = text.replace(old, new)
    if "open_run(" in text:
        shutil.copytree(desk.run, desk.folder / "results" / "night")
    space = {}
    exec(compile(text, block.place, "exec"), space)
    if "env" in space:
        space["env"].close()
        space["envs"].close()
    ads = next((space[name] for name in ("MyAds", "Platoon", "acc") if name in space), None)
    if ads is not None:
        recording = simulate(BEHIND, ads() if isinstance(ads, type) else ads)
        assert recording.end_reason != "ads_error", recording
        assert recording.collision is None or "Platoon" in space


def test_the_controller_in_shell_drives(tmp_path):
    program = tmp_path / "ads.sh"
    program.write_text(code_of("docs/ads/exec.md", "read -r briefing"))
    program.chmod(0o755)
    recording = clear_drive(BEHIND, f"exec:{program}")
    assert recording.end_reason == "standstill"  # it brakes as long as it sees somebody


@pytest.mark.parametrize(
    "block", [one for one in BLOCKS if is_gate(one)], ids=lambda one: one.place
)
def test_a_gate_of_a_block_judges_a_run_beside_itself(block, desk):
    text = block.text.replace('"mine"', '"idm"').replace('"cut_in"', '"front_vehicle_low_speed"')
    (desk.folder / "gate.toml").write_text(text)
    sumo_eval("compare", desk.run, desk.run, "--gate", "gate.toml")


# --- all of them ----------------------------------------------------------------------------------


def treated(block):
    """`run` in this file, `read` by the program's own reader, or `marked` as a language that
    neither is done to."""
    if block.language in MARKED:
        return "marked"
    if (
        block.language == "python"
        or "read -r briefing" in block.text
        or drivable(block)
        or is_gate(block)
    ):
        return "run"
    return "run" if any(not why_not_run(words) for words in block.commands()) else "read"


def why_only_read(block):
    """What runs a block that is read here, or why nothing can; empty where nobody has said so."""
    texts = {**ELSEWHERE, **(NOT_DRIVEN if block.language == "toml" else {})}
    said = (reason for text, reason in texts.items() if text in block.text)
    return next(filter(None, map(why_not_run, block.commands())), "") or next(said, "")


def test_no_block_is_of_a_language_that_nothing_treats():
    assert {block.language for block in BLOCKS} <= {*MARKED, *CODE, "python", "toml"}
    drawn = [block for block in BLOCKS if block.language in ("", "groovy")]
    assert len(drawn) == 6, (
        "a block without a language is a drawing or what a command printed: count it here"
    )


def test_every_block_runs_or_says_what_runs_it_or_why_nothing_can():
    only_read = [block for block in BLOCKS if treated(block) == "read"]
    assert [block.place for block in only_read if not why_only_read(block)] == []
    assert {text for text in ELSEWHERE if any(text in block.text for block in only_read)} == set(
        ELSEWHERE
    )


def test_what_a_reason_says_to_run_a_block_is_there():
    for reason in (*NOT_RUN.values(), *NOT_DRIVEN.values(), *ELSEWHERE.values()):
        for name in re.findall(r"[\w./]+\.py|tests/\w+", reason):
            assert (ROOT / name).exists() or list((ROOT / "tests").rglob(name)), reason
