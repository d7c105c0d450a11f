"""Environments to learn in: what gymnasium asks of them, and that a drive there is a drive in an
evaluation."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from refusals import refusal
from road_scenes import at_values, central_case

import sumo_eval.gym
from sumo_eval.cosim import episode_rows, simulate
from sumo_eval.cosim.episode_rows import EpisodeRows
from sumo_eval.extras.gym.episodes import Transition
from sumo_eval.gym import Action, Feature, Interface, usual, usual_reward
from sumo_eval.scenario import catalogue
from sumo_eval.settings import ConditionSettings, SimulationSettings, VehicleSettings

POINT = {"ego_speed": 25.0, "obstacle_speed": 10.0, "gap": 60.0}
RAW = Interface((Feature("ego.x"), Feature("ego.y"), Feature("ego.speed"), Feature("lead.gap"),
    Feature("time")),
                (Action("acceleration"),))  # fmt: skip


_OPEN = []


def make(*arguments, **options):
    """An environment; libsumo holds one, so that of before is closed."""
    close()
    _OPEN.append(gymnasium.make(*arguments, **options))
    return _OPEN[-1]


def make_vec(*arguments, **options):
    close()
    _OPEN.append(gymnasium.make_vec(*arguments, **options))
    return _OPEN[-1]


def close():
    while _OPEN:
        _OPEN.pop().close()


@pytest.fixture(autouse=True)
def _closed():
    yield
    close()


@pytest.mark.parametrize("scenario", catalogue.SCENARIOS)
def test_gymnasium_accepts_the_environment_of_every_scenario(scenario):
    logical = catalogue.load(scenario)
    bent = logical.road.bent
    if central_case(scenario).lively:
        with refusal("time alone to be learned in, and lanes that neither open nor end"):
            make(f"sumo_eval/{scenario}-v0", steering=True).reset()
        return
    if bent:
        with refusal("on a curved road needs `sumo=False`"):
            make(f"sumo_eval/{scenario}-v0", steering=True, sumo=True).reset()
        close()
    env = make(f"sumo_eval/{scenario}-v0", steering=True, sumo=not bent)
    check_env(env.unwrapped)
    assert env.unwrapped.action_space.shape == (2,)


@pytest.mark.parametrize(
    "scenario, values",
    [
        ("front_vehicle_cut_out", POINT),
        ("front_vehicle_cut_out", {**POINT, "gap": 30.0}),
        ("cut_in", {}),
        ("front_vehicle_braking", {}),
    ],
)
def test_a_drive_in_the_environment_is_a_drive_in_sumo(scenario, values):
    """The ego brakes gently and steers a little; SUMO steps one of both drives."""
    settings = SimulationSettings(record_interval=0.05, time_limit=12.0)
    interface = Interface(RAW.features, (Action("acceleration"), Action("steering")))
    env = make(f"sumo_eval/{scenario}-v0", interface=interface, settings=settings, sumo=True)
    seen, info = env.reset(seed=1, options=values)

    def answer(time):
        return -1.5 if time > 1.01 else 0.5, 0.02 if 2.01 < time < 3.01 else 0.0

    env.close()
    concrete = at_values(scenario, **info["values"])
    recording = simulate(concrete, lambda observation: answer(observation.time), settings)
    seen, info = env.reset(options=info["values"])
    rows, ended = [seen], False
    while not ended:
        seen, _, terminated, truncated, info = env.step(np.array(answer(len(rows) * 0.05 - 0.05)))
        rows.append(seen)
        ended = terminated or truncated
    assert info["end_reason"] == recording.end_reason
    ego = recording.ego
    assert len(rows) == len(ego.time)
    there = np.array(rows)[:-1, :3]
    # float32 of 1000 m
    assert there == pytest.approx(np.column_stack([ego.x, ego.y, ego.speed])[:-1], abs=2e-4)
    last = env.unwrapped.episodes.rows.world.egos[0]
    assert float(last["x"]) == pytest.approx(ego.x[-1], abs=1e-9)
    for j, other in enumerate(recording.actors.values()):
        assert float(env.unwrapped.episodes.rows.world.others[0, j]["x"]) == pytest.approx(
            other.x[-1], abs=1e-6
        )


def test_an_episode_does_not_depend_on_its_company_nor_on_those_before_it():
    settings = SimulationSettings(time_limit=4.0)
    interface = replace(usual(), features=(*usual().features, Feature("time")))
    options = {"settings": settings, "interface": interface}
    vector = make_vec(
        "sumo_eval/cut_in-v0", num_envs=5, autoreset_mode=AutoresetMode.SAME_STEP, **options
    )
    seen, _ = vector.reset(seed=7)
    single = gymnasium.make("sumo_eval/cut_in-v0", **options)
    drawn = np.random.default_rng(3)
    episodes = [{"seen": [seen[row]], "actions": []} for row in range(5)]
    finished = []
    points = [dict(it.values) for it in vector.unwrapped.episodes.rows.world.cases]
    for _ in range(200):
        actions = drawn.uniform(-1.0, 1.0, (5, 1)).astype(np.float32)
        before = list(points)
        seen, _, terminated, truncated, info = vector.step(actions)
        points = [dict(it.values) for it in vector.unwrapped.episodes.rows.world.cases]
        for row in range(5):
            episodes[row]["actions"].append(actions[row])
            over = terminated[row] or truncated[row]
            episodes[row]["seen"].append(info["final_obs"][row] if over else seen[row])
            if over:
                finished.append((before[row], episodes[row], info["end_reason"][row]))
                episodes[row] = {"seen": [seen[row]], "actions": []}
    assert len(finished) >= 10
    for values, episode, reason in finished[::3]:
        first, _ = single.reset(options=values)
        told = [first]
        for action in episode["actions"]:
            seen, _, terminated, truncated, info = single.step(action)
            told.append(seen)
        assert info["end_reason"] == reason
        np.testing.assert_allclose(np.array(told), np.array(episode["seen"]), atol=1e-6)


def test_the_next_step_mode_gives_a_first_observation_and_no_reward():
    vector = make_vec(
        "sumo_eval/cut_in-v0", num_envs=3, settings=SimulationSettings(time_limit=0.5)
    )
    vector.reset(seed=0)
    for _ in range(10):
        _, worth, terminated, truncated, info = vector.step(np.zeros((3, 1)))
    assert truncated.all()
    assert not terminated.any()
    assert list(info["end_reason"]) == ["time_limit"] * 3
    assert (worth > 0.0).all()
    seen, worth, terminated, truncated, _ = vector.step(np.zeros((3, 1)))
    assert not worth.any()
    assert not (terminated | truncated).any()
    np.testing.assert_array_equal(seen, vector.unwrapped.episodes.show())
    assert (vector.unwrapped.episodes.rows.world.egos["time"] == 0.0).all()


def test_several_environments_and_a_simulation_live_in_one_process():
    """Two environments take turns, with an evaluation's simulation in between; each as if it were
    alone."""

    def run(turns):
        envs = [gymnasium.make("sumo_eval/cut_in-v0") for _ in range(turns)]
        for number, env in enumerate(envs):
            env.reset(seed=number)
        told = [[] for _ in envs]
        for k in range(40):
            for number, env in enumerate(envs):
                told[number].append(env.step(np.array([0.1 * number], dtype=np.float32))[0])
            if k == 20:
                simulate(at_values("front_vehicle_cut_out", **POINT), "idm")
        for env in envs:
            env.close()
        return [np.array(one) for one in told]

    one = run(1)
    two = run(2)
    np.testing.assert_array_equal(one[0], two[0])
    assert not np.array_equal(two[0], two[1])


def test_a_second_simulation_in_the_process_is_refused_with_the_way_out():
    make("sumo_eval/cut_in-v0", sumo=True).reset(seed=0)
    with refusal("close the other environment first, or make this one with `sumo=False`"):
        gymnasium.make("sumo_eval/cut_in-v0", sumo=True).reset(seed=0)


def test_what_sumo_shows_is_what_the_scripts_say():
    """Twelve episodes beside each other, many of which begin anew, with SUMO and without: the same,
    to rounding."""
    told = []
    for sumo in (True, False):
        vector = make_vec(
            "sumo_eval/cut_in-v0",
            num_envs=12,
            settings=SimulationSettings(time_limit=6.0),
            sumo=sumo,
        )
        vector.reset(seed=3)
        drawn = np.random.default_rng(1)
        steps = [vector.step(drawn.uniform(-0.2, 1.0, (12, 1))) for _ in range(400)]
        told.append(
            (
                np.array([step[0] for step in steps]),
                [list(it[4].get("end_reason", ())) for it in steps],
            )
        )
    np.testing.assert_allclose(told[0][0], told[1][0], atol=1e-6)
    assert told[0][1] == told[1][1]
    reasons = {reason for step in told[0][1] for reason in step}
    assert {"contact", "time_limit"} <= reasons
    assert "sim_error" not in reasons


def test_reset_takes_a_point_part_of_one_or_a_sampler():
    env = make("sumo_eval/front_vehicle_cut_out-v0")
    assert env.reset(options=POINT)[1]["values"] == POINT
    values = env.reset(seed=4, options={"gap": 50.0})[1]["values"]
    assert values["gap"] == 50.0
    assert env.reset(seed=4, options={"gap": 50.0})[1]["values"] == values
    assert env.reset(seed=5, options={"gap": 50.0})[1]["values"] != values
    assert env.reset(options={"sampler": lambda generator: POINT})[1]["values"] == POINT
    with refusal(r"Unknown parameter `gab` of scenario .*\. Did you mean `gap`"):
        env.reset(options={"gab": 50.0})
    with refusal("`gap` of scenario `front_vehicle_cut_out` must be within"):
        env.reset(options={**POINT, "gap": 1e6})
    with refusal("The sampler must give a number for each parameter"):
        env.reset(options={"sampler": lambda generator: 3})


def test_a_gap_is_from_the_bumper_of_the_ego_in_the_settings():
    settings = SimulationSettings(vehicle=VehicleSettings(length=6.0))
    env = make("sumo_eval/front_vehicle_low_speed-v0", interface=RAW, settings=settings)
    seen, _ = env.reset(options={"ego_speed": 20.0, "lead_speed": 10.0})
    assert seen[3] == pytest.approx(3.5 * 20.0)


def test_the_usual_reward_by_hand():
    """0.05 s each.

    Cruising at 20 of 20 m/s: 0.05. At 10 m/s braking by 3 m/s2: (0.5 - 0.1) 0.05 = 0.02. A contact
    at 30 of 20 m/s with 5 m/s between both: 0.05 - 20 - 2 * 5. A jerk of 15 m/s3 at standstill:
    -0.01 * 0.05.
    """
    it = Transition(
        seen=None, command=np.zeros((4, 2)), speed=np.array([20.0, 10.0, 30.0, 0.0]),
        acceleration=np.array([0.0, -3.0, 0.0, 0.0]), jerk=np.array([0.0, 0.0, 0.0, 15.0]),
        start_speed=np.full(4, 20.0), running=np.ones(4, bool),
        ended=np.array(["", "", "contact", ""]),
        impact=np.array([0.0, 0.0, 5.0, 0.0]), step=0.05,
    )  # fmt: skip
    assert usual_reward(it) == pytest.approx([0.05, 0.02, 0.05 - 30.0, -0.0005])


def test_a_reward_of_the_user_is_asked_at_every_step_of_the_simulation():
    """A period of 0.2 s holds four steps of 0.05 s, of which each is worth 1."""
    interface = Interface(RAW.features, RAW.actions, period=0.2)
    env = make("sumo_eval/cut_in-v0", interface=interface, reward=lambda it: np.ones(len(it.speed)))
    env.reset(seed=0)
    seen, worth, *_ = env.step(np.zeros(1))
    assert worth == 4.0
    assert seen[4] == pytest.approx(0.2)


def test_a_contact_ends_an_episode_with_its_impact_speed():
    """Full speed into an obstacle that is 15 m/s slower."""
    found = []

    def reward(it):
        found.append((str(it.ended[0]), float(it.impact[0])))
        return np.zeros(1)

    env = make("sumo_eval/front_vehicle_cut_out-v0", interface=RAW, reward=reward)
    env.reset(options={**POINT, "gap": 30.0})
    ended = False
    while not ended:
        _, _, ended, truncated, _ = env.step(np.zeros(1))
        assert not truncated
    reason, impact = found[-1]
    assert reason == "contact"
    assert impact == pytest.approx(15.0, abs=1e-9)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(1))


@pytest.mark.parametrize("sumo", [False, True])
def test_max_episode_steps_truncates_one_and_many(sumo):
    """Five answers: the fifth ends the episode, the next step of many begins another."""
    one = make("sumo_eval/cut_in-v0", max_episode_steps=5, sumo=sumo)
    one.reset(seed=0)
    assert [one.step(np.zeros(1))[3] for _ in range(5)] == [False] * 4 + [True]
    many = make_vec("sumo_eval/cut_in-v0", num_envs=2, max_episode_steps=5, sumo=sumo)
    many.reset(seed=0)
    steps = [many.step(np.zeros((2, 1))) for _ in range(12)]
    assert [bool(step[3].all()) for step in steps] == ([False] * 4 + [True, False]) * 2
    assert list(steps[4][4]["end_reason"]) == ["step_limit"] * 2


def test_a_second_reset_before_the_first_step_begins_its_own_point():
    """SUMO still has the vehicles of the first reset's point at their starts."""
    interface = Interface(RAW.features, (Action("acceleration"),))
    env = make("sumo_eval/cut_in-v0", interface=interface, sumo=True)
    for speed in (30.0, 20.0):
        _, info = env.reset(seed=0, options={"ego_speed": speed})
    assert not env.step(np.zeros(1))[3]
    assert info["values"]["ego_speed"] == 20.0


