"""`onnx:`: a model and its table at the wheel, the same alone and in company; what cannot be used
is refused."""

import itertools
from types import SimpleNamespace

import gymnasium
import numpy as np
import onnx
import pytest
from laid import replace_in
from onnx import TensorProto, helper, numpy_helper
from refusals import refusal
from road_scenes import assert_last

import sumo_eval.gym
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.doors import features
from sumo_eval.cosim.doors.controller import find_controller, load_controller
from sumo_eval.cosim.doors.features import read_interface
from sumo_eval.errors import ControllerError
from sumo_eval.gym import Action, Feature, Interface, usual
from sumo_eval.record.identity import locator_identity
from sumo_eval.scenario import catalogue
from sumo_eval.settings import ConditionSettings, SimulationSettings

CUT_OUT = catalogue.load("front_vehicle_cut_out")
POINT = {"ego_speed": 25.0, "obstacle_speed": 10.0, "gap": 60.0}
SHORT = SimulationSettings(time_limit=15.0)
ACC = Interface(
    (Feature("ego.speed"), Feature("lead.gap", absent=150.0), Feature("lead.relative_speed")),
    (Action("acceleration", -8.0, 3.0),),
)


def write_model(folder, layers, interface,
                rows = "rows", kind = TensorProto.FLOAT):  # fmt: skip
    """Dense layers with tanh between and behind them."""
    nodes, weights, last = [], [], "seen"
    dtype = helper.tensor_dtype_to_np_dtype(kind)
    for k, (matrix, bias) in enumerate(layers):
        weights += [numpy_helper.from_array(matrix.astype(dtype), f"w{k}"),
                    numpy_helper.from_array(bias.astype(dtype), f"b{k}")]  # fmt: skip
        nodes += [helper.make_node("Gemm", [last, f"w{k}", f"b{k}"], [f"z{k}"]),
                  helper.make_node("Tanh", [f"z{k}"], [f"a{k}"])]  # fmt: skip
        last = f"a{k}"
    graph = helper.make_graph(
        nodes, "policy",
        [helper.make_tensor_value_info("seen", kind, [rows, layers[0][0].shape[0]])],
        [helper.make_tensor_value_info(last, kind, [rows, layers[-1][0].shape[1]])], weights,
    )  # fmt: skip
    path = folder / "policy.onnx"
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, path)
    path.with_suffix(".toml").write_text(interface.to_toml())
    return path


def linear(folder):
    """0.05 (gap - 10 - 1.5 v) + 0.4 dv, squashed onto -8..3 m/s2."""
    return write_model(folder, [(np.array([[-0.075], [0.05], [0.4]]), np.array([-0.5]))], ACC)


def deep(folder, **given):
    drawn = np.random.default_rng(5)
    interface = usual(steering=False)
    sizes = [len(interface.features), 64, 64, 1]
    layers = [
        (drawn.normal(0.0, 0.4, (a, b)), drawn.normal(0.0, 0.1, b))
        for a, b in itertools.pairwise(sizes)
    ]
    return write_model(folder, layers, interface, **given)


def driven(path, settings=SHORT):
    return simulate(CUT_OUT.concrete(**POINT), f"onnx:{path}", settings)


def test_a_model_drives_as_its_arithmetic_says(tmp_path):
    """The first answer of the linear model at 25 m/s behind nobody, 150 m: tanh(-1.875 + 7.5 - 0.5)
    is almost 1, so 3 m/s2; the same rule as a plain function drives the same way as far as float32
    allows.
    """

    def rule(seen):
        lead = seen.lead
        gap, closing = (150.0, 0.0) if lead is None else (lead.gap, lead.relative_speed)
        value = np.tanh(-0.075 * seen.ego.speed + 0.05 * gap + 0.4 * closing - 0.5)
        return float(-8.0 + 0.5 * (value + 1.0) * 11.0)

    recording = driven(linear(tmp_path))
    assert recording.error is None
    by_hand = simulate(CUT_OUT.concrete(**POINT), rule, SHORT)
    assert recording.end_reason == by_hand.end_reason
    assert_last(recording, 1e-2, x=by_hand.ego.x[-1])
    assert np.ptp(recording.ego.speed) > 2.0


