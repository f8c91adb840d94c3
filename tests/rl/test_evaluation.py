"""Rollouts: of trained policies from their run folders, films, drawn paths."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report.figures_task import paths_figure
from rlihf_lib.rl.evaluation import EVALUATION_SEEDS, evaluate, load_policy, record, rollout, watch
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.rl.runs import RunConfig, SACSettings, write_run
from rlihf_lib.rl.training import train_run
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.moment import STAGES
from rlihf_lib.task.scripted import expert_action, sit_still

HORIZON = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    config = RunConfig(
        condition="dense", seed=0, total_steps=250, eval_every=250, horizon=HORIZON,
        eval_rollouts=1, sac=SACSettings(hidden=(32, 32), learning_starts=200, batch_size=64),
    )  # fmt: skip
    return write_run(config, tmp_path_factory.mktemp("runs"), train_run(config))


def test_a_rollout_ends_with_the_episode_and_can_be_left_before():
    env = TrainingReward(PickPlaceEnv(5), "sparse", discount=0.9)
    steps = list(rollout(env, sit_still, 1))
    assert [truncated for _, _, _, truncated, _ in steps] == 4 * [False] + [True]
    moments, terminated = watch(env, sit_still, 1, steps=3)
    assert moments == [info["moment"] for *_, info in steps[:3]] and not terminated


def test_steps_left_after_a_success_count_as_placed():
    env = PickPlaceEnv(HORIZON)
    (row,) = evaluate(env, expert_action, [1])
    assert row["success"] == 1 and row["steps"] < HORIZON
    assert row["return"] > HORIZON - row["steps"] + 1


def test_loaded_policy_repeats_the_last_evaluation(folder):
    env = PickPlaceEnv(HORIZON)
    (again,) = evaluate(env, load_policy(folder, env), [EVALUATION_SEEDS + 1_000])
    last = pd.read_csv(folder / "eval.csv", float_precision="round_trip").iloc[-1]
    for name, value in again.items():
        assert value == pytest.approx(last[name], abs=1e-12), name


def test_missing_run_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"actor\.safetensors is missing; train"):
        load_policy(tmp_path, PickPlaceEnv(HORIZON))


def test_recording_ends_with_the_can_on_the_goal():
    env = PickPlaceEnv(HORIZON)
    recording = record(env, expert_action, 1)
    assert recording.success and len(recording.hand) == len(recording.qpos) == env.steps + 1
    assert np.linalg.norm(recording.can[-1, :2] - env.goal[:2]) < 0.04
    assert len(recording.moments) == len(recording.stages) == env.steps
    assert recording.moments[-1].success
    assert list(dict.fromkeys(recording.stages)) == list(STAGES)


def test_recording_of_a_robot_that_places_nothing_ends_after_thirty_seconds():
    recording = record(PickPlaceEnv(1_000), sit_still, 1)
    assert not recording.success and len(recording.moments) == 300 == len(recording.qpos) - 1


def test_paths_figure_draws_every_run_from_above_and_from_the_side():
    env = PickPlaceEnv(HORIZON)
    placed = record(env, expert_action, 1)
    idle = record(PickPlaceEnv(5), sit_still, 1)
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
