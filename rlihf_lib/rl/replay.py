"""Trained policies, loaded from their run folders and rolled out once more."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors.torch import load_file

from rlihf_lib.rl.config import SACSettings
from rlihf_lib.rl.sac import make_sac


@dataclass(frozen=True)
class Recording:
    """One rollout: states before the first step and after each, n in all."""

    hand: np.ndarray
    """Positions of the hand, metres, shape (n, 3)."""
    can: np.ndarray
    """Positions of the can's centre, metres, shape (n, 3)."""
    qpos: np.ndarray
    """Generalised positions of the simulation, shape (n, nq), for `task.rendering.film`."""
    seed: int
    """Of the placement."""
    success: bool
    """Whether the can was placed."""


def load_policy(folder, env):
    """Return the deterministic policy of a finished run.

    Parameters
    ----------
    folder : Path
        Run folder with config.json and actor.safetensors.
    env : PickPlaceEnv
        Whose observations and actions it is for.

    Returns
    -------
    callable
        Observation (n,) -> action (4,).

    Raises
    ------
    FileNotFoundError
        If the run is not there.
    """
    folder = Path(folder)
    for name in ("config.json", "actor.safetensors"):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"{folder / name} is missing; train the run with notebook 03")
    settings = json.loads((folder / "config.json").read_text())["sac"]
    model = make_sac(env, SACSettings(**settings), seed=0)
    model.policy.actor.load_state_dict(load_file(folder / "actor.safetensors"))
    return lambda observation: model.predict(observation, deterministic=True)[0]


def record(env, act, seed):
    """Roll a policy out and keep what a film or a drawing of its path needs.

    Parameters
    ----------
    env : PickPlaceEnv
    act : callable
        Observation (n,) -> action (4,).
    seed : int
        Of the placement.

    Returns
    -------
    Recording
    """
    observation, _ = env.reset(seed=seed)
    states, done, info = [_state(env)], False, {"is_success": False}
    while not done:
        observation, _, terminated, truncated, info = env.step(act(observation))
        states.append(_state(env))
        done = terminated or truncated
    hand, can, qpos = (np.array(part) for part in zip(*states, strict=True))
    return Recording(hand, can, qpos, seed, bool(info["is_success"]))


def _state(env):
    return env.controller.hand.copy(), env.body("can"), env.data.qpos.copy()
