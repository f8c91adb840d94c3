"""Soft Actor-Critic: Stable-Baselines3's, with critics and updates computed together.

The algorithm and its interface are `stable_baselines3.SAC` (Haarnoja et al. 2018). Two things
differ. The critics' weights are stacked, so that one batched product serves both, and their
hidden layers are normalised (`LayerNorm`), which keeps values from running away under noisy rewards
(Ball et al. 2023, RLPD). And one update is written out without the bookkeeping that takes half the
time for networks this small.
"""

import math
from itertools import pairwise

import torch
import torch.nn.functional as F
from stable_baselines3 import SAC
from stable_baselines3.common.logger import Logger
from stable_baselines3.sac.policies import SACPolicy
from torch import nn


class StackedCritic(nn.Module):
    """`n_critics` Q-functions evaluated by one batched product per layer.

    Parameters
    ----------
    in_features : int
        Entries of observation and action together.
    hidden : sequence of int
        Units per hidden layer.
    n_critics : int
    """

    def __init__(self, in_features, hidden, n_critics):
        super().__init__()
        sizes = [in_features, *hidden, 1]
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for n_in, n_out in pairwise(sizes):
            bound = 1 / math.sqrt(n_in)  # torch.nn.Linear's initialisation
            self.weights.append(torch.empty(n_critics, n_in, n_out).uniform_(-bound, bound))
            self.biases.append(torch.empty(n_critics, 1, n_out).uniform_(-bound, bound))

    def values(self, observation, action):
        """Q-values, shape (n_critics, batch, 1)."""
        x = torch.cat((observation, action), dim=1)
        x = x.expand(self.weights[0].shape[0], *x.shape)
        last = len(self.weights) - 1
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.baddbmm(bias, x, weight)
            if i < last:
                x = F.relu(F.layer_norm(x, x.shape[-1:]))
        return x

    def forward(self, observation, action):
        """Q-values as Stable-Baselines3 expects them: a tuple of (batch, 1) tensors."""
        return tuple(self.values(observation, action))

    def set_training_mode(self, mode):
        """Part of Stable-Baselines3's interface."""
        self.train(mode)


class StackedPolicy(SACPolicy):
    """SB3's policy with a `StackedCritic`."""

    def make_critic(self, features_extractor=None):
        """Build one set of critics."""
        n_in = self.observation_space.shape[0] + self.action_space.shape[0]
        critic = StackedCritic(
            n_in, self.critic_kwargs["net_arch"], self.critic_kwargs["n_critics"]
        )
        return critic.to(self.device)


class FastSAC(SAC):
    """Stable-Baselines3's SAC with `train` written out for a `StackedPolicy`."""

    def train(self, gradient_steps, batch_size=64):
        """Update critics, actor and entropy coefficient `gradient_steps` times (Haarnoja 2018)."""
        policy, buffer = self.policy, self.replay_buffer
        critic_parameters = list(self.critic.parameters())
        target_parameters = list(self.critic_target.parameters())
        for _ in range(gradient_steps):
            batch = buffer.sample(batch_size, env=self._vec_normalize_env)
            discounts = batch.discounts if batch.discounts is not None else self.gamma
            actions, log_prob = self.actor.action_log_prob(batch.observations)
            log_prob = log_prob.unsqueeze(1)
            alpha = self.log_ent_coef.detach().exp()

            entropy_loss = -(self.log_ent_coef * (log_prob.detach() + self.target_entropy)).mean()
            self.ent_coef_optimizer.zero_grad()
            entropy_loss.backward()
            self.ent_coef_optimizer.step()

            with torch.no_grad():
                next_actions, next_log_prob = self.actor.action_log_prob(batch.next_observations)
                next_values = self.critic_target.values(batch.next_observations, next_actions)
                soft = next_values.amin(dim=0) - alpha * next_log_prob.unsqueeze(1)
                target = batch.rewards + (1 - batch.dones) * discounts * soft
            values = self.critic.values(batch.observations, batch.actions)
            critic_loss = 0.5 * (values - target).square().sum() / batch_size
            policy.critic.optimizer.zero_grad()
            critic_loss.backward()
            policy.critic.optimizer.step()

            # Gradients of the actor's loss need not reach the critics' weights.
            for parameter in critic_parameters:
                parameter.requires_grad_(False)
            lowest = self.critic.values(batch.observations, actions).amin(dim=0)
            actor_loss = (alpha * log_prob - lowest).mean()
            policy.actor.optimizer.zero_grad()
            actor_loss.backward()
            policy.actor.optimizer.step()
            for parameter in critic_parameters:
                parameter.requires_grad_(True)

            with torch.no_grad():
                torch._foreach_lerp_(target_parameters, critic_parameters, self.tau)
        self._n_updates += gradient_steps
        self.last_losses = {
            "critic_loss": critic_loss.item(),
            "actor_loss": actor_loss.item(),
            "entropy_coefficient": alpha.item(),
        }


def make_sac(env, settings, seed):
    """Build the learner.

    Parameters
    ----------
    env : gymnasium.Env
    settings : rlihf_lib.rl.config.SACSettings
    seed : int

    Returns
    -------
    FastSAC
    """
    model = FastSAC(
        StackedPolicy,
        env,
        learning_rate=settings.learning_rate,
        buffer_size=200_000,
        learning_starts=settings.learning_starts,
        batch_size=settings.batch_size,
        tau=settings.tau,
        gamma=settings.discount,
        train_freq=settings.train_freq,
        gradient_steps=settings.gradient_steps,
        n_steps=settings.n_steps,
        target_entropy=settings.target_entropy,
        policy_kwargs={
            "net_arch": list(settings.hidden),
            "optimizer_kwargs": {"fused": True},
        },
        seed=seed,
        device="cpu",
    )
    # Otherwise SB3 leaves a folder in /tmp behind for every run.
    model.set_logger(Logger(folder=None, output_formats=[]))
    return model
