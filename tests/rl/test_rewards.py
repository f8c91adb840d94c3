"""Rewards of training and of the evaluation."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.rl.evaluation import rollout
from rlihf_lib.rl.observer import Observer
from rlihf_lib.rl.rewards import (
    NEAR_PATH,
    PLACED,
    TrainingReward,
    alignment_reward,
    errp_reward,
    evaluation_reward,
    task_reward,
)
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.path import IdealPath
from rlihf_lib.task.scripted import expert_action
from tests.rl.conftest import moment

PATH = IdealPath([-0.19, -0.15, 1.0], [-0.07, -0.2, 0.84], [-0.07, 0.2, 0.84])
DISCOUNT, HORIZON = 0.9, 200


def test_errp_reward_is_one_minus_p():
    assert errp_reward(0.25) == 0.75
    np.testing.assert_allclose(errp_reward(np.array([0.0, 1.0])), [1.0, 0.0])


def test_task_reward_pays_success_for_ever_and_penalises_collisions():
    assert task_reward(moment(), DISCOUNT) == 0
    assert task_reward(moment(collided=True), DISCOUNT) == -2
    assert task_reward(moment(success=True), 0.98) == pytest.approx(50)


def test_alignment_reward_pays_new_ground_only():
    remaining, best, paid = (0.50, 0.47, 0.44, 0.49, 0.46, 0.43, 0.40), 0.50, []
    for left in remaining:
        paid.append(alignment_reward(moment(remaining=left, best=best)))
        best = min(best, left)
    assert paid == pytest.approx([0, 0.75, 0.75, 0, 0, 0.25, 0.75])


def test_dense_reward_adds_to_every_step_but_the_one_that_places_the_can():
    env = TrainingReward(PickPlaceEnv(HORIZON), "dense", DISCOUNT)
    gained = moment(remaining=0.44, best=0.47)
    assert env.judge(gained)[0] == pytest.approx(alignment_reward(gained)) and env.judge(gained)[0]
    placed = moment(remaining=0.44, best=0.47, success=True)
    assert env.judge(placed)[0] == task_reward(placed, DISCOUNT)


def test_feedback_goes_on_after_the_can_has_fallen_or_stands_on_the_goal():
    table = pd.DataFrame({"epoch": [0, 1], "label": [0, 1], "p_error": [0.25, 0.75]})
    env = TrainingReward(
        PickPlaceEnv(HORIZON), "rlihf", 0.96, 0.7, Observer(table, np.random.default_rng(0))
    )
    env.reset(seed=0)
    task, address = env.unwrapped, env.unwrapped.workspace.qpos_address["can"]
    task.data.qpos[address : address + 3] = [0.0, 0.6, 0.84]
    _, fallen, terminated, *_ = env.step(np.zeros(4))
    # Nothing to lose and nothing to gain against a robot that stands still for ever.
    assert terminated and fallen == pytest.approx(0.7 * 0.25 / (1 - 0.96), rel=0.02)

    *_, (_, placed, terminated, *_) = rollout(env, expert_action, 0)
    assert terminated and placed == pytest.approx((1 + 0.7 * 0.75) / (1 - 0.96), rel=0.02)


def test_what_an_answer_is_worth_may_be_said_by_a_function_of_the_reader():
    table = pd.DataFrame({"epoch": [0, 1], "label": [0, 1], "p_error": [0.2, 0.2]})
    observer = Observer(table, np.random.default_rng(0))
    told = PickPlaceEnv(HORIZON), "rlihf", 0.9, 0.5, observer
    env = TrainingReward(*told, feedback=lambda p_error: 3 * p_error)
    env.reset(seed=0)
    assert env.step(np.zeros(4))[1] == pytest.approx(0.5 * 3 * 0.2)


def test_evaluation_reward_of_standing_still_is_zero_and_of_success_is_one():
    start = moment(remaining=PATH.start_remaining)
    assert evaluation_reward(start, PATH) == 0
    assert evaluation_reward(moment(success=True, remaining=0.0), PATH) == PLACED
    assert evaluation_reward(moment(collided=True), PATH) < evaluation_reward(moment(), PATH)
    half = moment(remaining=PATH.start_remaining / 2, deviation=NEAR_PATH)
    assert evaluation_reward(half, PATH) == pytest.approx(0.25 / 2 * np.exp(-1))