def test_an_action_of_a_discrete_set_is_its_values():
    """Two accelerations by three angles: action 4 is the second and the second."""
    set_of = Action("acceleration", values=(-2.0, 1.0)), Action("steering", values=(-0.1, 0.0, 0.1))
    asked = []
    env = make(
        "sumo_eval/cut_in-v0",
        interface=Interface(RAW.features, set_of),
        reward=lambda it: (asked.append(it.command[0].tolist()), np.zeros(1))[1],
    )
    assert env.action_space == gymnasium.spaces.Discrete(6)
    env.reset(seed=0)
    for action in (0, 4):
        env.step(action)
    assert asked == [[-2.0, -0.1], [1.0, 0.0]]
    for wrong in (6, [1, 2]):
        with refusal("whole numbers from 0 to 5"):
            env.step(wrong)
    with refusal("given for every action or for none"):
        Interface(RAW.features, (set_of[0], Action("steering")))


def test_refused_choices_name_their_right_number():
    choice = (Action("acceleration", values=(-2.0, 1.0)),)
    many = make_vec("sumo_eval/cut_in-v0", num_envs=2, interface=Interface(RAW.features, choice))
    many.reset(seed=0)
    with refusal("whole numbers from 0 to 1, 2 in all"):
        many.step(np.array([0, 1, 1]))


