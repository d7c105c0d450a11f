"""The examples of docs/learn.md and of drivers that nobody here wrote: they run, and drive as their
pages say."""

import runpy
import sys
from functools import partial

import numpy as np
import pytest
from loaded import ROOT
from road_scenes import at_values

from sumo_eval.cosim import simulate
from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.settings import SimulationSettings

EXAMPLES = ROOT / "docs" / "examples"
POINT = {"ego_speed": 25.0, "obstacle_speed": 10.0, "gap": 60.0}


@pytest.fixture
def trainer(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    import train_policy

    for name, value in {"PAIRS": 6, "EACH": 2, "HORIZON": 60}.items():
        monkeypatch.setattr(train_policy, name, value)
    yield train_policy
    sys.modules.pop("train_policy")


def check_policy(file, trainer, expected, seconds):
    """The file gives the answers that its trainer expects, to float32, and drives."""
    shape, locator = (50, len(trainer.INTERFACE.features)), f"onnx:{file.name}"
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)
    answers = load_controller(locator, file.parent).target._answers(seen)
    np.testing.assert_allclose(answers, expected(seen), atol=1e-5)
    concrete = at_values("front_vehicle_cut_out", **POINT)
    settings = SimulationSettings(time_limit=seconds)
    assert simulate(concrete, locator, settings, folder=file.parent).error is None


def test_what_was_trained_drives_as_it_was_trained(trainer, tmp_path):
    """Three generations of few, short episodes; the file's answers are the trainer's to float32."""
    weights, history = trainer.train("front_vehicle_cut_out", 60.0, generations=3)
    assert len(history) == 3
    assert np.isfinite(history).all()
    again, _ = trainer.train("front_vehicle_cut_out", 60.0, generations=3)
    np.testing.assert_array_equal(weights, again)
    trainer.write(weights, tmp_path / "policy.onnx")
    every = np.repeat(weights[None], 50, axis=0)
    check_policy(tmp_path / "policy.onnx", trainer, lambda seen: trainer.answers(every, seen), 5.0)


@pytest.mark.filterwarnings("default")  # torch's exporter warns of torch
def test_what_ppo_learnt_drives_as_it_was_trained(monkeypatch, tmp_path):
    """Two short updates; what the file answers is the mean of stable-baselines3's policy, to
    float32."""
    for needed in ("stable_baselines3", "onnxscript"):
        pytest.importorskip(needed)
    monkeypatch.syspath_prepend(EXAMPLES)
    import train_ppo

    monkeypatch.setattr(train_ppo, "BESIDE", 8)
    monkeypatch.setattr(train_ppo, "STEPS", 16)
    model = train_ppo.train("front_vehicle_cut_out", 60.0, steps=256)
    sys.modules.pop("train_ppo")
    assert model.num_timesteps == 256
    train_ppo.write(model, tmp_path / "ppo.onnx")
    means = partial(model.predict, deterministic=True)
    check_policy(tmp_path / "ppo.onnx", train_ppo, lambda seen: means(seen)[0], 2.0)


def test_ppo_names_missing_packages_before_it_trains(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SystemExit, match="Not installed: gymnasium, onnx"):
        runpy.run_path(str(EXAMPLES / "train_ppo.py"))


def test_highway_envs_drivers_keep_or_change_their_lane():
    """25 m/s, a lead that cuts out before an obstacle of 10 m/s: IDM slows down to it, MOBIL drives
    past."""
    pytest.importorskip("highway_env")
    concrete = at_values("front_vehicle_cut_out", **POINT)
    settings = SimulationSettings(time_limit=30.0)
    idm, mobil = (
        simulate(concrete, f"highway_drivers.py:{name}", settings, folder=EXAMPLES)
        for name in ("Idm", "Mobil")
    )
    assert idm.error is None
    assert mobil.error is None
    assert np.abs(idm.ego.y).max() < 0.1
    assert idm.ego.speed.min() < 12.0
    assert mobil.ego.y.max() > 3.0
    assert mobil.ego.speed.min() > 15.0
