"""Answers that are rare and late find the steps they belong to."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.rl.feedback import p_error_sha256, perfect_table
from rlihf_lib.rl.observer import Observer
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.rl.runs import RunConfig, SACSettings
from rlihf_lib.rl.timing import LateReward, Timing
from rlihf_lib.rl.training import train_run
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.scripted import expert_action

W, STEPS = 0.7, 44  # until the can is placed


def certain(moment):
    """Wrong or right beyond doubt, so that nothing is drawn."""
    return float(moment.remaining > 0.6)


def rewards(timing=None, steps=STEPS, resets=()):
    """Reward of each step of the expert, once all answers have come, by an ideal decoder."""
    observer = Observer(perfect_table(), np.random.default_rng(0), certain)
    told = PickPlaceEnv(), "rlihf", 0.9, W, observer
    env = LateReward(*told, timing=timing, rng=np.random.default_rng(1)) if timing else None
    env = env or TrainingReward(*told)
    env.reset(seed=0)
    paid = np.zeros(steps)
    for step in range(steps):
        if step in resets:
            env.reset(seed=0)
        _, reward, *_, info = env.step(expert_action(env.unwrapped))
        paid[step] = reward
        for ago, change in zip(*info.get("late", ((), ())), strict=True):
            paid[step - ago] += change
    return paid


def test_written_back_answers_to_every_step_are_those_given_at_once():
    delay = 8
    late = rewards(Timing(delay=delay))
    np.testing.assert_allclose(late[:-delay], rewards()[:-delay], atol=1e-12)
    jittered = rewards(Timing(delay=2, jitter=6))
    np.testing.assert_allclose(jittered[:-delay], rewards()[:-delay], atol=1e-12)
    naive = rewards(Timing(delay=delay, credit="arrival"))
    np.testing.assert_allclose(naive[delay:], rewards()[:-delay], atol=1e-12)


@pytest.mark.parametrize("credit", ["arrival", "event", "window", "kernel", "held"])
def test_in_the_long_run_all_ways_pay_what_answers_at_once_pay(credit):
    timing = Timing(interval=4, delay=3, credit=credit)
    assert rewards(timing).sum() == pytest.approx(rewards().sum(), rel=0.2)


def test_an_answer_is_credited_to_the_steps_that_its_way_names():
    timing = {"interval": 10, "delay": 8}
    event = rewards(Timing(**timing, credit="event"))
    window = rewards(Timing(**timing, credit="window"))
    at_once = rewards()
    wrong_until = int(np.flatnonzero(at_once > 0)[0])  # from here on everything is right
    events = np.arange(0, STEPS - 8, 10)
    for step in events[1:]:
        right = step >= wrong_until
        np.testing.assert_allclose(window[step - 9 : step + 1], W * right, atol=1e-12)
        assert (event[step] > W) == right and (event[step] < 0) == (not right)


def test_no_answer_is_credited_to_another_episode():
    reset = 25
    timing = Timing(interval=10, delay=2, credit="window")
    np.testing.assert_allclose(
        rewards(timing, resets=[reset])[reset : reset + 6],
        rewards(timing, resets=[reset], steps=STEPS - 3)[reset : reset + 6],
    )


def test_a_window_reaches_up_to_an_end_that_comes_in_place_of_the_next_event():
    timing = Timing(interval=STEPS, credit="window")
    at_once, window = rewards(steps=STEPS + 1), rewards(timing, STEPS + 1)
    assert at_once[-2] == pytest.approx(W) and at_once[-1] == window[-1] > 10 * W, "placed"
    np.testing.assert_allclose(window[:-1], 0, atol=1e-12)  # as was seen in the first step


@pytest.mark.parametrize("reset", [35, 38, 39])
def test_windows_leave_out_no_step_of_an_episode(reset):
    timing = Timing(interval=10, delay=8, credit="window")
    paid, at_once = (rewards(t, steps=60, resets=[reset]) for t in (timing, None))
    assert (at_once[30], at_once[40]) == pytest.approx((W, 0))
    np.testing.assert_allclose(paid[30:reset], W, atol=1e-12)  # the event at 30 was the last one
    np.testing.assert_allclose(paid[reset:41], 0, atol=1e-12)  # of the next, as at 40


@pytest.mark.parametrize("jitter", [0, 40])
def test_a_kernel_credits_the_steps_of_the_events_episode_only(jitter):
    timing = Timing(interval=10, delay=8, jitter=jitter, credit="kernel")
    observer = Observer(perfect_table(), np.random.default_rng(0), certain)
    told = PickPlaceEnv(), "rlihf", 0.9, W, observer
    env = LateReward(*told, timing=timing, rng=np.random.default_rng(1))
    first = np.zeros(80, int)  # step of the episode that each step is of
    for step in range(80):
        if step % 16 == 0:
            env.reset(seed=0)
        first[step] = step - step % 16
        *_, info = env.step(expert_action(env.unwrapped))
        if "late" in info:
            credited = step - info["late"][0]
            events = [e for e in range(0, step + 1, 10) if step - 8 - jitter <= e <= step - 8]
            assert set(first[credited]) <= {first[e] for e in events}


def test_impossible_timings_are_refused():
    with pytest.raises(ValueError, match="credit is 'never'; choose one of arrival, held"):
        Timing(credit="never")
    with pytest.raises(ValueError, match="interval is 1 or more"):
        Timing(interval=0)


def test_a_run_with_late_answers_is_another_run_and_repeats():
    table = perfect_table().assign(subject="ideal")
    told = {"subject": "ideal", "w_hf": W, "p_error_sha256": p_error_sha256(table, "ideal")}
    sizes = {"total_steps": 300, "eval_every": 150, "horizon": 60, "eval_rollouts": 1}
    sac = SACSettings(learning_starts=200, batch_size=64)
    config = RunConfig("rlihf", 0, **sizes, **told, sac=sac, timing=Timing(10, 8))
    plain = RunConfig("rlihf", 0, **sizes, **told, sac=sac)
    assert config.hash != plain.hash and "interval10-delay8-seed0" in config.run_id
    assert RunConfig("rlihf", 0, **sizes, **told, sac=sac, timing=Timing()).hash == plain.hash
    first, second = train_run(config, table), train_run(config, table)
    for name in ("train.csv", "eval.csv", "actor.safetensors"):
        assert first[name] == second[name], name
    assert first["actor.safetensors"] != train_run(plain, table)["actor.safetensors"]
    assert pd.read_csv(pd.io.common.BytesIO(first["eval.csv"])).shape[0] == 3