def test_a_case_does_not_depend_on_its_company(tmp_path):
    """Eleven cases alone, together, and in another order: the bits of a dense network's drives are
    the same."""
    path = deep(tmp_path)
    cases = [CUT_OUT.concrete(**{**POINT, "gap": 40.0 + 5.0 * k}) for k in range(11)]
    alone = [simulate(concrete, f"onnx:{path}", SHORT) for concrete in cases]
    together = list(simulate_many(cases, f"onnx:{path}", SHORT))
    other_way = list(simulate_many(cases[::-1], f"onnx:{path}", SHORT))[::-1]
    for one, two, three in zip(alone, together, other_way, strict=True):
        np.testing.assert_array_equal(one.ego.speed, two.ego.speed)
        np.testing.assert_array_equal(one.ego.x, three.ego.x)
    assert len({it.ego.x[-1] for it in alone}) > 1


def test_a_model_made_for_one_row_drives_too(tmp_path):
    for name in ("any", "one"):
        (tmp_path / name).mkdir()
    usual_one = driven(deep(tmp_path / "any"))
    for kind in ({"rows": 1}, {"kind": TensorProto.DOUBLE}):
        one = driven(deep(tmp_path / "one", **kind))
        assert one.error is None
        assert_last(one, 1e-2, x=usual_one.ego.x[-1])


def test_what_is_seen_in_learning_is_seen_in_an_evaluation(tmp_path):
    """The model at the wheel of the environment and of an evaluation of the same point."""
    path = deep(tmp_path)
    policy = load_controller(f"onnx:{path}").target
    env = gymnasium.make(
        "sumo_eval/front_vehicle_cut_out-v0",
        interface=str(path.with_suffix(".toml")),
        settings=SHORT,
        sumo=False,
    )
    seen, info = env.reset(options=POINT)
    ended = False
    while not ended:
        seen, _, terminated, truncated, info = env.step(policy._answers(seen[None])[0])
        ended = terminated or truncated
    recording = driven(path)
    assert info["end_reason"] == recording.end_reason
    assert float(env.unwrapped.episodes.rows.world.egos[0]["x"]) == pytest.approx(
        recording.ego.x[-1], abs=1e-4
    )


@pytest.mark.parametrize("index", [False, True])
def test_a_model_chooses_from_a_discrete_set(tmp_path, index):
    """By scores, the second is the greatest, or by the index of the greatest."""
    actions = (Action("acceleration", values=(1.0, -2.0, 0.0)),)
    interface = Interface((Feature("ego.speed"),), actions)
    path = write_model(tmp_path, [(np.zeros((1, 3)), np.array([0.1, 0.3, 0.2]))], interface)
    if index:
        model = onnx.load(path)
        model.graph.node.append(helper.make_node("ArgMax", ["a0"], ["i"], axis=1, keepdims=0))
        del model.graph.output[:]
        model.graph.output.append(helper.make_tensor_value_info("i", TensorProto.INT64, ["rows"]))
        onnx.save(model, path)
    recording = driven(path, SimulationSettings(time_limit=1.0))
    assert recording.error is None
    assert_last(recording, 0.2, speed=POINT["ego_speed"] - 2.0)


