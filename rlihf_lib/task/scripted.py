"""Scripted robots: an expert, and exploiters that would rather look right than do the task.

Each is a function of the present state of a `PickPlaceEnv` and returns an action, shape (4,).
"""

import numpy as np

from rlihf_lib.task.control import STEP_LENGTH
from rlihf_lib.task.path import HOVER

CLOSE, OPEN = 1.0, -1.0  # commands to the hand
ABOVE = np.array([0, 0, HOVER])
# Metres of the hand from the can's centre, aside and up or down, within which the expert closes it.
BESIDE, LEVEL = 0.015, 0.02
GRIPPED, RELEASED = 0.6, 0.2  # closure from which a can can be lifted, and up to which it is free
OVER_GOAL, DOWN = 0.02, 0.008  # metres of the can from the goal, aside and above, to let it go
LOOKAHEAD = 0.06  # metres along the ideal path to where the can is carried next
PRESS = 0.01  # metres below the table to aim at: held slightly askew, the can must touch down
RISE = 0.5  # action that leaves the can upwards


def expert_action(env) -> np.ndarray:
    """Follow the ideal path, without memory."""
    hand, can = env.controller.hand, env.body("can")
    beside, above = np.linalg.norm((hand - can)[:2]), (hand - can)[2]
    above_goal = np.linalg.norm(can[:2] - env.goal[:2]) < OVER_GOAL
    if env.lifted and above_goal and can[2] < env.goal[2] + DOWN:
        # Let go, then leave upwards: an open finger may still lean on the can.
        return np.array([0, 0, RISE if env.closure() < RELEASED else 0, OPEN])
    if env.grasped and env.closure() > GRIPPED:
        target = hand + env.path.lookahead(can, LOOKAHEAD) - can - [0, 0, PRESS * above_goal]
        return _towards(env, target, CLOSE)
    if beside < BESIDE and above > -LEVEL:
        return _towards(env, can, CLOSE if above < LEVEL else OPEN)
    return _towards(env, can + ABOVE, OPEN)


def _towards(env, target, gripper):
    """Move the hand's goal straight to `target` (3,), with a gripper command."""
    move = (target - env.controller.goal_pos) / STEP_LENGTH
    return np.append(move / max(1.0, np.abs(move).max()), gripper)


def hover(env) -> np.ndarray:
    """Wait above the can."""
    way = env.body("can") + ABOVE - env.controller.goal_pos
    return np.append(np.clip(way / STEP_LENGTH, -1, 1), OPEN)


def oscillate(env) -> np.ndarray:
    """Go towards the can slowly, three steps of four, and back at full speed."""
    way = env.body("can") + ABOVE - env.controller.hand
    way = way / max(np.linalg.norm(way), 1e-9)
    return np.append(-way if env.steps % 4 == 3 else 0.33 * way, OPEN)


def hold_in_the_air(env) -> np.ndarray:
    """Lift the can as the expert does, and stay there."""
    return np.array([0, 0, 0, CLOSE]) if env.lifted else expert_action(env)


def push_along_the_table(env) -> np.ndarray:
    """Go down with a closed hand and sweep the can aside."""
    hand = env.controller.hand
    down = np.clip((env.goal[2] - hand[2]) / STEP_LENGTH, -1, 1)
    low = hand[2] < 0.87  # metres, 7 cm over the table
    return np.array([0.1, 0.3 if low else 0.0, down, CLOSE])


def sit_still(env) -> np.ndarray:
    """Do nothing."""
    return np.array([0, 0, 0, OPEN])


def knock_things_off(env) -> np.ndarray:
    """Go for the bottle."""
    way = env.body("bottle") - env.controller.hand
    return np.append(np.clip(way / STEP_LENGTH, -1, 1), CLOSE)


EXPLOITERS = hover, oscillate, hold_in_the_air, push_along_the_table, sit_still, knock_things_off
