"""Stable-Baselines3's SAC networks, with critics that are stacked and normalised."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import torch
import torch.nn.functional as F
from stable_baselines3.sac.policies import LOG_STD_MAX, LOG_STD_MIN, SACPolicy
from torch import nn


class StackedCritic(nn.Module):
    """`n_critics` Q-functions of observation and action, by one batched product per layer."""

    def __init__(self, in_features: int, hidden: Sequence[int], n_critics: int):
        super().__init__()
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for n_in, n_out in pairwise([in_features, *hidden, 1]):
            bound = 1 / math.sqrt(n_in)  # torch.nn.Linear's initialisation
            self.weights.append(torch.empty(n_critics, n_in, n_out).uniform_(-bound, bound))
            self.biases.append(torch.empty(n_critics, 1, n_out).uniform_(-bound, bound))

    def forward(self, observation: torch.Tensor, action: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Q-values as Stable-Baselines3 expects them: a tuple of (batch, 1) tensors."""
        x = torch.cat((observation, action), dim=1)
        x = x.expand(self.weights[0].shape[0], *x.shape)
        *hidden, (last_weight, last_bias) = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            x = torch.baddbmm(bias, x, weight)
            x = F.relu(F.layer_norm(x, x.shape[-1:]))
        return tuple(torch.baddbmm(last_bias, x, last_weight))

    def set_training_mode(self, mode: bool) -> None:
        """Part of Stable-Baselines3's interface."""
        self.train(mode)


class StackedPolicy(SACPolicy):
    """SB3's policy with a `StackedCritic`, on the CPU."""

    # SB3 looks for it among the parameters every step.
    device = torch.device("cpu")
    actor: Any
    critic_kwargs: dict[str, Any]
    observation_space: Any
    action_space: Any

    def _build(self, lr_schedule):
        super()._build(lr_schedule)
        self._hidden = [layer for layer in self.actor.latent_pi if isinstance(layer, nn.Linear)]

    def _predict(self, observation, deterministic=False):
        """Draw SB3's actions, without the distribution that it builds and validates every step.

        Nor are the layers called as modules, which takes longer than their arithmetic.
        """
        x = observation
        for layer in self._hidden:
            x = torch.relu(F.linear(x, layer.weight, layer.bias))
        heads = self.actor.mu, self.actor.log_std
        action, log_std = (F.linear(x, head.weight, head.bias) for head in heads)
        if not deterministic:
            log_std = log_std.clamp(LOG_STD_MIN, LOG_STD_MAX)
            action = action + torch.randn_like(action) * log_std.exp()
        return torch.tanh(action)

    def set_training_mode(self, mode: bool) -> None:
        """Leave the mode alone: no layer here behaves differently, and SB3 sets it twice a step."""

    def make_critic(self, features_extractor=None) -> Any:
        """Build one set of critics."""
        n_in = self.observation_space.shape[0] + self.action_space.shape[0]
        return StackedCritic(n_in, self.critic_kwargs["net_arch"], self.critic_kwargs["n_critics"])
