"""Sparse, dense and RLIHF rewards, and the one reward that judges them all.

The can standing on the goal is an absorbing state worth `PLACED` a step for ever. Episodes end
there, and what the learner would have collected is paid at once, `PLACED / (1 - discount)`: the
same values for the learner as an episode that runs on, without filling the replay buffer with a
finished task. As every other reward is below `PLACED`, nothing pays better than finishing.
"""

import gymnasium as gym
import numpy as np

from rlihf_lib.task.path import GRASP_WORTH, LIFT

PLACED = 1.0
COLLISION = -0.5


def task_reward(moment, discount):
    """Sparse reward: success, and a penalty for each step in collision with an obstacle.

    Parameters
    ----------
    moment : Moment
    discount : float
        Of the learner, in [0, 1).

    Returns
    -------
    float
        -0.5, 0 or 1 / (1 - discount).
    """
    return PLACED / (1 - discount) * moment.success + COLLISION * moment.collided


def alignment_reward(moment, path):
    """Engineered reward for how far along the ideal path a state is; rises along that path.

    0 to 0.25 while reaching, 0.3 with closed fingers, 0.4 with the can held, 0.6 once it is
    lifted, 0.8 over the goal. What lies beside the path is priced by `IdealPath.remaining`.

    Parameters
    ----------
    moment : Moment
    path : rlihf_lib.task.path.IdealPath

    Returns
    -------
    float
        In [0, 0.8].
    """
    left = moment.remaining
    held = path.carry_length
    if left <= held + 1e-9:
        return float(np.interp(left, [0, held - LIFT, held], [0.8, 0.6, 0.4]))
    reach = left - held
    if reach <= GRASP_WORTH:
        return float(np.interp(reach, [GRASP_WORTH / 2, GRASP_WORTH], [0.3, 0.25]))
    return float(0.25 * np.exp(-(reach - GRASP_WORTH) / 0.15))


def errp_reward(p_error):
    """Implicit human feedback, Eq. (4): r = 1 - p(error).

    Parameters
    ----------
    p_error : float or ndarray
        Decoded probability, in [0, 1], that the observer perceived an error.

    Returns
    -------
    float or ndarray
        Reward in [0, 1]. Never negative: see `notebooks/03` on what that does where success ends
        an episode.
    """
    return 1.0 - p_error


def evaluation_reward(moment, path):
    """Unified reward of the evaluation: success, collisions, alignment with the ideal path.

    Parameters
    ----------
    moment : Moment
    path : IdealPath

    Returns
    -------
    float
        1 once placed (also for every step left of the horizon), else at most 0.25 for the share of
        the ideal path completed, less for distance from it, and -0.5 in collision.
    """
    if moment.success:
        return PLACED
    completed = np.clip(1 - moment.remaining / path.start_remaining, 0, 1)
    aligned = 0.25 * completed * np.exp(-moment.deviation / 0.1)
    return float(aligned + COLLISION * moment.collided)


class TrainingReward(gym.Wrapper):
    """Replace the environment's reward by that of a condition.

    Parameters
    ----------
    env : PickPlaceEnv
    condition : {"sparse", "dense", "rlihf"}
    discount : float
        Of the learner.
    w_hf : float
        Weight of human feedback.
    observer : Observer, optional
        Needed by "rlihf".
    """

    def __init__(self, env, condition, discount, w_hf=0.0, observer=None):
        super().__init__(env)
        self.condition, self.discount = condition, discount
        self.w_hf, self.observer = w_hf, observer

    def step(self, action):
        """Advance one step; the reward is r_task plus that of the condition."""
        observation, _, terminated, truncated, info = self.env.step(action)
        moment = info["moment"]
        reward = task_reward(moment, self.discount)
        if self.condition == "dense" and not moment.success:
            reward += alignment_reward(moment, self.env.path)
        elif self.condition == "rlihf":
            reward += self.w_hf * errp_reward(self.observer.watch(moment))
        return observation, reward, terminated, truncated, info
