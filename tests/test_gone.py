"""Removed names answer with one sentence that says what to use instead."""

import pytest
from commands import cli_refuses
from tables import rows_of

from sumo_eval.gone import refuse_command


@pytest.mark.parametrize(
    "arguments, replacement",
    rows_of("""
check UC-1.feature.md | `[[require]]` of a scenario file
partition UC-1.feature | `[[require]]` of a scenario file
import UC-1.feature.md | `[[require]]` of a scenario file
import autoware --folder . | `[[require]]` of a scenario file
import --steps | `[[require]]` of a scenario file
humans similarity RUN | tslearn
humans coverage EVALUATION | `recorded_drivers` in cases.csv
humans population | docs/explanation/drivers.md
bench --small --whole | `time sumo-eval run
nightly --install=cron | docs/examples/nights
check sumo_eval.adapters:CarlaAgent?options.agent=my.py:Agent | docs/examples/adapters
"""),
)
def test_removed_name_says_where_it_went(arguments, replacement):
    cli_refuses(replacement, *arguments.split())


def test_folder_of_a_removed_name_is_an_argument():
    refuse_command(["humans", "import", "coverage"])


@pytest.mark.parametrize("use", ['"UC-1.feature.md"', '"autoware"\nfolder = "."'])
def test_removed_scenario_of_an_evaluation_says_where(tmp_path, use):
    evaluation = tmp_path / "evaluation.toml"
    evaluation.write_text(
        f'name = "n"\n[[scenario]]\nuse = {use}\n[[ads]]\nname = "i"\ncontroller = "idm"\n'
    )
    cli_refuses(
        "`[[require]]` of a scenario file", f"run {evaluation} --out {tmp_path}/run --dry-run"
    )


def test_removed_class_says_which_function_makes_its_act():
    with pytest.raises(ImportError, match=r"`Brake` was removed: .*brake_to_stop"):
        exec("from sumo_eval.scenario import Brake")
