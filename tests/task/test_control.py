"""The hand goes where it is told, as robosuite's own `step` takes it there."""

import numpy as np
import pytest

from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.workspace import Workspace


def test_fast_control_moves_the_hand_as_robosuites_own_step_does(env):
    stock = PickPlaceEnv(workspace=Workspace(fast=False))
    env.reset(seed=3), stock.reset(seed=3)
    rng = np.random.default_rng(0)
    distances = []
    for step in range(60):
        if step % 10 == 0:
            action = np.append(rng.uniform(-1, 1, 3), -1)
        # Stay over the objects: contacts magnify the smallest difference.
        action[2] = np.clip((1.05 - env.controller.goal_pos[2]) * 10, -1, 1)
        env.controller.advance(action), stock.controller.advance(action)
        distances.append(np.linalg.norm(env.controller.hand - stock.controller.hand))
    assert np.ptp([env.controller.goal_pos, stock.controller.goal_pos], axis=0).max() < 0.005
    assert max(distances) < 0.004


def test_hand_is_open_and_closed_before_the_command_reaches_its_end(env):
    for command, closed in ((-0.7, 0), (0.7, 1)):
        env.reset(seed=0)
        for _ in range(5):
            env.step(np.array([0, 0, 0, command]))
        assert env.squeeze() == pytest.approx(closed)
