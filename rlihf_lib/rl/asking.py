"""Feedback when answers are few: which steps are asked about, and a model that fills in the rest.

People tire, and an epoch that has answered once says nothing new the second time. So only some
steps are asked about, at random or where a model of the feedback is unsure. Without a model the
mean of answers so far is every step's feedback, and what an answer is above or below it is divided
by the share of steps that is asked about, so that right and wrong steps differ as much, on average,
as if all were; ends of episodes are judged as everywhere, for they last (`rewards`). A model is an
ensemble of networks of observation and action, fitted to the answers so far: as the observer judges
what a step gains, not how far the robot has come, it predicts advantages, not levels. Its word is
every step's feedback, and when it is fitted anew, that of the steps in memory is written anew, too.

From the field: ErrPs that train a model of the reward, Akinola et al. 2020 (arXiv 1910.13580);
asking where an ensemble disagrees, Christiano et al. 2017 (arXiv 1706.03741); rewriting the replay
buffer, Lee, Smith & Abbeel 2021 (PEBBLE, arXiv 2106.05091).
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from rlihf_lib.rl.rewards import TrainingReward, task_reward

WHEN = ("spread", "unsure")
REFIT = 1_000  # steps between fits of the model
COMPARED = 200  # last steps, at least, among which a step is unsure, or not


@dataclass(frozen=True)
class Asking:
    """How many steps are asked about, and which; see the module."""

    budget: int = 0
    """Answers in all; 0 = every step's."""
    once: bool = False
    """Whether an epoch answers once and then never again: no more answers than the person has
    epochs of the rarer class, so that none is missing. So few need a model."""
    when: str = "spread"
    """One of `WHEN`: at random over all of training, or where the model is unsure."""
    model: bool = False
    """Whether the model answers; else steps without an answer get what answers were on average."""

    def __post_init__(self):
        if self.when not in WHEN:
            raise ValueError(f"{self}: when is one of {', '.join(WHEN)}")
        if not self.model and (self.once or self.when == "unsure"):
            raise ValueError(f"{self}: to ask once, or where it is unsure, takes a model")
        if self.budget < 0:
            raise ValueError(f"{self}: budget is 0, for every step, or more")


class AskingReward(TrainingReward):
    """`TrainingReward` of condition "rlihf" that asks about some steps only, by an `Asking`.

    `info["late"]` holds what feedback of earlier steps is changed by when the model is fitted: how
    many steps ago they were, and by how much. `rng` decides which steps are asked about. To a model
    the end of an episode is a step like others, but what it is worth lasts (`rewards`).
    """

    def __init__(self, env, *arguments, asking: Asking, rng):
        super().__init__(env, *arguments)
        self.asking, self._rng = asking, rng
        n, n_inputs = self._total_steps, env.observation_space.shape[0] + env.action_space.shape[0]
        if asking.model:
            from rlihf_lib.rl.reward_model import RewardModel  # only runs need PyTorch

            self._model = RewardModel(n_inputs, int(rng.integers(2**31)))
        self._inputs = np.zeros((n, n_inputs), np.float32)
        self._paid, self._scales, self._right = np.zeros((3, n))
        self._asked: list[int] = []  # steps with an answer
        self._answers: list[float] = []
        self._fitted = 0  # of them
        self._mean = 0.5  # of the answers so far
        most = min(asking.budget or n, n)
        self.budget = min(most, self.observer.n_fewest) if asking.once else most
        self._rate = self.budget / n
        # Of fewer steps than a few answers are apart even the most doubtful one may be sure.
        self._doubts: deque[float] = deque(maxlen=max(COMPARED, round(5 / self._rate)))

    def step(self, action) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Advance one step; its reward is what is known of it now."""
        observation, _, terminated, truncated, info = self.advance(action)
        moment, now = info["moment"], self._steps - 1
        if terminated and not self.asking.model:
            reward, _ = self.judge(moment)
            return observation, reward, terminated, truncated, info
        if self.asking.model and len(self._answers) > self._fitted and now % REFIT == 0:
            info["late"] = self._rewrite(now)
        self._inputs[now] = np.concatenate(self._seen)
        self._scales[now] = self.w_hf * (self._discounts.sum() if terminated else 1.0)
        self._right[now] = 1 - self.observer.looks_wrong(moment)
        self._paid[now], doubt = self._mean, None
        if self._fitted:
            (self._paid[now],), (doubt,) = self._model.predict(self._inputs[now : now + 1])
        wanted = self._is_wanted(doubt if self.asking.when == "unsure" else None)
        if wanted and len(self._asked) < self.budget:
            (answer,) = map(float, self.feedback(self.observer.watch(moment)))
            self._asked.append(now)
            self._answers.append(answer)
            self._mean += (answer - self._mean) / len(self._answers)
            if not self.asking.model:
                self._paid[now] = self._mean + (answer - self._mean) / self._rate
        reward = task_reward(moment, self.discount) + self._scales[now] * self._paid[now]
        return observation, reward, terminated, truncated, info

    def notes(self) -> dict[str, float]:
        """How right the model is, over the last third of the steps: what is paid against P(right).

        "model_r" is their correlation, "model_contrast" by how much more is paid for a step that is
        right than for one that is wrong (slope of the regression). "asked": steps with an answer.
        """
        asked: dict[str, float] = {"asked": len(self._asked)}
        late = slice(2 * self._steps // 3, self._steps)
        paid, right = self._paid[late], self._right[late]
        if not self.asking.model or np.ptp(paid) == 0 or np.ptp(right) == 0:
            return asked
        (_, covariance), (_, variance) = np.cov(paid, right)
        r = float(np.corrcoef(paid, right)[0, 1])
        known = {"model_r": r, "model_contrast": float(covariance / variance)}
        return asked | {name: round(value, 4) for name, value in known.items()}

    def _is_wanted(self, doubt):
        """Draw a share of all steps, or, by a doubt, take that of the most doubtful ones."""
        if doubt is None:
            return self._rng.random() < self._rate
        self._doubts.append(doubt)
        return doubt >= np.quantile(self._doubts, 1 - self._rate)

    def _rewrite(self, now):
        """Fit the model; return what the feedback of the `now` steps so far changes by."""
        self._model.fit(self._inputs[self._asked], np.array(self._answers))
        self._fitted = len(self._answers)
        known, _ = self._model.predict(self._inputs[:now])
        change = self._scales[:now] * (known - self._paid[:now])
        self._paid[:now] = known
        return now - np.arange(now), change
