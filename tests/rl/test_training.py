"""Short real training runs."""

import json

import numpy as np
import pandas as pd
import pytest
import torch
from gymnasium import Env, spaces
from stable_baselines3 import SAC

from rlihf_lib.rl.config import RunConfig, SACSettings
from rlihf_lib.rl.sac import StackedPolicy, make_sac
from rlihf_lib.rl.training import train_run

SHORT = {"total_steps": 300, "eval_every": 150, "horizon": 60, "eval_rollouts": 2}
SAC_SHORT = SACSettings(learning_starts=200, batch_size=64)
TABLE = pd.DataFrame({"subject": "s02", "label": [0, 1, 0], "p_error": [0.2, 0.7, 0.3]})


def config(**changes):
    fields = {"condition": "rlihf", "subject": "s02", "w_hf": 0.7, "seed": 1, "sac": SAC_SHORT}
    return RunConfig(**{**SHORT, **fields, **changes})


def test_same_config_gives_identical_files(tmp_path):
    for name in ("first", "second"):
        train_run(config(), tmp_path / name, TABLE)
    for file in ("config.json", "train.csv", "eval.csv", "actor.safetensors"):
        first, second = ((tmp_path / name / file).read_bytes() for name in ("first", "second"))
        assert first == second, file


def test_run_folder_says_what_was_run_and_how_it_went(tmp_path):
    dense = config(condition="dense", subject="", w_hf=0.0)
    train_run(dense, tmp_path)
    recorded = json.loads((tmp_path / "config.json").read_text())
    assert recorded["hash"] == dense.hash and recorded["condition"] == "dense"
    rows = pd.read_csv(tmp_path / "eval.csv")
    columns = "step rollout return success path_efficiency path_deviation collisions min_clearance"
    assert set(columns.split()) <= set(rows.columns)
    assert rows.groupby("step").size().to_dict() == {0: 2, 150: 2, 300: 2}
    assert json.loads((tmp_path / "provenance.json").read_text())["packages"]["mujoco"]


def test_unknown_subject_is_named_with_those_that_are_there(tmp_path):
    with pytest.raises(ValueError, match=r"'s99'.*there: s02"):
        train_run(config(subject="s99"), tmp_path, TABLE)
    assert not list(tmp_path.iterdir())


def test_every_setting_changes_the_hash():
    base = config()
    others = [config(seed=2), config(w_hf=0.4), config(sac=SACSettings()), config(protocol=0)]
    assert len({base.hash, *(c.hash for c in others)}) == 5


class Noise(Env):
    """Random observations and rewards, to fill a replay buffer."""

    observation_space = spaces.Box(-np.inf, np.inf, (5,), np.float32)
    action_space = spaces.Box(-1, 1, (2,), np.float32)

    def __init__(self):
        self.rng = np.random.default_rng(0)

    def reset(self, seed=None, options=None):
        return self.rng.normal(size=5).astype(np.float32), {}

    def step(self, action):
        observation = self.rng.normal(size=5).astype(np.float32)
        return observation, float(self.rng.random()), bool(self.rng.random() < 0.1), False, {}


def test_update_equals_that_of_stable_baselines3():
    """The same batches give the same weights, up to rounding, as SB3's own `train`."""
    settings = SACSettings(hidden=(16, 16), learning_starts=80, batch_size=32)
    fast = make_sac(Noise(), settings, seed=0)
    fast.learn(80)
    reference = SAC(
        StackedPolicy, Noise(), learning_rate=settings.learning_rate, tau=settings.tau,
        gamma=settings.discount, n_steps=settings.n_steps, seed=0, device="cpu",
        target_entropy=settings.target_entropy, learning_starts=80, batch_size=32,
        policy_kwargs={"net_arch": [16, 16], "optimizer_kwargs": {"fused": True}},
    )  # fmt: skip
    reference.learn(80)
    reference.policy.load_state_dict(fast.policy.state_dict())
    reference.replay_buffer = fast.replay_buffer
    for model in (fast, reference):
        np.random.seed(4)  # noqa: NPY002 (SB3 draws batches from numpy's global state)
        torch.manual_seed(4)
        model.train(gradient_steps=5, batch_size=32)
    for (name, a), b in zip(
        fast.policy.named_parameters(), reference.policy.parameters(), strict=True
    ):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5, msg=name)
