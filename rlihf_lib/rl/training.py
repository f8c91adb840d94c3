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
from rlihf_lib.rl.observer import Observer
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.rl.sac import make_sac
from rlihf_lib.task.gym_env import PickPlaceEnv

EVALUATION_SEEDS = 1_000_000  # placements from here on are never trained on


class _Record(BaseCallback):
    """Collects training episodes and evaluates at regular intervals."""

    def __init__(self, config, evaluation_env, progress):
        super().__init__()
        self.config, self.evaluation_env, self.progress = config, evaluation_env, progress
        self.episodes, self.evaluations = [], []
        self.episode_return = 0.0

    def _on_training_start(self):
        self._evaluate()

    def _on_step(self):
        self.episode_return += float(self.locals["rewards"][0])
        info = self.locals["infos"][0]
        if "metrics" in info:
            self.episodes.append(
                {
                    "step": self.num_timesteps,
                    "episode": len(self.episodes),
                    "return": self.episode_return,
                    **info["metrics"],
                }
            )
            self.episode_return = 0.0
        if self.num_timesteps % self.config.eval_every == 0:
            self._evaluate()
        return True

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
        If the subject has no rows, or not both classes, in `p_error`.
    """
    started = time.perf_counter()
    torch.set_num_threads(1)
    folder = Path(folder)
    # One stream per use, so that a change in one leaves the others as they were.
    placement, observer_seed, learner = np.random.SeedSequence(config.seed).generate_state(3)
    observer = None
    if config.condition == "rlihf":
        if p_error is None or config.subject not in set(p_error["subject"]):
            known = "none" if p_error is None else ", ".join(sorted(set(p_error["subject"])))
            raise ValueError(
                f"subject {config.subject!r} is not in the p(error) table (there: {known}); "
                "decode it first with notebook 02"
            )
        rows = p_error[p_error["subject"] == config.subject]
        observer = Observer(rows, np.random.default_rng(observer_seed), decode)
    env = TrainingReward(
        PickPlaceEnv(config.horizon, config.patience),
        config.condition,
        config.sac.discount,
        config.w_hf,
        observer,
    )
    env.reset(seed=int(placement % EVALUATION_SEEDS))
    model = make_sac(env, config.sac, int(learner))
    record = _Record(config, PickPlaceEnv(config.horizon), progress)
    model.learn(config.total_steps, callback=record)
    with atomic_path(folder / "actor.safetensors") as path:
        save_file(record.actor, path)
    write_text(
        folder / "config.json",
        canonical_json({**config.to_dict(), "hash": config.hash}) + "\n",
    )
    write_csv(folder / "train.csv", pd.DataFrame(record.episodes))
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
