"""Sparse, dense and RLIHF rewards, and the one reward that judges them all.

The can standing on the goal is an absorbing state worth `PLACED` a step for ever, and so is a can
that has fallen, worth nothing. Episodes end there, and what the learner would have collected is
paid at once, `PLACED / (1 - discount)` and the feedback of an observer who goes on watching: the
same values for the learner as an episode that runs on, without filling the replay buffer with a
finished task. As feedback is never negative, it would otherwise be a reason not to finish, and to
keep away from a can that may fall over.
"""

from typing import Any

import gymnasium as gym
import numpy as np

from rlihf_lib.task.moment import Moment

PLACED = 1.0
COLLISION = -2.0  # at -0.5, pilots placed the can sooner by going through the obstacles
PROGRESS = 25.0  # per metre of remaining path
EVALUATED_COLLISION = -0.5  # per step, of an evaluation whose other terms lie between 0 and 1
EVALUATED_ALIGNMENT = 0.25  # of having followed the whole ideal path
NEAR_PATH = 0.1  # metres from the ideal path at which alignment has fallen to 1/e
AFTERWARDS = 100  # steps after which, discounted, feedback no longer matters


def task_reward(moment: Moment, discount: float) -> float:
    """Sparse reward: -2 in collision with an obstacle, 1 / (1 - discount) for success, else 0."""
    return PLACED / (1 - discount) * moment.success + COLLISION * moment.collided


def alignment_reward(moment: Moment) -> float:
    """Engineered reward for following the ideal path: new ground made along it.

    Progress is counted from the least remaining path of the episode, so that going round in circles
    pays nothing, and lost ground has to be made good first. Remaining path prices what lies beside
    the path, too (`IdealPath.remaining`). Paid as the change of that potential instead (Ng et al.
    1999), a step ahead is worth only 1 - discount of itself to a policy that would come back: a
    pilot carried the can half-way to the goal and parked there for 20,000 steps. Paid as a level, 0
    to 0.8 for the state reached, pilots lifted the can and carried it no further.

    0.75 for a step at full speed along the path, less beside it, 0 for none or for lost ground.
    """
    return PROGRESS * max(0.0, moment.best - moment.remaining)


#: What "dense" may add to the task reward, by name, as `RunConfig.reward` names it.
REWARDS = {"path": alignment_reward}


def errp_reward(p_error: np.ndarray) -> np.ndarray:
    """Implicit human feedback, Eq. (4): r = 1 - p(error).

    Parameters
    ----------
    p_error : ndarray, shape (n,), or float
        Decoded probability, in [0, 1], that the observer perceived an error.

    Returns
    -------
    ndarray, shape (n,), or float
        Reward in [0, 1]. Never negative: see `notebooks/03` on what that does where success ends
        an episode.
    """
    return 1.0 - p_error


#: What p(error) is worth, by name, as `RunConfig.feedback` names it.
FEEDBACK = {"errp": errp_reward}


def evaluation_reward(moment: Moment, path) -> float:
    """Unified reward of the evaluation: success, collisions, alignment with the `IdealPath`.

    1 once placed (also for every step left of the horizon), else at most 0.25 for the share of the
    ideal path completed, less for distance from it, and -0.5 in collision.
    """
    if moment.success:
        return PLACED
    completed = np.clip(1 - moment.remaining / path.start_remaining, 0, 1)
    aligned = EVALUATED_ALIGNMENT * completed * np.exp(-moment.deviation / NEAR_PATH)
    return float(aligned + EVALUATED_COLLISION * moment.collided)


class TrainingReward(gym.Wrapper):
    """Replace the reward of a `PickPlaceEnv` by that of a condition: "sparse", "dense" or "rlihf".

    "dense" adds `engineered(moment)` to the task reward, "rlihf" `w_hf` times `feedback(p_error)`
    of an `Observer`, whose answers the others leave alone. `discount` is the learner's.
    """

    def __init__(
        self, env, condition, discount, w_hf=0.0, observer=None, engineered=alignment_reward,
        feedback=errp_reward, total_steps=1,
    ):  # fmt: skip
        super().__init__(env)
        self.condition, self.discount = condition, discount
        self.w_hf, self.observer, self.engineered = w_hf, observer, engineered
        self.feedback, self._steps, self._total_steps = feedback, 0, total_steps
        self._discounts = discount ** np.arange(AFTERWARDS)
        self._seen: tuple = ()  # observation and action of the last step

    def notes(self) -> dict[str, Any]:
        """What there is to say of the run in its provenance."""
        return {}

    def advance(self, action) -> tuple:
        """Advance the task one step."""
        task: Any = self.unwrapped
        self._seen = task.observation, action
        self._steps += 1
        if self.observer:
            self.observer.share = self._steps / self._total_steps
        return self.env.step(action)

    def step(self, action) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Advance one step; the reward is r_task plus that of the condition."""
        observation, _, terminated, truncated, info = self.advance(action)
        reward, _ = self.judge(info["moment"])
        return observation, reward, terminated, truncated, info

    def judge(self, moment: Moment) -> tuple[float, float]:
        """Return a moment's reward and the p(error) it evokes; NaN where nobody watches."""
        reward, p_error = task_reward(moment, self.discount), np.array([np.nan])
        over = moment.success or moment.lost
        if self.observer:
            p_error = self.observer.watch(moment, AFTERWARDS if over else 1)
        if self.condition == "dense" and not moment.success:
            reward += self.engineered(moment)
        elif self.condition == "rlihf":
            feedback = self.feedback(p_error)
            reward += self.w_hf * float(self._discounts @ feedback if over else feedback[0])
        return reward, float(p_error[0])
