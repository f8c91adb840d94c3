"""A golden run: results may change only together with `PROTOCOL`.

Scripted actions through environment, observers and rewards, and updates of the learner on a fixed
batch, against the numbers in golden.json. After a change that is meant to change results, raise
`PROTOCOL` in rl/runs.py and write the numbers anew: `python tests/rl/test_golden.py`.
"""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch

from rlihf_lib.files import write_text
from rlihf_lib.rl.evaluation import rollout
from rlihf_lib.rl.observer import OBSERVERS
from rlihf_lib.rl.rewards import alignment_reward, evaluation_reward, task_reward
from rlihf_lib.rl.runs import PROTOCOL, RunConfig, SACSettings
from rlihf_lib.rl.sac import make_sac
from rlihf_lib.task.gym_env import N_OBSERVATIONS, PickPlaceEnv
from rlihf_lib.task.scripted import expert_action

STORED = Path(__file__).with_name("golden.json")
# Relative and absolute. Processors round differently, and contacts make something of it: little
# for a lemon that rolls, a step or two and millimetres over an episode with a grasp.
TOLERANCE = {"free": (1e-4, 1e-4), "contact": (0.06, 5e-3), "update": (1e-4, 1e-4)}
# The same arithmetic as other processors do it.
OTHER_PROCESSOR = {
    "NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": "", "OPENBLAS_CORETYPE": "Nehalem",
    "MKL_CBWR": "COMPATIBLE", "ATEN_CPU_CAPABILITY": "default",
}  # fmt: skip


def judged(env, moment, observation):
    """Everything that a step leaves behind, as plain numbers."""
    return [
        *(float(value) for value in dataclasses.astuple(moment)),
        *(observe(moment) for observe in OBSERVERS.values()),
        task_reward(moment, SACSettings.discount),
        alignment_reward(moment),
        evaluation_reward(moment, env.path),
        *(float(value) for value in observation),
    ]


def free_motion():
    """Wavering above the table, near the obstacles, from two placements."""
    env, rng, rows = PickPlaceEnv(), np.random.default_rng(0), []
    for seed in (5, 6):
        env.reset(seed=seed)
        for drift in ([0.6, 0.8, -0.2, -1], [0, -0.5, 0.4, 1]):
            for _ in range(8):
                observation, *_, info = env.step(drift + rng.normal(0, 0.3, 4))
                rows.append(judged(env, info["moment"], observation))
    return rows


def expert_episode():
    """Metrics of the expert's episodes, contacts included."""
    env, rows = PickPlaceEnv(), []
    for seed in (7, 8):
        *_, (*_, info) = rollout(env, expert_action, seed)
        rows.append([float(value) for value in info["metrics"].values()])
    return rows


class Noise(gym.Env):
    """Random observations and rewards in the shapes of the task, to fill a replay buffer."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (N_OBSERVATIONS,))
    action_space = gym.spaces.Box(-1, 1, (4,))

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(3)
        return self.rng.normal(size=self.observation_space.shape).astype(np.float32), {}

    def step(self, action):
        observation = self.rng.normal(size=self.observation_space.shape).astype(np.float32)
        ended = bool(self.rng.random() < 0.1)
        return observation, float(self.rng.random()), ended, False, {}


def updates():
    """The learner after 30 updates: what it says of itself, and what its policy does."""
    torch.set_num_threads(1)
    settings = SACSettings(learning_starts=300)
    model = make_sac(Noise(), settings, seed=0, log_every=10)
    model.learn(330)
    observations = np.random.default_rng(4).normal(size=(3, *Noise.observation_space.shape))
    actions = model.predict(observations.astype(np.float32), deterministic=True)[0]
    return [*(list(map(float, row.values())) for row in model.learning), *actions.tolist()]


def measure():
    """Compute what golden.json holds."""
    return {
        "protocol": PROTOCOL,
        "hash": RunConfig("dense", 0, 10, 5).hash,
        "defaults": json.loads(json.dumps(RunConfig("dense", 0, 10, 5).to_dict())),
        "free": free_motion(),
        "contact": expert_episode(),
        "update": updates(),
    }


def assert_golden(measured):
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    for name in ("protocol", "hash", "defaults"):
        assert measured[name] == stored[name], f"{name} changed: {__doc__}"
    for name, (rel, abs_) in TOLERANCE.items():
        for now, before in zip(measured[name], stored[name], strict=True):
            assert now == pytest.approx(before, rel=rel, abs=abs_), f"{name}: {__doc__}"


def test_results_change_only_with_the_protocol():
    assert_golden(measure())


def test_results_are_the_same_on_another_processor(tmp_path):
    environment = {**os.environ, **OTHER_PROCESSOR, "NUMBA_CACHE_DIR": str(tmp_path)}
    code = f"import runpy; m = runpy.run_path({__file__!r}); print(m['json'].dumps(m['measure']()))"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert_golden(json.loads(done.stdout.splitlines()[-1]))


if __name__ == "__main__":
    write_text(STORED, json.dumps(measure(), indent=None) + "\n")
