"""The scripted expert earns more than scripted exploiters, and what rewards say of them."""

import dataclasses
from itertools import cycle

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.rl.evaluation import evaluate, rollout, watch
from rlihf_lib.rl.feedback import perfect_table
from rlihf_lib.rl.incentives import (
    HORIZON,
    discounted_returns,
    expected_feedback,
    expected_returns,
    explained_by_dense,
    margin,
    play,
)
from rlihf_lib.rl.observer import OBSERVERS, Observer, lay_observer, path_observer
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.rl.runs import SACSettings
from rlihf_lib.study import Study
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.scripted import (
    EXPLOITERS,
    expert_action,
    hold_in_the_air,
    hover,
    knock_things_off,
    oscillate,
    push_along_the_table,
    sit_still,
)
from tests.rl.conftest import moment

DISCOUNT = SACSettings().discount


@pytest.mark.parametrize("condition", ["sparse", "dense", "rlihf"])
def test_expert_earns_more_than_every_exploiter(condition):
    observer = Observer(perfect_table(), np.random.default_rng(0))
    env = TrainingReward(PickPlaceEnv(HORIZON), condition, DISCOUNT, w_hf=0.7, observer=observer)

    def returns(act):
        """From the start, where exploiters may be as good as the expert still, and on average."""
        episodes = []
        for seed in range(3):
            _, rewards, terminated, *_ = zip(*rollout(env, act, seed), strict=True)
            episodes.append(discounted_returns(rewards, terminated[-1], DISCOUNT))
        return np.mean(episodes, axis=0)[0], np.mean(episodes)

    start, average = returns(expert_action)
    others = {act.__name__: returns(act) for act in EXPLOITERS}
    assert start > 1.1 * max(other for other, _ in others.values()), (start, others)
    assert average > 1.5 * max(0, *(other for _, other in others.values())), (average, others)


def test_progress_hardly_ever_falls_along_the_experts_way():
    env = PickPlaceEnv(HORIZON)
    for seed in (1, 2, 3):
        moments, _ = watch(env, expert_action, seed, HORIZON)
        # Opening over the goal, the fingers let go of the can a moment before it stands.
        lost = [-moment.gained for moment in moments if moment.remaining > 0.05]
        assert moments[-1].success and max(lost) < 0.004


@pytest.fixture(scope="module")
def played():
    return play(PickPlaceEnv(), range(3))


@pytest.mark.parametrize("rank", ["weakest", "median"])
@pytest.mark.parametrize("observer", OBSERVERS.values())
def test_expert_is_expected_to_earn_more_with_the_shipped_decoders(rank, observer, played):
    study = Study()
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
    seen = [m for seed in range(3) for m in watch(env, expert_action, seed, HORIZON)[0][:-1]]
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
    metrics = pd.DataFrame(evaluate(PickPlaceEnv(HORIZON), act, range(3)))
    assert metrics["success"].tolist() == [0, 0, 0]
    assert metrics["path_efficiency"].mean() == pytest.approx(efficiency, abs=0.05)
    assert metrics["path_deviation"].mean() == pytest.approx(deviation, abs=0.03)
