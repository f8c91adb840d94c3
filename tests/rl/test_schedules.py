"""A weight that changes counts for all that is remembered, not only for what is new."""

import numpy as np
import pytest

from rlihf_lib.rl.feedback import p_error_sha256, perfect_table
from rlihf_lib.rl.observer import Observer
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.rl.runs import RunConfig, SACSettings
from rlihf_lib.rl.schedules import LEAST, RENEWED, SCHEDULES, ScheduledReward
from rlihf_lib.rl.training import train_run
from rlihf_lib.task.gym_env import PickPlaceEnv

STEPS = RENEWED + 10


def rewards(schedule=None):
    """Reward of each random step, once all is known."""
    rng = np.random.default_rng(0)
    observer = Observer(perfect_table(), rng)
    told = PickPlaceEnv(2_000, 2_000), "rlihf", 0.9, 0.7, observer
    env = TrainingReward(*told, total_steps=2 * RENEWED)
    if schedule:
        env = ScheduledReward(*told, schedule=schedule)
        env._total_steps = 2 * RENEWED
    env.reset(seed=0)
    actions, paid = np.random.default_rng(1).uniform(-0.3, 0.3, (STEPS, 4)), np.zeros(STEPS)
    for step, action in enumerate(actions):
        _, paid[step], terminated, _, info = env.step(action)
        assert not terminated
        for ago, change in zip(*info.get("late", ((), ())), strict=True):
            paid[step - ago] += change
    return paid


@pytest.mark.parametrize("schedule", ["fading", "growing"])
def test_feedback_of_long_ago_is_worth_what_it_is_now(schedule):
    whole = rewards()
    counts = SCHEDULES[schedule](0.5)
    assert (SCHEDULES[schedule](0), SCHEDULES[schedule](1)) == pytest.approx(
        (1, LEAST) if schedule == "fading" else (LEAST, 1)
    )
    feedback = np.isin(whole, [0, 0.7])  # others collide, too
    assert feedback.mean() > 0.5
    np.testing.assert_allclose(rewards(schedule)[feedback], counts * whole[feedback], atol=1e-12)


def test_a_run_whose_weight_changes_is_another_run():
    table = perfect_table().assign(subject="ideal")
    told = {"subject": "ideal", "w_hf": 0.7, "p_error_sha256": p_error_sha256(table, "ideal")}
    sizes = {"total_steps": 300, "eval_every": 150, "horizon": 60, "eval_rollouts": 1}
    sac = SACSettings(learning_starts=200, batch_size=64)
    config = RunConfig("rlihf", 0, **sizes, **told, sac=sac, schedule="growing")
    plain = RunConfig("rlihf", 0, **sizes, **told, sac=sac)
    assert "schedulegrowing" in config.run_id and config.hash != plain.hash
    assert train_run(config, table)["train.csv"] != train_run(plain, table)["train.csv"]
    with pytest.raises(ValueError, match="schedule is 'rising'; choose one of constant, fading"):
        RunConfig("rlihf", 0, **sizes, **told, schedule="rising")
