"""Gymnasium environments over the logical scenarios: `import sumo_eval.gym` registers
`sumo_eval/<scenario>-v0`.

`gymnasium.make("sumo_eval/cut_in-v0")` runs single cases, `gymnasium.make_vec(..., num_envs=256)`
parallel ones in one process. `sumo_eval/scenario-v0` takes a scenario of your own:
`use="my_scenario.toml"`. Needs the extra `gym`.
"""

from sumo_eval.errors import needs_extra
from sumo_eval.scenario.shipped_files import scenario_files

try:
    import gymnasium
except ImportError as error:
    raise needs_extra("`sumo_eval.gym`", "gym") from error

from sumo_eval.cosim.doors.features import Action, Feature, Interface, read_interface, usual
from sumo_eval.extras.gym.episodes import Transition, usual_reward

__all__ = [
    "Action",
    "Feature",
    "Interface",
    "Transition",
    "read_interface",
    "register",
    "usual",
    "usual_reward",
]


def register() -> None:
    """Register the environments that gymnasium does not have yet."""
    for name in ("scenario", *scenario_files()):
        environment = f"sumo_eval/{name}-v0"
        if environment not in gymnasium.registry:
            gymnasium.register(
                environment,
                entry_point="sumo_eval.extras.gym.env:ScenarioEnv",
                vector_entry_point="sumo_eval.extras.gym.env:ScenarioVectorEnv",
                # `scenario` leaves `use` to the user
                kwargs={} if name == "scenario" else {"use": name},
            )


register()
