"""One run: config in, run folder out."""

import importlib.metadata
import os
import platform
import resource
import subprocess
import time
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from safetensors.torch import save_file
from stable_baselines3.common.callbacks import BaseCallback

from rlihf_lib.files import atomic_path, canonical_json, write_csv, write_text
from rlihf_lib.rl.evaluation import evaluate
from rlihf_lib.rl.observer import OBSERVERS, Observer, check_feedback, rows_of
from rlihf_lib.rl.rewards import REWARDS, TrainingReward
from rlihf_lib.rl.sac import make_sac
from rlihf_lib.task.gym_env import PickPlaceEnv

LOG_EVERY = 1_000  # steps of training that a row of train.csv sums up
EPISODE_METRICS = ("success", "completed", "collisions", "min_clearance", "steps")
#: Of train.csv: means over the episodes that ended in the window, the share of its steps that
#: looked wrong to the observer, and three numbers of the update at its end (`FastSAC.learning`).
TRAINING_COLUMNS = (
    "step", "episodes", "return", *EPISODE_METRICS, "judged_wrong",
    "critic_loss", "ent_coef", "mean_q",
)  # fmt: skip
EVALUATION_SEEDS = 1_000_000  # placements from here on are never trained on


class _Record(BaseCallback):
    """Sums up training every `LOG_EVERY` steps, and evaluates at regular intervals."""

    def __init__(self, config, evaluation_env, observer, progress):
        super().__init__()
        self.config, self.evaluation_env, self.progress = config, evaluation_env, progress
        self.observer = observer
        self.windows, self.episodes, self.evaluations = [], [], []
        self.episode_return, self.errors_seen, self.started = 0.0, 0, 0

    def _on_training_start(self):
        self._evaluate()

    def _on_step(self):
        self.episode_return += float(self.locals["rewards"][0])
        info = self.locals["infos"][0]
        if "metrics" in info:
            self.episodes.append({"return": self.episode_return, **info["metrics"]})
            self.episode_return = 0.0
        if self.num_timesteps % LOG_EVERY == 0 or self.num_timesteps == self.config.total_steps:
            self._sum_up()
        if self.num_timesteps % self.config.eval_every == 0:
            self._evaluate()
        return True

    def _sum_up(self):
        window = {"step": self.num_timesteps, "episodes": len(self.episodes)}
        means = pd.DataFrame(self.episodes, columns=["return", *EPISODE_METRICS]).mean()
        if self.observer:
            seen = self.observer.errors_seen - self.errors_seen
            window["judged_wrong"] = seen / (self.num_timesteps - self.started)
            self.errors_seen = self.observer.errors_seen
        self.windows.append({**window, **means})
        self.episodes, self.started = [], self.num_timesteps

    def training_table(self):
        """Training in windows of `LOG_EVERY` steps, with the update at the end of each."""
        windows = pd.DataFrame(self.windows, columns=TRAINING_COLUMNS[:-3])
        learning = pd.DataFrame(self.model.learning, columns=["step", *TRAINING_COLUMNS[-3:]])
        table = windows.merge(learning, on="step", how="left")
        # Single precision's digits say all there is.
        return table.astype(dict.fromkeys(TRAINING_COLUMNS[2:], np.float32))

    def _evaluate(self):
        config = self.config
        point = self.num_timesteps // config.eval_every
        first = EVALUATION_SEEDS + 1_000 * (1_000 * config.seed + point)
        seeds = range(first, first + config.eval_rollouts)
        rows = evaluate(self.evaluation_env, self.model, seeds)
        self.evaluations += [{"step": self.num_timesteps, **row} for row in rows]
        # Kept as evaluated: SB3 updates once more after the last step.
        self.actor = {k: v.clone() for k, v in self.model.policy.actor.state_dict().items()}
        self.progress(self.num_timesteps)


def train_run(config, folder, p_error=None, progress=lambda step: None, decode=None):
    """Train and evaluate one policy; a pure function of its config and of `p_error`.

    Parameters
    ----------
    config : RunConfig
    folder : Path
        Receives config.json, provenance.json, train.csv, eval.csv and actor.safetensors.
    p_error : DataFrame, optional
        Columns subject, epoch, label, p_error; needed by condition "rlihf".
    progress : callable
        Called with the number of steps done after each evaluation.
    decode : callable, optional
        Decodes the feedback anew instead of looking it up; see `Observer`.

    Raises
    ------
    ValueError
        If the subject has no rows in `p_error`, not both classes, or other rows than the config
        names by hash.
    """
    started = time.perf_counter()
    torch.set_num_threads(1)
    folder = Path(folder)
    # One stream per use, so that a change in one leaves the others as they were.
    placement, observer_seed, learner = np.random.SeedSequence(config.seed).generate_state(3)
    observer = None
    if config.condition == "rlihf":
        check_feedback([config], p_error)
        looks_wrong = OBSERVERS.get(config.observer, config.observer)
        rng = np.random.default_rng(observer_seed)
        observer = Observer(rows_of(p_error, config.subject), rng, looks_wrong, decode)
    env = TrainingReward(
        PickPlaceEnv(config.horizon, config.patience),
        config.condition,
        config.sac.discount,
        config.w_hf,
        observer,
        REWARDS.get(config.reward, config.reward),
    )
    env.reset(seed=int(placement % EVALUATION_SEEDS))
    model = make_sac(env, config.sac, int(learner), LOG_EVERY)
    record = _Record(config, PickPlaceEnv(config.horizon), observer, progress)
    model.learn(config.total_steps, callback=record)
    with atomic_path(folder / "actor.safetensors") as path:
        save_file(record.actor, path)
    write_text(
        folder / "config.json",
        canonical_json({**config.to_dict(), "hash": config.hash}) + "\n",
    )
    write_csv(folder / "train.csv", record.training_table())
    write_csv(folder / "eval.csv", pd.DataFrame(record.evaluations))
    provenance = {
        **environment(),
        "wall_seconds": round(time.perf_counter() - started, 1),
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "errors_seen": observer.errors_seen if observer else 0,
    }
    write_text(folder / "provenance.json", canonical_json(provenance) + "\n")


def environment():
    """Versions and machine a result was computed with."""
    packages = ("rlihf_lib", "torch", "stable-baselines3", "robosuite", "mujoco", "numpy")
    here = Path(__file__).parents[1]

    def git(*arguments):
        done = subprocess.run(
            ["git", *arguments], cwd=here, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    # Results written beside the code don't change it.
    changed = "-dirty" if git("status", "--porcelain", "--", ".") else ""
    return {
        "commit": (git("rev-parse", "--short", "HEAD") or "unknown") + changed,
        "packages": {name: importlib.metadata.version(name) for name in packages},
        "python": platform.python_version(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
    }
