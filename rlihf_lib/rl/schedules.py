"""A weight of human feedback that changes while a robot learns, as the paper proposes at its end.

It follows the time ("fading", "growing"), the critics ("doubt": as far apart as they are, for they
need no help where they agree) or the decoder ("spread": p(error) of a decoder that knows less lies
closer together, which takes no labels to see). A replay buffer keeps a reward as it was when it was
stored, so that weights of long ago would live on in every update. Here what feedback is worth in
memory is written anew, too. But where the decoder is what changes, answers keep the weight of their
time, for that is how good they are. So by the spread it is the weight of what they are above or
below one half: steps of no time are paid more than those of another.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from rlihf_lib.rl.rewards import TrainingReward, task_reward

LEAST = 1 / 7  # of the weight: from or to 0.1 where that is 0.7, the paper's least and most
RENEWED = 1_000  # steps after which the weight, and memory, change
DOUBTFUL = 0.1  # distance of the critics, relative to their values, from which on all of it counts
#: Share of the weight that counts, at least `LEAST`, by the share of training that is over, the
#: critics' distance over the last `RENEWED` steps, and the standard deviation of p(error) over
#: them, relative to that over the first ones.
SCHEDULES: dict[str, Callable[[float, float, float], float]] = {
    "constant": lambda share, doubt, spread: 1.0,
    "fading": lambda share, doubt, spread: 1 - (1 - LEAST) * share,
    "growing": lambda share, doubt, spread: LEAST + (1 - LEAST) * share,
    "doubt": lambda share, doubt, spread: doubt / DOUBTFUL,
    "spread": lambda share, doubt, spread: spread,
}


class ScheduledReward(TrainingReward):
    """`TrainingReward` of condition "rlihf" whose weight follows one of `SCHEDULES`.

    `info["late"]` holds what earlier steps' feedback changes by when the weight does, unless it
    follows the spread: how many steps ago they were, and by how much.

    Attributes
    ----------
    doubt : callable
        How far apart the critics are, on average, about observations, (n, n_observations), and
        actions, (n, n_actions), relative to their values; `training` puts the learner's there.
    """

    def __init__(self, env, *arguments, schedule: str):
        super().__init__(env, *arguments)
        self._schedule, self._lasts = SCHEDULES[schedule], schedule == "spread"
        self.doubt: Callable = lambda observations, actions: DOUBTFUL
        self._counts = [self._schedule(0.0, DOUBTFUL, 1.0)]  # shares of the weight, in their order
        self._worth: list[float] = []  # of each step's feedback at the whole weight
        self._p_error: list[float] = []
        self._recent: list[tuple] = []  # observation and action of each step since the last change

    def step(self, action) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Advance one step; its feedback counts as the schedule says."""
        observation, _, terminated, truncated, info = self.advance(action)
        before = len(self._worth)
        if before and before % RENEWED == 0:
            change = self._renew(before / self._total_steps)
            if not self._lasts:
                info["late"] = before - np.arange(before), change * np.array(self._worth)
        reward, p_error = self.judge(info["moment"])
        task = task_reward(info["moment"], self.discount)
        self._worth.append(reward - task)
        self._p_error.append(p_error)
        self._recent.append(self._seen)
        level = self._lasts * self.w_hf / 2 * (self._discounts.sum() if terminated else 1.0)
        reward = task + level + self._counts[-1] * (self._worth[-1] - level)
        return observation, reward, terminated, truncated, info

    def _renew(self, share):
        """Change the share of the weight; return by how much."""
        doubt = self.doubt(*map(np.array, zip(*self._recent, strict=True)))
        first, last = np.std(self._p_error[:RENEWED]), np.std(self._p_error[-RENEWED:])
        counts = self._schedule(share, doubt, float(last / first) if first else 1.0)
        self._counts.append(float(np.clip(counts, LEAST, 1.0)))
        self._recent = []
        return self._counts[-1] - self._counts[-2]

    def notes(self) -> dict[str, Any]:
        """The weight's shares, one every `RENEWED` steps."""
        return {"weight_shares": [round(share, 4) for share in self._counts]}
