"""A scripted expert: follows the ideal path, without memory."""

import numpy as np

from rlihf_lib.task.control import STEP_LENGTH
from rlihf_lib.task.path import HOVER

CLOSE, OPEN = 1.0, -1.0


def expert_action(env):
    """Action of the scripted expert in the present state of a `PickPlaceEnv`, shape (4,)."""
    hand, can = env.controller.hand, env.body("can")
    offset = hand - can
    beside = np.linalg.norm(offset[:2])
    above_goal = np.linalg.norm(can[:2] - env.goal[:2]) < 0.02
    if env.lifted and above_goal and can[2] < env.goal[2] + 0.008:
        # Let go, then leave upwards: an open finger may still lean on the can.
        return np.array([0, 0, 0.5 if env.closure() < 0.2 else 0, OPEN])
    if env.grasped and env.closure() > 0.6:
        # Aim a little below the table: held slightly askew, the can must still touch down.
        target = hand + env.path.lookahead(can, 0.06) - can - [0, 0, 0.01 * above_goal]
        return _towards(env, target, CLOSE)
    if beside < 0.015 and abs(offset[2]) < 0.02:
        return _towards(env, can, CLOSE)
    if beside < 0.015 and offset[2] > 0:
        return _towards(env, can, OPEN)
    return _towards(env, can + np.array([0, 0, HOVER]), OPEN)


def _towards(env, target, gripper):
    """Action that moves the hand's goal to `target` (3,), with a gripper command."""
    move = (target - env.controller.goal_pos) / STEP_LENGTH
    return np.append(move / max(1.0, np.abs(move).max()), gripper)
