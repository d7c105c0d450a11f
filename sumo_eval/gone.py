"""Removed names: one sentence each says what to use instead.

Users: `cli/__init__.py`, `cli/tools.py`, `extras/openscenario/command.py`, `scenario/__init__.py`,
`scenario/catalogue.py`, `scenario/formats.py`, `settings/locators.py`.
"""

from collections.abc import Sequence

from sumo_eval.errors import InputError

MODULES = {
    "sumo_eval.adapters": "copy the adapter from docs/examples/adapters and write "
    "`carla_agent.py:CarlaAgent?options.agent=...`"
}
"""Removed modules that a locator may still name, and what to do instead."""
NAMES = {
    "Brake": "brake_to_stop",
    "ConstantLateral": "constant_lateral",
    "LaneChange": "lane_change",
}
"""Classes of `sumo_eval.scenario`, and the functions that make the same act for
`Actor(acts=...)`."""
COMMANDS = {
    "bench --whole": "`time sumo-eval run --out DIR` measures a whole evaluation, and `run` says "
    "when each stage ends",
    "nightly --install": "copy the files for cron, systemd or GitHub from docs/examples/nights",
    "import --steps": "write the `Then` lines of a use case as `[[require]]` of a scenario file",
    "humans coverage": "a run counts the recorded people behind each D_i: `recorded_drivers` in "
    "cases.csv",
    "humans population": "docs/explanation/drivers.md has the comparison; its script: `git show "
    "a7c0632:sumo_eval/drivers/recorded/population_check.py`",
    "humans similarity": "D and H compare drives; `export RUN` writes trajectories that tslearn "
    "can compare by DTW",
}
"""Removed subcommands and options, as `command word`, and what to do instead."""


def refuse_command(words: Sequence[str]) -> None:
    """Raise InputError where a command line has a removed command or option."""
    for name, instead in COMMANDS.items():
        command, word = name.split()
        # options may stand anywhere, also as `--word=VALUE`; a subcommand follows its command
        candidates = words[1:] if word.startswith("--") else words[1:2]
        if command in words[:1] and word in [it.partition("=")[0] for it in candidates]:
            raise InputError(f"`sumo-eval {name}` was removed: {instead}.")


def refuse_use_case(name: str) -> None:
    """Raise InputError where `name` is a use case written as Gherkin, or the catalogue of them."""
    if name.endswith((".feature.md", ".feature")) or name == "autoware":
        raise InputError(
            f"Use cases as Gherkin tables are not supported any more, got {name}: write the rows "
            "as `[[sample]]` points and the `Then` lines as `[[require]]` of a scenario file "
            "(docs/reference/scenario_file.md)."
        )
