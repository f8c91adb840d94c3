"""Few answers: they are spent as said, and what is learnt from them pays for all other steps."""

import numpy as np
import pytest

from rlihf_lib.rl.asking import REFIT, Asking, AskingReward
from rlihf_lib.rl.feedback import p_error_sha256, perfect_table, synthetic_table
from rlihf_lib.rl.observer import Observer
from rlihf_lib.rl.reward_model import RewardModel
from rlihf_lib.rl.rewards import alignment_reward, errp_reward
from rlihf_lib.rl.runs import RunConfig, SACSettings
from rlihf_lib.rl.timing import Timing
from rlihf_lib.rl.training import train_run
from rlihf_lib.task.gym_env import PickPlaceEnv
from tests.rl.conftest import moment

W = 0.7


class Upwards(PickPlaceEnv):
    """Whose every step is right if the hand is told to go up, and wrong if down."""

    def __init__(self, workspace):
        super().__init__(1_000, 1_000, workspace)

    def step(self, action):
        self.observation = self._observe()  # without moving: nothing is simulated
        told = {"moment": moment(remaining=0.5, best=0.55 if action[2] > 0 else 0.5)}
        return self.observation, 0.0, False, False, told


@pytest.fixture(scope="module")
def workspace():
    return PickPlaceEnv().workspace


def played(workspace, asking, steps, table=None):
    """The wrapper, what was done, and the reward of each step once all is known."""
    rng = np.random.default_rng(0)
    rows = perfect_table() if table is None else table
    observer = Observer(rows, rng, once=asking.once)
    told = Upwards(workspace), "rlihf", 0.9, W, observer, alignment_reward, errp_reward, steps
    env = AskingReward(*told, asking=asking, rng=rng)
    env.reset(seed=0)
    actions, paid = rng.uniform(-1, 1, (steps, 4)), np.zeros(steps)
    for now, action in enumerate(actions):
        _, paid[now], *_, info = env.step(action)
        for ago, change in zip(*info.get("late", ((), ())), strict=True):
            paid[now - ago] += change
    return env, actions, paid


def test_the_budget_is_spent_evenly_over_training(workspace):
    env, *_ = played(workspace, Asking(budget=60), 1_200)
    assert 45 <= len(env._asked) <= 60
    assert np.histogram(env._asked, 4, (0, 1_200))[0].min() >= 8
    env, *_ = played(workspace, Asking(budget=1_000), 1_200)
    assert len(env._asked) == 1_000 and env._asked[-1] < 1_199, "then nothing is asked"


def test_doubt_spends_a_small_budget_evenly_too(workspace):
    asking = Asking(budget=30, when="unsure", model=True)
    env, *_ = played(workspace, asking, 4 * REFIT, synthetic_table(1.5, 0.35))
    assert np.histogram(env._asked, 2, (0, 4 * REFIT))[0].min() >= 7


def test_an_epoch_answers_once_and_then_never_again(workspace):
    table = synthetic_table(1.5, 0.35, n=50)
    table = table.drop(index=range(10))  # of the correct ones
    env, *_ = played(workspace, Asking(once=True, model=True), 400, table)
    assert env.budget == 40, "as many as there are of the rarer class"
    assert 30 <= len(env._asked) <= 40
    assert np.histogram(env._asked, 2, (0, 400))[0].min() >= 10, "not only at the beginning"
    answers, rows = 1 - np.array(env._answers), table["p_error"].to_numpy()
    counts = [np.isclose(answers, p).sum() <= np.isclose(rows, p).sum() for p in rows]
    assert all(counts), "no epoch has answered twice"


def test_without_a_model_only_asked_steps_know_better_than_the_mean(workspace):
    env, actions, paid = played(workspace, Asking(budget=800), 3_200)
    asked, right = np.isin(np.arange(3_200), env._asked), actions[:, 2] > 0
    assert ((paid[asked] > W / 2) == right[asked]).all()
    assert np.ptp(paid[~asked][-300:]) < 0.05
    assert env.notes() == {"asked": len(env._asked)}
    contrast = paid[right].mean() - paid[~right].mean()
    assert contrast == pytest.approx(W, rel=0.15), "as large as if every step were asked about"


@pytest.mark.parametrize("when", ["spread", "unsure"])
def test_a_model_of_few_noisy_answers_pays_for_all_steps(workspace, when):
    asking = Asking(budget=500, when=when, model=True)
    env, actions, paid = played(workspace, asking, 3 * REFIT + 1, synthetic_table(1.5, 0.35))
    right = actions[:, 2] > 0
    assert (paid[right] > np.median(paid)).mean() > 0.9
    assert (paid[~right] < np.median(paid)).mean() > 0.9
    late = slice(2 * len(paid) // 3, None)
    says = env.notes()
    r = np.corrcoef(paid[late], right[late])[0, 1]
    assert says["model_r"] == pytest.approx(r, abs=0.02) and r > 0.7
    apart = paid[late][right[late]].mean() - paid[late][~right[late]].mean()
    assert W * says["model_contrast"] == pytest.approx(apart, abs=0.02)


def test_a_model_doubts_what_it_has_not_seen():
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(600, 6)).astype(np.float32)
    seen, right = inputs[:, 0] > 0, inputs[:, 5] > 0
    model = RewardModel(6, seed=0)
    for _ in range(5):
        model.fit(inputs[seen], right[seen] * 1.0)
    known, doubt = model.predict(inputs)
    assert np.corrcoef(known[seen], right[seen])[0, 1] > 0.8
    assert doubt[~seen].mean() > 1.5 * doubt[seen].mean()


def test_a_model_of_hardly_any_answers_pays_their_mean():
    inputs = np.random.default_rng(0).normal(size=(600, 42)).astype(np.float32)
    model = RewardModel(42, seed=0)
    model.fit(inputs[:3], np.array([0.2, 0.6, 0.7]))
    known, doubt = model.predict(inputs)
    assert abs(known.mean() - 0.5) < 0.03 and known.std() < 0.03, "not what they said untaught"
    assert doubt.min() > 0 and len(np.unique(doubt)) > 500, "and yet some are more doubtful"


def test_impossible_ways_of_asking_are_refused():
    with pytest.raises(ValueError, match="when is one of spread, unsure"):
        Asking(when="never")
    for few in ({"when": "unsure"}, {"once": True}):
        with pytest.raises(ValueError, match="to ask once, or where it is unsure, takes a model"):
            Asking(**few)
    with pytest.raises(ValueError, match="budget is 0"):
        Asking(budget=-1)
    with pytest.raises(ValueError, match="not two at once"):
        RunConfig("dense", 0, 100, 50, asking=Asking(budget=5), timing=Timing(3))


def test_a_run_with_few_answers_is_another_run_and_repeats():
    table = perfect_table().assign(subject="ideal")
    told = {"subject": "ideal", "w_hf": W, "p_error_sha256": p_error_sha256(table, "ideal")}
    sizes = {"total_steps": 1_100, "eval_every": 550, "horizon": 60, "eval_rollouts": 1}
    sac = SACSettings(learning_starts=900, batch_size=64)
    asking = Asking(budget=300, when="unsure", model=True)
    config = RunConfig("rlihf", 0, **sizes, **told, sac=sac, asking=asking)
    plain = RunConfig("rlihf", 0, **sizes, **told, sac=sac)
    assert config.hash != plain.hash and "budget300-whenunsure-model1-seed0" in config.run_id
    first, second = train_run(config, table), train_run(config, table)
    assert first["actor.safetensors"] == second["actor.safetensors"]
    assert first["actor.safetensors"] != train_run(plain, table)["actor.safetensors"]
