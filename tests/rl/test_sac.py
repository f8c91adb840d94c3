"""The written-out update against Stable-Baselines3's own, which uses autograd."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from gymnasium import Env, spaces
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import NStepReplayBuffer
from stable_baselines3.sac import policies
from stable_baselines3.sac.policies import SACPolicy

from rlihf_lib.rl.runs import SACSettings
from rlihf_lib.rl.sac import FastSAC, make_sac, networks, passes
from rlihf_lib.rl.sac.batch import Batch
from rlihf_lib.rl.sac.networks import StackedPolicy


class Noise(Env):
    """Random observations, rewards and ends of episodes, to fill a replay buffer."""

    observation_space = spaces.Box(-np.inf, np.inf, (5,), np.float32)
    action_space = spaces.Box(-1, 1, (2,), np.float32)

    def __init__(self):
        self.rng = np.random.default_rng(0)

    def reset(self, seed=None, options=None):
        return self.rng.normal(size=5).astype(np.float32), {}

    def step(self, action):
        observation = self.rng.normal(size=5).astype(np.float32)
        terminated, truncated = (bool(end) for end in self.rng.random(2) < 0.1)
        return observation, float(self.rng.random()), terminated, truncated, {}


# Without the noise on the critics' inputs, which SB3's SAC does not know.
SMALL = SACSettings(hidden=(16, 24), learning_starts=80, batch_size=32, critic_noise=(0.0, 0.0))


def settings(**changes):
    return replace(SMALL, **changes)


def stock(fast, settings):
    """SB3's learner with the networks and the experience of a `FastSAC`."""
    model = SAC(
        StackedPolicy, Noise(), learning_rate=settings.learning_rate, tau=settings.tau,
        gamma=settings.discount, n_steps=settings.n_steps, seed=0, device="cpu",
        target_entropy=settings.target_entropy, policy_kwargs={"net_arch": list(settings.hidden)},
    )  # fmt: skip
    model.policy.load_state_dict(fast.policy.state_dict())
    model.learn(0)
    model.replay_buffer = fast.replay_buffer
    return model


def update(model, times, batch_size=32):
    np.random.seed(4)  # noqa: NPY002 (SB3 draws batches from numpy's global state)
    torch.manual_seed(4)
    model.train(times, batch_size)


def assert_same(model, other, **tolerance):
    """Compare actor, critics, targets and the entropy coefficient."""
    parameters = dict(other.policy.named_parameters())
    assert {name.split(".")[0] for name in parameters} == {"actor", "critic", "critic_target"}
    for name, values in model.policy.named_parameters():
        torch.testing.assert_close(values, parameters[name], msg=name, **tolerance)
    torch.testing.assert_close(model.log_ent_coef, other.log_ent_coef, **tolerance)