def test_what_the_environment_cannot_do_is_refused():
    with refusal("nothing in `conditions`"):
        make(
            "sumo_eval/cut_in-v0",
            settings=SimulationSettings(conditions=ConditionSettings(dropout=0.1)),
        ).reset()
    with refusal("`period` of the interface must be a multiple of `simulation.step`"):
        make("sumo_eval/cut_in-v0", interface=Interface(RAW.features, RAW.actions, period=0.07))
    with refusal(r"Unknown feature `lead\.gab`\. Did you mean `lead\.gap`"):
        Feature("lead.gab")
    many = make_vec("sumo_eval/cut_in-v0", num_envs=2)
    many.reset()
    for reward in (np.array([np.nan, 1.0]), np.ones(3), [1.0], None, "1", [1, [2]], [None, 1]):
        worthless = make_vec("sumo_eval/cut_in-v0", num_envs=2, reward=lambda it, r=reward: r)
        worthless.reset()
        with refusal("The reward of an environment must be a finite number for each of 2 episodes"):
            worthless.step(np.zeros((2, 1)))
    ragged = [[0.0], [0.0, 1.0]]
    for actions, got in (
        (np.zeros((2, 3)), r"\(2, 3\)"), ("x", "'x'"), ([None, 1], "None"), (ragged, "1.0"),
    ):  # fmt: skip
        with refusal(rf"must be 2 x 1 numbers, got .*{got}"):
            many.step(actions)
    for name, kind in (("settings", "SimulationSettings"), ("interface", "Interface")):
        with refusal(rf"`{name}` of an environment must be of {kind}, got {{'step': 0.1}}"):
            make("sumo_eval/cut_in-v0", **{name: {"step": 0.1}})
    with refusal(r"Unknown logical scenario `my\.toml`|There is no scenario file"):
        make("sumo_eval/scenario-v0", use=Path("my.toml"))
    with refusal("must be reset before its first step"):
        make("sumo_eval/cut_in-v0").unwrapped.step(np.zeros(1))