def test_a_period_holds_each_answer(tmp_path):
    """A model that shows the time as its acceleration, asked every 0.2 s: the held values are 0,
    0.2, 0.4 ..."""
    interface = Interface((Feature("time"),), (Action("acceleration"),), period=0.2)
    path = write_model(tmp_path, [(np.array([[0.1]]), np.array([0.0]))], interface)
    recording = driven(path, SimulationSettings(time_limit=1.0, record_interval=0.05))
    asked = np.tanh(0.1 * 0.2 * (np.arange(20) // 4)).astype(np.float32)
    assert recording.ego.acceleration[1:] == pytest.approx(asked, abs=2e-3)


def test_a_period_that_is_no_whole_number_of_steps_is_refused_before_a_case(tmp_path):
    interface = Interface((Feature("time"),), (Action("acceleration"),), period=0.07)
    path = write_model(tmp_path, [(np.array([[0.1]]), np.array([0.0]))], interface)
    ads = {"name": "net", "controller": f"onnx:{path}"}
    evaluation = {"name": "x", "scenario": [{"use": "cut_in"}], "ads": [ads]}
    with refusal("`period` of ADS `net` must be a multiple of `simulation.step`"):
        sumo_eval.evaluate(evaluation, tmp_path / "run")


def test_its_identity_holds_the_model_and_its_table(tmp_path):
    path = linear(tmp_path)
    before = locator_identity(("ADS", "onnx:policy.onnx"), tmp_path)
    assert "policy.toml" in str(before)
    replace_in(path.with_suffix(".toml"), "3.0", "2.0")
    after = locator_identity(("ADS", "onnx:policy.onnx"), tmp_path)
    assert before != after
    deep(tmp_path)
    assert locator_identity(("ADS", "onnx:policy.onnx"), tmp_path) not in (before, after)


@pytest.mark.parametrize("name", ["w.bin", f"{'w' * 200}.bin"])
def test_its_identity_holds_external_weights_of_any_name(tmp_path, name):
    path, seen = linear(tmp_path), []
    onnx.save(onnx.load(path), path, save_as_external_data=True, location=name, size_threshold=0)
    for _ in range(2):
        seen.append(locator_identity(("ADS", "onnx:policy.onnx"), tmp_path))
        (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[::-1])
    assert seen[0] != seen[1]
    assert name in str(seen[0])


def test_the_example_at_the_top_of_the_tables_file_is_a_table(tmp_path):
    lines = [line[4:] for line in features.__doc__.splitlines() if line.startswith("    ")]
    (tmp_path / "policy.toml").write_text("\n".join(lines))
    assert read_interface(tmp_path / "policy.toml").actions[0].high == 3.0


def test_what_cannot_be_used_is_refused(tmp_path):
    def refused(words, options=""):
        with refusal(words):
            find_controller(f"onnx:policy.onnx{options}", tmp_path)

    with refusal("`mean` of `Feature` must be a number, got nan"):
        Feature("ego.speed", mean=float("nan"), deviation=1.0)
    refused("There is no model")
    path = linear(tmp_path)
    table = path.with_suffix(".toml")
    text = table.read_text()
    table.unlink()
    refused("There is no features table")
    table.write_text(text.replace("lead.gap", "lead.gab"))
    refused(r"\.toml \(line \d+\): Unknown feature `lead\.gab`")
    table.write_text(Interface(ACC.features[:2], ACC.actions).to_toml())
    refused(r"must be of shape \(rows, 2\), as its table has 2 features")
    table.write_text(text)
    refused(r"Unknown output `.*` of model", "?output=value")
    refused("Unknown option", "?feature=a.toml")
    for kind, sentence in (
        (TensorProto.FLOAT, r"must have the shape \(32, 1\) for 32 rows"),
        (TensorProto.FLOAT16, "must be of float or double numbers"),
    ):
        write_model(tmp_path, [(np.ones((3, 2)), np.zeros(2))], ACC, kind=kind)
        refused(sentence)
    model = onnx.load(linear(tmp_path))
    model.graph.node.append(helper.make_node("Softmax", ["a0"], ["s"], axis=0))
    model.graph.output[0].name = "s"
    onnx.save(model, path)
    refused("must answer a row the same alone and among other rows")
    model.ir_version = 99
    onnx.save(model, path)
    refused("cannot be loaded: .* failed: Unsupported model IR version: 99")
    with refusal("cannot be read: it is a folder"):
        find_controller("onnx:", tmp_path)
    path.write_bytes(b"none")
    refused("cannot be loaded")


def test_an_answer_that_is_not_a_number_ends_the_case(tmp_path):
    path = write_model(tmp_path, [(np.array([[np.nan]]), np.array([0.0]))],
                       Interface((Feature("ego.speed"),), (Action("acceleration"),)))  # fmt: skip
    recording = driven(path)
    assert recording.end_reason == "ads_error"
    assert "must be a finite number, got nan" in (recording.error or "")


@pytest.mark.parametrize("output", [np.inf, -np.inf, np.nan])
def test_a_range_makes_no_command_of_an_infinite_output(output):
    assert ACC.commands(np.array([[output], [2.0]]))[:, 0] == pytest.approx(
        [np.nan, 3.0], nan_ok=True
    )


def test_a_choice_that_is_not_there_ends_the_case(tmp_path):
    choices = Interface((Feature("ego.speed"),), (Action("acceleration", values=(-1.0, 0.0)),))
    path = write_model(tmp_path, [(np.zeros((1, 2)), np.array([0.1, 0.3]))], choices)
    policy = load_controller(f"onnx:{path}").target
    policy._chosen = True
    policy._session = SimpleNamespace(run=lambda *_: [np.full(policy._rows, 2)])
    with pytest.raises(ControllerError, match=r"must name choices 0\.\.1, got 2\.\.2"):
        policy._answers(np.zeros((1, 1), np.float32))


def test_arrays_show_the_world_as_it_is_and_conditions_report_it(tmp_path):
    conditions = ConditionSettings(position_noise=1.0)
    settings = SimulationSettings(time_limit=2.0, conditions=conditions)
    recording = driven(linear(tmp_path), settings)
    assert [clip.what for clip in recording.clips if clip.what == "perception_not_limited"]
