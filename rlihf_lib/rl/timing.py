"""Feedback as brains give it: some events are answered, late, and an answer has to find its steps.

An error potential takes up to 0.8 s, and people answer events about once a second; a control step
takes 0.1 s. Every `interval` steps the observer answers the moment that is seen; p(error) comes
`delay` steps later, and up to `jitter` more. What an answer is worth is `interval` times what one
step's would be, so that all ways to credit it pay the same in the long run:

"arrival"
    What happens to be done when it arrives gets all of it: what a learner does that knows nothing
    of delays.
"held"
    The last answer is paid at every step until the next one, whatever is done.
"event"
    It is written back to the step that was answered, which a replay buffer makes possible: with EEG
    the event's time is known to the millisecond.
"window"
    It is written back to all steps since the event before it, as if each had been answered so, and
    that of an episode's last event to the steps after it, too: once it is known whether it was the
    last, `interval` steps after the event at the earliest.
"kernel"
    It is written back, as if only the mean delay were known, to the steps of the event's episode
    about that time: weights fall linearly to nothing at `interval` steps before and after (after
    TAMER: Knox & Stone 2009).

But for "held" a step is paid what answers were on average until one is credited to it, and then
what that is above or below: ways to credit differ in nothing else.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rlihf_lib.rl.rewards import TrainingReward, task_reward

CREDITS = ("arrival", "held", "event", "window", "kernel")


@dataclass(frozen=True)
class Timing:
    """When people answer, and what their answers are credited to; see the module."""

    interval: int = 1
    """Steps from one answered event to the next."""
    delay: int = 0
    """Steps from the event to its p(error)."""
    jitter: int = 0
    """Most steps by which it is later still, any number equally likely."""
    credit: str = "event"
    """One of `CREDITS`."""

    def __post_init__(self):
        if self.credit not in CREDITS:
            raise ValueError(f"credit is {self.credit!r}; choose one of {', '.join(CREDITS)}")
        if self.interval < 1 or self.delay < 0 or self.jitter < 0:
            raise ValueError(f"{self}: interval is 1 or more steps, delay and jitter are 0 or more")


class LateReward(TrainingReward):
    """`TrainingReward` of condition "rlihf" whose answers come by a `Timing`.

    `info["late"]` of a step holds what has come to be known of earlier ones: how many steps ago
    they were, counted over episodes, and what their rewards are changed by. `rng` draws the jitter.
    The end of an episode is answered at once, for the robot is at rest.
    """

    def __init__(self, env, *arguments, timing: Timing, rng):
        super().__init__(env, *arguments)
        self.timing, self._rng = timing, rng
        self._due: dict[int, list] = {}  # answers by the step they arrive at
        self._last: dict[int, int] = {}  # step of an episode so far, but for its end, by its first
        self._paid: list[float] = []  # feedback of each step before its answer is known
        self._sum, self._n, self._held = 0.5, 1, 0.5

    def step(self, action) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Advance one step; its reward is what is known of it now."""
        observation, _, terminated, truncated, info = self.advance(action)
        moment, timing, now = info["moment"], self.timing, self._steps - 1
        task: Any = self.unwrapped
        begun = self._steps - task.steps  # first step of this episode
        if not terminated:
            self._last[begun] = now
            if now % timing.interval == 0:
                (answer,) = map(float, self.feedback(self.observer.watch(moment)))
                wait = timing.delay + int(self._rng.integers(timing.jitter + 1))
                if timing.credit == "window":
                    wait = max(wait, timing.interval)
                self._due.setdefault(now + wait, []).append((now, begun, answer))
        answers = self._due.pop(now, [])
        for *_, answer in answers:
            self._held = answer
            self._sum, self._n = self._sum + answer, self._n + 1
        self._paid.append(self._held if timing.credit == "held" else self._sum / self._n)
        late: dict[int, float] = {}
        for event, first, answer in answers:
            over = terminated or truncated or first < begun
            for step, share in self._credited(now, event, first, over):
                amount = share * (answer - self._paid[step])
                late[step] = late.get(step, 0.0) + self.w_hf * amount
        if terminated:
            reward, _ = self.judge(moment)
        else:
            reward = task_reward(moment, self.discount) + self.w_hf * self._paid[-1]
        reward += late.pop(now, 0.0)
        if late:
            info["late"] = now - np.array(list(late)), np.array(list(late.values()))
        return observation, reward, terminated, truncated, info

    def _credited(self, now, event, first, over):
        """Steps that an answer is credited to, and how many times each gets it.

        `first` is that of the event's episode, which is `over`, or not.
        """
        interval, credit = self.timing.interval, self.timing.credit
        if credit == "held":
            return []
        if credit in ("arrival", "event"):
            return [(now if credit == "arrival" else event, interval)]
        if credit == "window":
            last = self._last[first] if over and self._last[first] < event + interval else event
            return [(step, 1) for step in range(max(event - interval + 1, first), last + 1)]
        guess = now - self.timing.delay - self.timing.jitter / 2
        episode = np.arange(first, self._last[first] + 1)
        weights = np.maximum(interval - np.abs(episode - guess), 0)
        if not weights.any():  # it began later, or was over by then
            return [(int(np.clip(guess, first, self._last[first])), interval)]
        near = np.flatnonzero(weights)
        return list(zip(episode[near], interval * weights[near] / weights.sum(), strict=True))
