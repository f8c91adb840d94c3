"""One run: config in, the files of its folder out."""

import importlib.metadata
import os
import platform
import resource
import subprocess
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from safetensors.torch import save
from stable_baselines3.common.callbacks import BaseCallback
from threadpoolctl import threadpool_info

from rlihf_lib.files import canonical_json
from rlihf_lib.rl.asking import Asking, AskingReward
from rlihf_lib.rl.evaluation import EVALUATION_SEEDS, evaluate, policy_of
from rlihf_lib.rl.feedback import check_feedback, rows_of
from rlihf_lib.rl.observer import Observer
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.rl.runs import ACTOR, FUNCTIONS, RunConfig
from rlihf_lib.rl.sac import FastSAC, make_sac
from rlihf_lib.rl.schedules import ScheduledReward
from rlihf_lib.rl.timing import LateReward, Timing
from rlihf_lib.task.gym_env import PickPlaceEnv

LOG_EVERY = 1_000  # steps of training that a row of train.csv sums up
EPISODE_METRICS = ("success", "completed", "collisions", "min_clearance", "steps")


class _Record(BaseCallback):
    """Sums up training every `LOG_EVERY` steps, and evaluates at regular intervals."""

    model: FastSAC

    def __init__(self, config, observer, progress):
        super().__init__()
        self.config, self.observer, self.progress = config, observer, progress
        self.env = PickPlaceEnv(config.horizon)
        self.windows, self.episodes, self.evaluations = [], [], []
        self.episode_return, self.seen = 0.0, np.zeros(2)

    def _on_training_start(self):
        self._evaluate()

    def _on_step(self):
        (reward,), (info,) = self.locals["rewards"], self.locals["infos"]
        self.episode_return += float(reward)
        memory: Any = self.model.replay_buffer  # which this step enters afterwards
        if "late" in info:
            steps_ago, change = info["late"]
            memory.rewards[(memory.pos - steps_ago) % memory.buffer_size, 0] += change
        if "metrics" in info:
            self.episodes.append({"return": self.episode_return, **info["metrics"]})
            self.episode_return = 0.0
        step, config = self.num_timesteps, self.config
        if step % LOG_EVERY == 0 or step == config.total_steps:
            networks = [*self.model.actor.parameters(), *self.model.critic.parameters()]
            if not all(torch.isfinite(values).all() for values in networks):
                raise self.divergence()
            self._sum_up()
        if step % config.eval_every == 0:
            self._evaluate()
        if step % LOG_EVERY == 0:
            last = self.evaluations[-config.eval_rollouts :]
            self.progress(step, np.mean([row["success"] for row in last]))
        return True

    def divergence(self):
        """What to raise when values have become NaN or infinite."""
        return FloatingPointError(
            f"{self.config.run_id} has diverged: actions or networks are NaN or infinite after "
            f"{self.num_timesteps} steps, with {self.config.sac}"
        )

    def _sum_up(self):
        window = {"step": self.num_timesteps, "episodes": len(self.episodes)}
        means = pd.DataFrame(self.episodes, columns=["return", *EPISODE_METRICS]).mean()
        if self.observer:
            seen = np.array([self.observer.errors_seen, self.observer.watched])
            wrong, watched = seen - self.seen
            means["judged_wrong"] = wrong / watched if watched else np.nan
            self.seen = seen
        self.windows.append({**window, **means})
        self.episodes = []

    def _evaluate(self):
        point = self.num_timesteps // self.config.eval_every
        first = EVALUATION_SEEDS + 1_000 * (1_000 * self.config.seed + point)
        seeds = range(first, first + self.config.eval_rollouts)
        rows = evaluate(self.env, policy_of(self.model), seeds)
        self.evaluations += [{"step": self.num_timesteps, **row} for row in rows]
        # Kept as evaluated: SB3 updates once more after the last step.
        self.actor = {k: v.clone() for k, v in self.model.actor.state_dict().items()}

    def training_table(self):
        """Training in windows of `LOG_EVERY` steps, with the update at the end of each.

        Means over the episodes that ended in it, the share of the steps watched that looked wrong
        to the observer, and what the learner says (`FastSAC.learning`). Returns are of rewards as
        they were when steps were made, before answers that come late.
        """
        window = ["step", "episodes", "return", *EPISODE_METRICS, "judged_wrong"]
        update = ["step", "critic_loss", "ent_coef", "mean_q"]
        learning = pd.DataFrame(self.model.learning, columns=update)
        table = pd.DataFrame(self.windows, columns=window).merge(learning, on="step", how="left")
        # Single precision's digits say all there is.
        return table.astype(dict.fromkeys(table.columns[2:], np.float32))