def test_rows_restart_without_actors_and_keep_no_history():
    concrete = replace(at_values("front_vehicle_cut_out", **POINT), actors=())
    rows = EpisodeRows([concrete], SimulationSettings(), sumo=False)

    def held():
        return sum(it.nbytes for it in vars(rows.world).values() if isinstance(it, np.ndarray))

    before = held()
    for _ in range(200):
        rows.step(np.zeros((1, 2)))
        rows.restart(0, concrete)
    assert held() == before


def test_sumo_ends_with_a_start_that_fails(monkeypatch):
    concrete = at_values("front_vehicle_cut_out", **POINT)
    monkeypatch.setattr(episode_rows, "Stage", None)  # stands for any error of the start
    with pytest.raises(TypeError):
        EpisodeRows([concrete], SimulationSettings(), sumo=True)
    monkeypatch.undo()
    EpisodeRows([concrete], SimulationSettings(), sumo=True).close()


def test_every_scenario_is_registered_once():
    sumo_eval.extras.gym.register()
    for scenario in catalogue.SCENARIOS:
        assert f"sumo_eval/{scenario}-v0" in gymnasium.registry


def test_the_first_reset_begins_all_whatever_its_mask():
    vector = make_vec("sumo_eval/cut_in-v0", num_envs=3)
    _, masked = vector.reset(seed=4, options={"reset_mask": np.zeros(3, dtype=np.bool_)})
    _, again = vector.reset(seed=4)
    assert masked["values"].tolist() == again["values"].tolist()
    assert len({tuple(values.items()) for values in masked["values"]}) == 3


