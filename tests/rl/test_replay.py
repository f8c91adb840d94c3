"""Trained policies from their run folders: the same rollouts again, films, drawn paths."""

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from rlihf_lib.report.figures_task import paths_figure
from rlihf_lib.rl.config import RunConfig, SACSettings
from rlihf_lib.rl.evaluation import rollout
from rlihf_lib.rl.replay import load_policy, record
from rlihf_lib.rl.training import EVALUATION_SEEDS, train_run
from rlihf_lib.task.expert import expert_action
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.rendering import film

HORIZON = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "dense-seed0"
    config = RunConfig(
        condition="dense", seed=0, total_steps=250, eval_every=250, horizon=HORIZON,
        eval_rollouts=1, sac=SACSettings(hidden=(32, 32), learning_starts=200, batch_size=64),
    )  # fmt: skip
    train_run(config, folder)
    return folder


def test_loaded_policy_repeats_the_last_evaluation(folder):
    env = PickPlaceEnv(HORIZON)
    again = rollout(env, load_policy(folder, env), EVALUATION_SEEDS + 1_000)
    last = pd.read_csv(folder / "eval.csv", float_precision="round_trip").iloc[-1]
    for name, value in again.items():
        assert value == pytest.approx(last[name], abs=1e-12), name


def test_missing_run_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"config\.json is missing; train"):
        load_policy(tmp_path, PickPlaceEnv(HORIZON))


def test_recording_ends_with_the_can_on_the_goal():
    env = PickPlaceEnv(HORIZON)
    recording = record(env, lambda _: expert_action(env), 1)
    assert recording.success and len(recording.hand) == len(recording.qpos) == env.steps + 1
    assert np.linalg.norm(recording.can[-1, :2] - env.goal[:2]) < 0.04


def test_film_has_a_frame_for_every_state_and_stays_small(tmp_path):
    env = PickPlaceEnv(12)
    recording = record(env, lambda _: expert_action(env), 1)
    if not film(tmp_path / "film.gif", recording.qpos, recording.seed):
        pytest.skip("no OpenGL library here")
    with Image.open(tmp_path / "film.gif") as pictures:
        assert pictures.n_frames == len(recording.qpos)
    assert (tmp_path / "film.gif").stat().st_size < 300_000


def test_paths_figure_draws_every_run_from_above_and_from_the_side():
    env = PickPlaceEnv(HORIZON)
    placed = record(env, lambda _: expert_action(env), 1)
    idle = record(PickPlaceEnv(5), lambda _: np.zeros(4), 1)
    env.reset(seed=1)
    figure = paths_figure(
        env, {"dense": [placed, placed], "rlihf": [idle]}, {0.02: "near", 0.05: "far"}
    )
    top, side = figure.axes
    for ax, axes in ((top, (1, 0)), (side, (1, 2))):
        drawn = [line.get_xydata() for line in ax.lines]
        for run in (placed, idle):
            assert any(np.array_equal(line, run.hand[:, axes]) for line in drawn)
    assert any("2 of 2 runs place the can" in line.get_label() for line in top.lines)