def training_reward(env, config: RunConfig, rows, rng, decode=None) -> TrainingReward:
    """Give an environment a config's reward, and the observer that rows of p(error) answer.

    Nobody watches if `rows` is None; `rng` and `decode` are the `Observer`'s.
    """
    named = ((getattr(config, name), known) for name, known in FUNCTIONS.items())
    looks_wrong, *functions = (one if callable(one) else known[one] for one, known in named)
    watching = rows, rng, looks_wrong, decode, config.session, config.asking.once
    observer = None if rows is None else Observer(*watching)
    weights = config.sac.discount, config.w_hf
    told = config.condition, *weights, observer, *functions, config.total_steps
    if observer and config.timing != Timing():
        return LateReward(env, *told, timing=config.timing, rng=rng)
    if observer and config.asking != Asking():
        return AskingReward(env, *told, asking=config.asking, rng=rng)
    if observer and config.schedule != "constant":
        return ScheduledReward(env, *told, schedule=config.schedule)
    return TrainingReward(env, *told)


def _doubt(model, *steps):
    """How far apart the critics are about steps, relative to their values, on average."""
    with torch.no_grad():
        first, second = model.critic(*(torch.as_tensor(x, dtype=torch.float32) for x in steps))
    return float(((first - second).abs() / (1 + (first + second).abs() / 2)).mean())


def train_run(
    config: RunConfig, p_error=None, progress=lambda step, success: None, decode=None
) -> dict[str, bytes]:
    """Train and evaluate one policy; a pure function of its config and of `p_error`.

    Condition "rlihf" needs the p(error) table (`rlihf_lib.rl.feedback`). `progress` is called every
    1,000 steps with how many are done and the last evaluation's success rate; `decode`: `Observer`.

    Returns
    -------
    dict of str to bytes
        Files of the run's folder, by name, for `runs.write_run`.

    Raises
    ------
    ValueError
        If the subject has no rows in `p_error`, not both classes, or other rows than the config
        names by hash.
    FloatingPointError
        If actions, actor or critics become NaN or infinite.
    """
    started = time.perf_counter()
    torch.set_num_threads(1)
    # One stream per use, so that a change in one leaves the others as they were.
    placement, watching, learning = np.random.SeedSequence(config.seed).generate_state(3)
    rows = None
    if config.subject:
        check_feedback([config], p_error)
        rows = rows_of(p_error, config.subject)
    task = PickPlaceEnv(config.horizon, config.patience)
    env = training_reward(task, config, rows, np.random.default_rng(watching), decode)
    env.reset(seed=int(placement % EVALUATION_SEEDS))
    model = make_sac(env, config.sac, int(learning), LOG_EVERY)
    if isinstance(env, ScheduledReward):
        env.doubt = partial(_doubt, model)
    record = _Record(config, env.observer, progress)
    try:
        model.learn(config.total_steps, callback=record)
    except np.linalg.LinAlgError as error:  # what an action of NaN does to the arm
        raise record.divergence() from error
    provenance = {
        **_provenance(),
        "wall_seconds": round(time.perf_counter() - started, 1),
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "errors_seen": env.observer.errors_seen if env.observer else 0,
        "watched": env.observer.watched if env.observer else 0,
        **env.notes(),
    }
    texts = {
        "config.json": canonical_json({**config.to_dict(), "hash": config.hash}) + "\n",
        "provenance.json": canonical_json(provenance) + "\n",
        "train.csv": record.training_table().to_csv(index=False, lineterminator="\n"),
        "eval.csv": pd.DataFrame(record.evaluations).to_csv(index=False, lineterminator="\n"),
    }
    files = {name: text.encode() for name, text in texts.items()}
    return {**files, ACTOR: save(record.actor)}


def processor() -> str:
    """Name of the processor, where Linux tells it."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _provenance():
    """Versions and machine a result was computed with."""
    packages = ("rlihf_lib", "torch", "stable-baselines3", "robosuite", "mujoco", "numpy")
    here = Path(__file__).parents[1]

    def git(*words):
        done = subprocess.run(["git", *words], cwd=here, capture_output=True, text=True)
        return done.stdout.strip()

    # Results written beside the code don't change it.
    changed = "-dirty" if git("status", "--porcelain", "--", ".") else ""
    return {
        "commit": (git("rev-parse", "--short", "HEAD") or "unknown") + changed,
        "packages": {name: importlib.metadata.version(name) for name in packages},
        "python": platform.python_version(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {processor()}",
        "kernels": sorted(
            {blas["architecture"] for blas in threadpool_info() if "architecture" in blas}
        ),
    }
