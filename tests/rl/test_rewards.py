"""Rewards, observer, and that the scripted expert earns more than scripted exploiters."""

import dataclasses
from itertools import cycle

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.rl.config import RunConfig, SACSettings
from rlihf_lib.rl.incentives import (
    discounted_returns,
    expected_feedback,
    expected_returns,
    explained_by_dense,
    margin,
    play,
    watch,
)
from rlihf_lib.rl.observer import (
    OBSERVERS,
    Observer,
    comfort,
    lay_observer,
    path_observer,
    perfect_table,
)
from rlihf_lib.rl.rewards import (
    PLACED,
    TrainingReward,
    alignment_reward,
    errp_reward,
    evaluation_reward,
    task_reward,
)
from rlihf_lib.study import Study
from rlihf_lib.task.expert import expert_action
from rlihf_lib.task.exploiters import (
    EXPLOITERS,
    hold_in_the_air,
    hover,
    knock_things_off,
    oscillate,
    push_along_the_table,
    sit_still,
)
from rlihf_lib.task.gym_env import Moment, PickPlaceEnv
from rlihf_lib.task.path import IdealPath

PATH = IdealPath([-0.19, -0.15, 1.0], [-0.07, -0.2, 0.84], [-0.07, 0.2, 0.84])
QUIET = Moment(
    remaining=0.5, gained=0.02, best=0.52, deviation=0.0, clearance=0.1,
    collided=False, grasped=True, success=False, lost=False, dropped=False, tilt=0.0, nearer=0.02,
)  # fmt: skip
DISCOUNT, HORIZON = SACSettings().discount, 200


def moment(**changes):
    return dataclasses.replace(QUIET, **changes)


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


def test_progress_hardly_ever_falls_along_the_experts_way():
    env = PickPlaceEnv(HORIZON)
    for seed in (1, 2, 3):
        env.reset(seed=seed)
        lost, done = [0.0], False
        while not done:
            *_, terminated, truncated, info = env.step(expert_action(env))
            # Opening over the goal, the fingers let go of the can a moment before it stands.
            if env.remaining > 0.05:
                lost.append(-info["moment"].gained)
            done = terminated or truncated
        assert info["is_success"] and max(lost) < 0.004


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

    env.reset(seed=0)
    terminated = False
    while not terminated:
        _, placed, terminated, *_ = env.step(expert_action(task))
    assert placed == pytest.approx((1 + 0.7 * 0.75) / (1 - 0.96), rel=0.02)


def test_evaluation_reward_of_standing_still_is_zero_and_of_success_is_one():
    start = moment(remaining=PATH.start_remaining)
    assert evaluation_reward(start, PATH) == 0
    assert evaluation_reward(moment(success=True, remaining=0.0), PATH) == PLACED
    assert evaluation_reward(moment(collided=True), PATH) < evaluation_reward(moment(), PATH)


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({}, 0),
        ({"remaining": 0.52}, 1),  # no progress
        ({"remaining": 0.52 - 0.006}, 0.6),  # a fifth of the full speed
        ({"remaining": 0.5, "best": 0.45}, 1),  # making up for lost ground
        ({"clearance": 0.02}, 1),
        ({"clearance": 0.035}, 0.5),
        ({"clearance": 0.035, "remaining": 0.52 - 0.006}, 0.8),
        ({"clearance": 0.05}, 0),
        ({"collided": True}, 1),
        ({"lost": True}, 1),
        ({"success": True, "remaining": 0.0}, 0),
    ],
)
def test_observer_sees_standing_still_lost_ground_and_closeness_as_wrong(changes, wrong):
    assert path_observer(moment(**changes)) == pytest.approx(wrong)


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({}, 0),
        ({"remaining": 0.9, "best": 0.1, "deviation": 0.5}, 0),  # knows no ideal path
        ({"nearer": 0.0}, 1),
        ({"nearer": 0.006}, 0.6),
        ({"clearance": 0.035}, 0.5),
        ({"tilt": 0.6}, 1),
        ({"dropped": True}, 1),
        ({"collided": True}, 1),
        ({"lost": True}, 1),
        ({"success": True, "nearer": 0.0}, 0),
    ],
)
def test_lay_observer_sees_what_comes_nearer_tilts_drops_or_comes_too_close(changes, wrong):
    assert lay_observer(moment(**changes)) == pytest.approx(wrong)


def test_comfort_grows_from_2_to_5_centimetres():
    assert [comfort(c) for c in (0.0, 0.02, 0.035, 0.05, 0.15)] == pytest.approx([0, 0, 0.5, 1, 1])


def test_observer_answers_with_epochs_of_the_class_it_saw():
    table = pd.DataFrame(
        {"epoch": range(4), "label": [0, 0, 1, 1], "p_error": [0.1, 0.2, 0.8, 0.9]}
    )
    observer = Observer(table, np.random.default_rng(0))
    assert set(observer.watch(moment(), 30)) == {0.1, 0.2}
    assert set(observer.watch(moment(lost=True), 30)) == {0.8, 0.9}
    assert observer.errors_seen == 1


