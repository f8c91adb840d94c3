"""A weight that changes counts for all that is remembered, not only for what is new."""

import json

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.rl.feedback import p_error_sha256, perfect_table
from rlihf_lib.rl.observer import Observer
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.rl.runs import RunConfig, SACSettings
from rlihf_lib.rl.schedules import DOUBTFUL, LEAST, RENEWED, SCHEDULES, ScheduledReward
from rlihf_lib.rl.training import train_run
from rlihf_lib.task.gym_env import PickPlaceEnv

STEPS = RENEWED + 10


def rewards(schedule=None, doubt=None, observer=None):
    """Reward of each random step, once all is known, and what the run says of its weight."""
    observer = observer or Observer(perfect_table(), np.random.default_rng(0))
    told = PickPlaceEnv(2_000, 2_000), "rlihf", 0.9, 0.7, observer
    env = TrainingReward(*told, total_steps=2 * RENEWED)
    if schedule:
        env = ScheduledReward(*told, schedule=schedule)
        env._total_steps = 2 * RENEWED
        env.doubt = doubt or env.doubt
    env.reset(seed=0)
    actions, paid = np.random.default_rng(1).uniform(-0.3, 0.3, (STEPS, 4)), np.zeros(STEPS)
    for step, action in enumerate(actions):
        _, paid[step], terminated, _, info = env.step(action)
        assert not terminated
        for ago, change in zip(*info.get("late", ((), ())), strict=True):
            paid[step - ago] += change
    return paid, env.notes()


@pytest.mark.parametrize("schedule", ["fading", "growing"])
def test_feedback_of_long_ago_is_worth_what_it_is_now(schedule):
    whole, says = rewards()
    assert says == {}
    begins, counts, ends = (SCHEDULES[schedule](share, 1.0, 1.0) for share in (0, 0.5, 1))
    assert (begins, ends) == pytest.approx((1, LEAST) if schedule == "fading" else (LEAST, 1))
    feedback = np.isin(whole, [0, 0.7])  # others collide, too
    assert feedback.mean() > 0.5
    paid, says = rewards(schedule)
    np.testing.assert_allclose(paid[feedback], counts * whole[feedback], atol=1e-12)
    assert says == {"weight_shares": pytest.approx([begins, counts], abs=1e-4)}


@pytest.mark.parametrize(("distance", "share"), [(0.4, 0.4), (3.0, 1.0), (0.0, LEAST)])
def test_a_weight_by_doubt_is_as_large_as_critics_are_apart(distance, share):
    told = []

    def doubt(observations, actions):
        told.append((len(observations), len(actions)))
        return distance * DOUBTFUL

    _, says = rewards("doubt", doubt)
    assert told == [(RENEWED, RENEWED)], "about all steps since the last change"
    assert says["weight_shares"] == pytest.approx([1.0, share], abs=1e-4)


def test_a_weight_by_spread_falls_when_answers_come_closer_together(monkeypatch):
    monkeypatch.setattr("rlihf_lib.rl.schedules.RENEWED", 500)
    told = [(0, 0.1), (1, 0.9), *3 * [(0, 0.4), (1, 0.6)]]  # a part is 500 steps, of 2,000
    table = pd.DataFrame(told, columns=["label", "p_error"]).assign(epoch=range(8))
    either = Observer(table, np.random.default_rng(0), lambda moment: 0.5, parts=4)
    paid, says = rewards("spread", observer=either)
    begins, first, second = says["weight_shares"]
    assert begins == first == 1 and second == pytest.approx(0.25, abs=0.01)
    quiet = paid[(paid > 0) & (paid < 0.7)]  # of steps without collision
    known = {0.07, 0.63, 0.28, 0.42, *(0.35 + second * (0.7 * p - 0.35) for p in (0.4, 0.6))}
    assert {round(x, 3) for x in quiet} == {round(x, 3) for x in known}, "each as of its time"


def test_a_run_whose_weight_changes_is_another_run(monkeypatch):
    table = perfect_table().assign(subject="ideal")
    told = {"subject": "ideal", "w_hf": 0.7, "p_error_sha256": p_error_sha256(table, "ideal")}
    sizes = {"total_steps": 300, "eval_every": 150, "horizon": 60, "eval_rollouts": 1}
    sac = SACSettings(learning_starts=200, batch_size=64)
    config = RunConfig("rlihf", 0, **sizes, **told, sac=sac, schedule="growing")
    plain = RunConfig("rlihf", 0, **sizes, **told, sac=sac)
    assert "schedulegrowing" in config.run_id and config.hash != plain.hash
    assert train_run(config, table)["train.csv"] != train_run(plain, table)["train.csv"]
    monkeypatch.setattr("rlihf_lib.rl.schedules.RENEWED", 250)
    doubting = RunConfig("rlihf", 0, **sizes, **told, sac=sac, schedule="doubt")
    begins, share = json.loads(train_run(doubting, table)["provenance.json"])["weight_shares"]
    assert begins == 1 and LEAST < share < 1, "as the learner's own critics are apart"
    with pytest.raises(ValueError, match="schedule is 'rising'; choose one of constant, fading"):
        RunConfig("rlihf", 0, **sizes, **told, schedule="rising")