# Adam's first steps hardly depend on the size of a gradient. With a large epsilon they are
# proportional to it, so that wrong factors show.
@pytest.mark.parametrize(("rate", "epsilon"), [(7e-4, 1e-8), (0.1, 1.0)])
@pytest.mark.parametrize("n_steps", [1, 3])
def test_update_equals_that_of_stable_baselines3(n_steps, rate, epsilon, monkeypatch):
    """The same batches and noise give the same weights, up to rounding, as autograd does."""
    # The limits of log_std, drawn in so far that it falls below, between and above them.
    for module in (passes, policies):
        monkeypatch.setattr(module, "LOG_STD_MIN", -0.1)
        monkeypatch.setattr(module, "LOG_STD_MAX", 0.1)
    chosen = settings(n_steps=n_steps, learning_rate=rate)
    fast = make_sac(Noise(), chosen, seed=0)
    fast.learn(80)
    reference = stock(fast, chosen)
    for model in (fast, reference):
        for part in (model.actor.optimizer, model.critic.optimizer, model.ent_coef_optimizer):
            part.param_groups[0]["eps"] = epsilon
        update(model, 5)
    assert_same(fast, reference, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("deterministic", [False, True])
def test_actions_equal_those_of_stable_baselines3(deterministic, monkeypatch):
    """Weights large enough that log_std falls below, between and above its limits."""
    for module in (networks, policies):
        monkeypatch.setattr(module, "LOG_STD_MIN", -1.0)
        monkeypatch.setattr(module, "LOG_STD_MAX", 1.0)
    policy = make_sac(Noise(), settings(), seed=0).policy
    torch.nn.init.normal_(policy.actor.log_std.weight)
    observations = 3 * torch.randn(500, 5)
    actions = []
    for predict in (policy._predict, partial(SACPolicy._predict, policy)):
        torch.manual_seed(4)
        with torch.no_grad():
            actions.append(predict(observations, deterministic))
    assert torch.equal(*actions)


def test_batch_size_may_change():
    chosen = settings()
    fast = make_sac(Noise(), chosen, seed=0)
    fast.learn(80)
    reference = stock(fast, chosen)
    for model in (fast, reference):
        for batch_size in (32, 47, 32):
            update(model, 1, batch_size)
    assert_same(fast, reference, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("steps", [30, 50, 71])  # partly full, just full, overwritten
def test_batch_holds_what_stable_baselines3_samples(steps):
    env = Noise()
    buffer = NStepReplayBuffer(50, env.observation_space, env.action_space, n_steps=3, gamma=0.9)
    observation, _ = env.reset()
    for _ in range(steps):
        action = env.rng.random(2)
        following, reward, terminated, truncated, _ = env.step(action)
        info = {"TimeLimit.truncated": truncated and not terminated}
        buffer.add(observation, following, action, reward, terminated or truncated, [info])
        observation = following
    batch = Batch(make_sac(env, settings(), seed=0).policy, 500, noise=(0.0, 0.0))
    np.random.seed(1)  # noqa: NPY002
    expected = buffer.sample(500)
    np.random.seed(1)  # noqa: NPY002
    batch.draw(buffer, n_steps=3, gamma=0.9)
    torch.testing.assert_close(batch.taken[:, :5], expected.observations, rtol=0, atol=0)
    torch.testing.assert_close(batch.now[:, :5], expected.observations, rtol=0, atol=0)
    torch.testing.assert_close(batch.taken[:, 5:], expected.actions, rtol=0, atol=0)
    torch.testing.assert_close(batch.later[:, :5], expected.next_observations, rtol=0, atol=0)
    np.testing.assert_allclose(batch.returns, expected.rewards[:, 0], rtol=1e-6)
    discounts = (1 - expected.dones) * expected.discounts
    np.testing.assert_allclose(batch.discounts, discounts[:, 0], rtol=1e-6)


def test_critics_are_fitted_to_noisy_inputs_and_asked_about_clean_ones():
    model = make_sac(Noise(), settings(learning_starts=300), seed=0)
    model.learn(200)
    plain, noisy = (Batch(model.policy, 5000, noise) for noise in ((0.0, 0.0), (0.1, 0.4)))
    for batch in (plain, noisy):
        np.random.seed(2)  # noqa: NPY002
        batch.draw(model.replay_buffer, n_steps=3, gamma=0.9)
    torch.testing.assert_close(noisy.states, plain.states, rtol=0, atol=0)
    np.testing.assert_array_equal(noisy.returns, plain.returns)
    added = noisy.taken - plain.taken
    expected = torch.tensor([0.1] * 5 + [0.4] * 2)
    torch.testing.assert_close(added.std(dim=0), expected, rtol=0.05, atol=0)
    assert added.mean(dim=0).abs().max() < 0.02


def test_saved_learner_goes_on_as_it_would_have(tmp_path):
    model = make_sac(Noise(), settings(critic_noise=(0.1, 0.2)), seed=0)
    model.learn(90)
    model.save(tmp_path / "model")
    loaded = FastSAC.load(tmp_path / "model", env=Noise())
    observation = np.ones(5, np.float32)
    before = model.predict(observation, deterministic=True)[0]
    np.testing.assert_array_equal(loaded.predict(observation, deterministic=True)[0], before)
    loaded.replay_buffer = model.replay_buffer
    for learner in (model, loaded):
        update(learner, 3)
    assert_same(model, loaded, rtol=0, atol=0)
    assert (model.predict(observation, deterministic=True)[0] != before).all()
