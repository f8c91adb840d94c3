"""Speed of environment, learner and sweep against the stock stack.

Ratios are medians of alternating repeats in one process on one thread, so that a busy machine slows
both sides alike.
"""

import contextlib
import statistics
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
import torch
from robosuite.wrappers import GymWrapper
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure

from rlihf_lib.rl.feedback import perfect_table
from rlihf_lib.rl.observer import Observer
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.rl.runs import RunConfig, SACSettings
from rlihf_lib.rl.sac import make_sac
from rlihf_lib.rl.sweep import run_sweep
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.scripted import expert_action
from rlihf_lib.task.workspace import Workspace


def _stock():
    """The same scene with robosuite's meshes, timestep, `step` and GymWrapper."""
    return GymWrapper(Workspace(fast=False), keys=["robot0_proprio-state"])


def env_speedup(repeats, steps=100):
    """Ratio of control steps per second to robosuite's stock `env.step` through its GymWrapper.

    The smaller of two ratios: under random actions, and under the scripted expert's.
    """
    fast, stock = PickPlaceEnv(), _stock()
    # The expert's actions are drawn beforehand; stock robosuite takes them as absolute poses.
    fast.reset(seed=0)
    expert = []
    for _ in range(40):
        expert.append(expert_action(fast))
        fast.step(expert[-1])
    rng = np.random.default_rng(0)
    ratios = []
    for actions in (rng.uniform(-1, 1, (steps, 4)), np.array(expert)):
        poses = _poses(actions)
        rates = [(_rate(fast, actions), _rate(stock, poses)) for _ in range(repeats)]
        ratios.append(statistics.median(a / b for a, b in rates))
    return min(ratios)


def _poses(actions):
    """Absolute hand poses and gripper commands that the actions lead to, for the stock env."""
    env = PickPlaceEnv()
    env.reset(seed=0)
    poses = []
    for action in actions:
        env.controller.advance(action)
        poses.append([*env.controller.goal_pos, np.pi, 0, 0, action[3]])
    return np.array(poses)


def _rate(env, actions):
    env.reset(seed=0)
    start = time.perf_counter()
    for action in actions:
        env.step(action)
    return len(actions) / (time.perf_counter() - start)


def mujoco_share(repeats, steps=200):
    """Share of the environment's time that MuJoCo's own timers account for."""
    env, rng, shares = PickPlaceEnv(), np.random.default_rng(0), []
    timer = env.data.timer[mujoco.mjtTimer.mjTIMER_STEP]
    for _ in range(repeats):
        env.reset(seed=0)
        before, start = timer.duration, time.perf_counter()
        for action in rng.uniform(-1, 1, (steps, 4)):
            env.step(action)
        elapsed = time.perf_counter() - start
        shares.append((timer.duration - before) / elapsed)
    return statistics.median(shares)


def _learners():
    """The study's learner on the fast environment, and SB3's SAC on the stock one.

    SB3's critics are not normalised, nor are their inputs noisy: it has less to do.
    """
    settings = SACSettings(learning_starts=300)
    env = TrainingReward(PickPlaceEnv(patience=RunConfig.patience), "dense", settings.discount)
    fast = make_sac(env, settings, seed=0)
    stock = SAC(
        "MlpPolicy", _stock(),
        learning_rate=settings.learning_rate, learning_starts=300, gamma=settings.discount,
        batch_size=settings.batch_size, tau=settings.tau, train_freq=settings.train_freq,
        gradient_steps=settings.gradient_steps, seed=0, device="cpu",
        policy_kwargs={"net_arch": list(settings.hidden)},
    )  # fmt: skip
    stock.set_logger(configure(None, []))
    return fast, stock


def train_and_update_speedup(repeats, steps=150, updates=100):
    """Ratios of training steps per second, and of gradient updates per second, to SB3's."""
    torch.set_num_threads(1)
    learners = _learners()
    for model in learners:
        model.learn(320)
    training, updating = [], []
    for _ in range(repeats):
        rates = []
        for model in learners:
            start = time.perf_counter()
            model.learn(steps, reset_num_timesteps=False)
            middle = time.perf_counter()
            model.train(updates, SACSettings().batch_size)
            end = time.perf_counter()
            rates.append((steps / (middle - start), updates / (end - middle)))
        (fast_steps, fast_updates), (stock_steps, stock_updates) = rates
        training.append(fast_steps / stock_steps)
        updating.append(fast_updates / stock_updates)
    return statistics.median(training), statistics.median(updating)


def feedback_cost(repeats, steps=150):
    """Ratio of the time a step takes with human feedback to that with dense reward, no update."""
    discount, rng = SACSettings().discount, np.random.default_rng(0)
    observer = Observer(perfect_table(), rng)
    task = PickPlaceEnv()
    dense = TrainingReward(task, "dense", discount)
    rlihf = TrainingReward(task, "rlihf", discount, 0.7, observer)
    actions = rng.uniform(-1, 1, (steps, 4))
    ratios = [_rate(dense, actions) / _rate(rlihf, actions) for _ in range(3 * repeats)]
    return statistics.median(ratios)


def sweep_scaling(repeats, steps=30_000):
    """Ratio of the sweep's throughput with two workers to that with one, start-up included.

    Runs of 30,000 steps, so that the ten seconds that workers take to start don't decide: they are
    a hundredth of a run of 150,000.
    """
    configs = [
        RunConfig(condition="dense", seed=seed, total_steps=steps, eval_every=steps, horizon=100,
                  eval_rollouts=1)
        for seed in range(2)
    ]  # fmt: skip
    ratios = []
    for _ in range(repeats):
        seconds = []
        for workers in (1, 2):
            with tempfile.TemporaryDirectory() as folder:
                start = time.perf_counter()
                with contextlib.redirect_stdout(None):
                    run_sweep(configs, Path(folder) / "runs", workers=workers)
                seconds.append(time.perf_counter() - start)
        ratios.append(seconds[0] / seconds[1])
    return statistics.median(ratios)


def measure(repeats):
    """Measure all of it; yield names and ratios as they are known."""
    yield "env_speedup", env_speedup(repeats)
    yield "mujoco_share", mujoco_share(repeats)
    training, updating = train_and_update_speedup(repeats)
    yield "train_speedup", training
    yield "update_speedup", updating
    yield "feedback_cost", feedback_cost(repeats)
    yield "sweep_scaling", sweep_scaling(max(1, repeats // 3))