def test_observer_notices_slow_progress_as_often_as_the_rule_says():
    observer = Observer(perfect_table(), np.random.default_rng(0))
    seen = [observer.watch(moment(remaining=0.52 - 0.006))[0] for _ in range(2000)]
    assert np.mean(seen) == pytest.approx(0.6, abs=0.03)


def test_observer_needs_both_classes():
    table = pd.DataFrame({"epoch": [0], "label": [0], "p_error": [0.1]})
    with pytest.raises(ValueError, match="class 'error'"):
        Observer(table, np.random.default_rng(0))


@pytest.mark.parametrize("condition", ["sparse", "dense", "rlihf"])
def test_expert_earns_more_than_every_exploiter(condition):
    observer = Observer(perfect_table(), np.random.default_rng(0))
    env = TrainingReward(PickPlaceEnv(HORIZON), condition, DISCOUNT, w_hf=0.7, observer=observer)

    def returns(act):
        """From the start, where exploiters may be as good as the expert still, and on average."""
        episodes = []
        for seed in range(3):
            env.reset(seed=seed)
            rewards, terminated = [], False
            while not terminated and len(rewards) < HORIZON:
                _, reward, terminated, *_ = env.step(act(env.unwrapped))
                rewards.append(reward)
            episodes.append(discounted_returns(rewards, terminated, DISCOUNT, HORIZON))
        return np.mean(episodes, axis=0)[0], np.mean(episodes)

    start, average = returns(expert_action)
    others = {act.__name__: returns(act) for act in EXPLOITERS}
    assert start > 1.1 * max(other for other, _ in others.values()), (start, others)
    assert average > 1.5 * max(0, *(other for _, other in others.values())), (average, others)


@pytest.fixture(scope="module")
def played():
    return play(PickPlaceEnv(), range(3))


@pytest.mark.parametrize("rank", ["weakest", "median"])
@pytest.mark.parametrize("observer", OBSERVERS.values())
def test_expert_is_expected_to_earn_more_with_the_shipped_decoders(rank, observer, played):
    study = Study("quick")
    table = study.p_error()
    subject = study.ranked_subjects()[0] if rank == "weakest" else study.median_subject()
    rows = table[table["subject"] == subject]
    result = margin(expected_returns(played, observer, rows, 0.7, DISCOUNT), DISCOUNT)
    assert result["low"] > 0 and result["ratio from start"] > 1, result
    assert result["ratio on average"] > 1.5, result


def test_expected_feedback_is_what_the_observer_gives_on_average():
    rng = np.random.default_rng(0)
    table = pd.DataFrame({"epoch": range(60), "label": [0, 1] * 30, "p_error": rng.random(60)})
    slow = moment(remaining=0.52 - 0.006)
    mean, sd = expected_feedback([slow], path_observer, table)
    observer = Observer(table, rng)
    drawn = [1 - observer.watch(slow)[0] for _ in range(5000)]
    assert mean[0] == pytest.approx(np.mean(drawn), abs=0.015)
    assert sd[0] == pytest.approx(np.std(drawn), abs=0.015)


def test_dense_reward_explains_all_but_comfort_and_lay_persons_less():
    env = PickPlaceEnv(HORIZON)
    seen = [m for seed in range(3) for m in watch(env, expert_action, seed)[0][:-1]]
    far, near = (
        [dataclasses.replace(m, clearance=c) for m, c in zip(seen, cycle(clearances), strict=False)]
        for clearances in ([0.15], [0.15, 0.02])
    )
    assert explained_by_dense(far, path_observer) == pytest.approx(1)
    assert explained_by_dense(near, path_observer) < 0.5
    assert explained_by_dense(far, lay_observer) < 0.5


# One who goes the right way and stops there is efficient and near the path, but has no success.
@pytest.mark.parametrize(
    ("act", "efficiency", "deviation"),
    [
        (hover, 0.86, 0.0),
        (oscillate, 0.02, 0.0),
        (hold_in_the_air, 1.0, 0.0),
        (push_along_the_table, 0.03, 0.14),
        (sit_still, 0.0, 0.0),
        (knock_things_off, 0.0, 0.18),
    ],
)
def test_metrics_of_the_exploiters(act, efficiency, deviation):
    env, metrics = PickPlaceEnv(HORIZON), []
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(HORIZON):
            *_, info = env.step(act(env))
        metrics.append(info["metrics"])
    assert [m["success"] for m in metrics] == [0, 0, 0]
    assert np.mean([m["path_efficiency"] for m in metrics]) == pytest.approx(efficiency, abs=0.05)
    assert np.mean([m["path_deviation"] for m in metrics]) == pytest.approx(deviation, abs=0.03)


@pytest.mark.parametrize(("observer", "share"), [(path_observer, 0.1), (lay_observer, 0.25)])
def test_expert_mostly_looks_right(observer, share):
    env, wrong = PickPlaceEnv(HORIZON, RunConfig.patience), []
    for seed in range(25):
        env.reset(seed=seed)
        done = False
        while not done:
            *_, terminated, truncated, info = env.step(expert_action(env))
            wrong.append(observer(info["moment"]))
            done = terminated or truncated
    assert np.mean(wrong) < share