def test_an_environment_without_a_new_seed_continues_its_random_numbers():
    """As with gymnasium's own vectors: where a seed is None, and outside the mask."""

    def points(*resets):
        vector = make_vec("sumo_eval/cut_in-v0", num_envs=3, autoreset_mode=AutoresetMode.DISABLED)
        return [vector.reset(**how)[1]["values"].tolist() for how in resets][-1]

    some = {"reset_mask": np.array([True, False, False])}
    plain = points({"seed": 4}, {})
    assert points({"seed": 4}, {"seed": [None, None, None]}) == plain
    assert points({"seed": 4}, {"seed": [None, 7, 8], "options": some}, {})[1:] == plain[1:]


def test_actions_of_another_shape_are_refused_not_rearranged():
    vector = make_vec("sumo_eval/cut_in-v0", num_envs=3, steering=True)
    vector.reset(seed=0)
    for wrong in (np.zeros((2, 3)), np.zeros(6)):
        with refusal(rf"must be 3 x 2 numbers, got \({', '.join(map(str, wrong.shape))}"):
            vector.step(wrong)
    vector.step(np.zeros((3, 2)))


def test_law_what_a_reward_does_with_its_arrays_changes_no_drive():
    kept = []

    def harmless(it):
        return it.speed - 20.0

    def in_place(it):
        kept.append((it.speed.copy(), it))
        for array in (it.acceleration, it.command, it.start_speed, it.seen.ego.speed):
            array -= 20.0
        error = it.speed[:]
        error -= 20.0
        return error

    def drive(reward):
        vector = make_vec("sumo_eval/cut_in-v0", num_envs=2, interface=RAW, reward=reward)
        vector.reset(seed=1)
        return [[told.tolist() for told in vector.step(np.ones((2, 1)))[:2]] for _ in range(3)]

    assert drive(in_place) == drive(harmless)
    assert all((was - 20.0 == it.speed).all() for was, it in kept)
