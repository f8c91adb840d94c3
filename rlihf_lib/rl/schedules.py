"""A weight of human feedback that changes while a robot learns, as the paper proposes at its end.

A replay buffer keeps a reward as it was when it was stored, so that weights of long ago would live
on in every update. Here what feedback is worth in memory is written anew, too.
"""

import numpy as np

from rlihf_lib.rl.rewards import TrainingReward, task_reward

LEAST = 1 / 7  # of the weight: from or to 0.1 where that is 0.7, the paper's least and most
RENEWED = 1_000  # steps after which the weight, and memory, change
#: Share of the weight that counts, by the share of training that is over.
SCHEDULES = {
    "constant": lambda share: 1.0,
    "fading": lambda share: 1 - (1 - LEAST) * share,
    "growing": lambda share: LEAST + (1 - LEAST) * share,
}


class ScheduledReward(TrainingReward):
    """`TrainingReward` of condition "rlihf" whose weight follows one of `SCHEDULES`.

    `info["late"]` holds what earlier steps' feedback changes by when the weight does: how many
    steps ago they were, and by how much.
    """

    def __init__(self, env, *arguments, schedule: str):
        super().__init__(env, *arguments)
        self._schedule, self._counts = SCHEDULES[schedule], SCHEDULES[schedule](0.0)
        self._worth: list[float] = []  # of each step's feedback at the whole weight

    def step(self, action) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Advance one step; its feedback counts as the schedule says."""
        observation, _, terminated, truncated, info = self.advance(action)
        before = len(self._worth)
        if before and before % RENEWED == 0:
            counts = self._schedule(before / self._total_steps)
            change = (counts - self._counts) * np.array(self._worth)
            info["late"], self._counts = (before - np.arange(before), change), counts
        reward, _ = self.judge(info["moment"])
        task = task_reward(info["moment"], self.discount)
        self._worth.append(reward - task)
        return observation, task + self._counts * (reward - task), terminated, truncated, info
