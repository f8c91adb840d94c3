"""The one rollout loop, and what is made of rollouts: evaluations, moments, films.

Whoever acts, a policy or a script, is a function `act(env) -> action` of the environment's present
state; a policy looks at `env.observation` only.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from safetensors.torch import load_file
from stable_baselines3 import SAC

from rlihf_lib.rl.rewards import PLACED, evaluation_reward
from rlihf_lib.rl.runs import ACTOR, SACSettings, is_whole
from rlihf_lib.rl.sac import make_sac
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.moment import Moment

EVALUATION_SEEDS = 1_000_000  # placements from here on are never trained on
SHOWN = 300  # steps of a recording at most: what is not placed in 30 s hardly ever is
Act = Callable[[Any], np.ndarray]


def rollout(env: gym.Env, act: Act, seed: int) -> Iterator[tuple]:
    """Run one episode from the placement of a seed; yield what `env.step` returns."""
    env.reset(seed=seed)
    terminated = truncated = False
    while not (terminated or truncated):
        _, _, terminated, truncated, _ = step = env.step(act(env.unwrapped))
        yield step


def evaluate(env: PickPlaceEnv, act: Act, seeds: Iterable[int]) -> list[dict[str, float]]:
    """Run one episode per seed and judge it: a row each of number, return and metrics.

    The unified evaluation reward, summed over the horizon, where steps left after success count
    `PLACED` each; and `PickPlaceEnv.metrics`.
    """
    rows = []
    for number, seed in enumerate(seeds):
        total = 0.0
        for *_, info in rollout(env, act, seed):
            total += evaluation_reward(info["moment"], env.path)
        metrics = info["metrics"]
        total += PLACED * (env.horizon - metrics["steps"]) * metrics["success"]
        rows.append({"rollout": number, "return": total, **metrics})
    return rows


def watch(env: gym.Env, act: Act, seed: int, steps: int) -> tuple[list[Moment], bool]:
    """Return an episode's moments, `steps` at most, and whether it terminated within them."""
    taken = list(islice(rollout(env, act, seed), steps))
    return [info["moment"] for *_, info in taken], taken[-1][2]


@dataclass(frozen=True)
class Recording:
    """One rollout: states before the first step and after each, n in all."""

    hand: np.ndarray  # positions, metres, shape (n, 3)
    can: np.ndarray  # positions of its centre, metres, shape (n, 3)
    qpos: np.ndarray  # generalised positions, shape (n, nq), for `task.rendering.render_rollout`
    seed: int  # of the placement
    success: bool  # whether the can was placed
    moments: tuple[Moment, ...] = ()  # of the n - 1 steps
    stages: tuple[str, ...] = ()  # of the lay person's task, in which each step was made


def record(env: PickPlaceEnv, act: Act, seed: int) -> Recording:
    """Run one episode, `SHOWN` steps at most; keep what a film or a drawing of its path needs."""

    def look():
        return env.controller.hand.copy(), env.body("can"), env.data.qpos.copy()

    env.reset(seed=seed)
    states, steps = [look()], []
    for *_, info in islice(rollout(env, act, seed), SHOWN):
        states.append(look())
        steps.append((info["moment"], env.stages.stage))
    hand, can, qpos = (np.array(part) for part in zip(*states, strict=True))
    moments, stages = zip(*steps, strict=True)
    return Recording(hand, can, qpos, seed, moments[-1].success, moments, stages)


def policy_of(model: SAC) -> Act:
    """Return a learner's deterministic policy."""
    return lambda env: model.predict(env.observation, deterministic=True)[0]


def load_policy(folder: str | Path, env: PickPlaceEnv) -> Act:
    """Return the deterministic policy of a run's folder; a FileNotFoundError if not finished.

    A ValueError names a file of it that has changed since.
    """
    config, actor = Path(folder) / "config.json", Path(folder) / ACTOR
    if not (is_whole(Path(folder)) and actor.is_file()):
        raise FileNotFoundError(f"{actor} is missing; train the run with notebook 03")
    settings = SACSettings(**json.loads(config.read_text(encoding="utf-8"))["sac"])
    model = make_sac(env, settings, seed=0)
    model.policy.actor.load_state_dict(load_file(actor))
    return policy_of(model)
