"""The learner: Stable-Baselines3's SAC with `train` written out; see `rlihf_lib.rl.sac`."""

import math
from dataclasses import asdict
from typing import Any

import numba
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.logger import Logger
from torch import nn

from rlihf_lib.rl.sac.batch import Batch
from rlihf_lib.rl.sac.networks import StackedPolicy
from rlihf_lib.rl.sac.passes import ActorPass, CriticBuffers, CriticPass


def flatten(module: nn.Module) -> nn.Parameter:
    """Return a module's parameters, moved into one vector, whose `grad` holds their gradients.

    The parameters keep names, shapes and values; one operation then updates them all.
    """
    parameters = list(module.parameters())
    flat = nn.Parameter(nn.utils.parameters_to_vector(parameters).detach())
    gradients = flat.grad = torch.zeros_like(flat)
    sizes = [parameter.numel() for parameter in parameters]
    parts = zip(parameters, flat.detach().split(sizes), gradients.split(sizes), strict=True)
    for parameter, values, gradient in parts:
        parameter.data = values.view_as(parameter)
        parameter.grad = gradient.view_as(parameter)
    return flat


# Divisions as in NumPy: a check for zero would keep the loop from being vectorised.
@numba.njit(cache=True, error_model="numpy")
def _adam(values, gradient, mean, square, constants):
    """One step, in place; constants: both betas, step size, correction of `square`, epsilon."""
    beta1, beta2, step_size, correction, epsilon = constants
    one = np.float32(1)
    for i in range(len(values)):
        mean[i] += (one - beta1) * (gradient[i] - mean[i])
        square[i] += (one - beta2) * (gradient[i] * gradient[i] - square[i])
        values[i] -= step_size * mean[i] / (np.sqrt(square[i]) * correction + epsilon)


class FlatAdam(torch.optim.Adam):
    """PyTorch's Adam for one vector, at a fraction of the overhead; its state is PyTorch's."""

    def __init__(self, vector: torch.Tensor, learning_rate: float):
        super().__init__([vector], lr=learning_rate)
        mean, square = torch.zeros_like(vector), torch.zeros_like(vector)
        self.state[vector] = {"step": torch.tensor(0.0), "exp_avg": mean, "exp_avg_sq": square}

    def update(self) -> None:
        """Do what `step` does, without the hooks that PyTorch puts around it."""
        group = self.param_groups[0]
        (vector,), (beta1, beta2) = group["params"], group["betas"]
        state = self.state[vector]
        step = state["step"].add_(1).item()
        step_size, correction = group["lr"] / (1 - beta1**step), 1 / math.sqrt(1 - beta2**step)
        constants = tuple(map(np.float32, (beta1, beta2, step_size, correction, group["eps"])))
        # Not kept: SB3's `load` puts other memory behind the entropy coefficient.
        values, gradient = vector.detach().numpy(), vector.grad.numpy()
        moments = state["exp_avg"].numpy(), state["exp_avg_sq"].numpy()
        _adam(values, gradient, *moments, constants)


class FastSAC(SAC):
    """Stable-Baselines3's SAC with `train` written out for a `StackedPolicy`.

    `critic_noise` are standard deviations, for the observations and actions critics are fitted to;
    `learning` has a row every `log_every` steps: step, critic_loss, ent_coef and mean_q.
    """

    # SB3 makes all of these before `train`, and declares them more widely.
    actor: Any
    critic: Any
    log_ent_coef: Any
    ent_coef_optimizer: Any
    target_entropy: Any

    def __init__(self, *args, critic_noise=(0.0, 0.0), log_every: int = 1_000, **kwargs):
        self.critic_noise, self.log_every = critic_noise, log_every
        self.learning: list[dict] = []
        super().__init__(*args, **kwargs)

    def _setup_model(self):
        super()._setup_model()
        self._flat_critic, self._flat_target = flatten(self.critic), flatten(self.critic_target)
        self.log_ent_coef.grad = torch.zeros(1)
        rate = self.lr_schedule(1)
        self.critic.optimizer = FlatAdam(self._flat_critic, rate)
        self.actor.optimizer = FlatAdam(flatten(self.actor), rate)
        self.ent_coef_optimizer = FlatAdam(self.log_ent_coef, rate)
        self._batch = None

    def _excluded_save_params(self):
        ours = ["_flat_critic", "_flat_target", "_batch", "_passes"]
        return [*super()._excluded_save_params(), *ours]

    @torch.no_grad()
    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Update critics, actor and entropy coefficient `gradient_steps` times (Haarnoja 2018)."""
        if self._batch is None or self._batch.size != batch_size:
            self._make_passes(batch_size)
        for _ in range(gradient_steps):
            self._update(self._batch, *self._passes)
        self._n_updates += gradient_steps

    def _make_passes(self, batch_size):
        batch = self._batch = Batch(self.policy, batch_size, self.critic_noise)
        buffers = CriticBuffers(self.critic, batch_size)

        def passes(critic, x):
            return [CriticPass(critic, i, x, buffers) for i in range(len(critic.weights[0]))]

        self._passes = (
            ActorPass(self.actor, batch.states, batch_size),
            passes(self.critic_target, batch.later),
            passes(self.critic, batch.taken),
            passes(self.critic, batch.now),
        )

    def _update(self, batch, policy, later, taken, now):
        batch.draw(self.replay_buffer, self.n_steps, self.gamma)
        log_prob = policy.forward(batch.policy_actions)
        log_prob, next_log_prob = log_prob[: batch.size], log_prob[batch.size :]

        alpha = math.exp(self.log_ent_coef.item())
        self.log_ent_coef.grad.fill_(-float(log_prob.mean()) - self.target_entropy)
        self.ent_coef_optimizer.update()

        values = np.min([critic.forward() for critic in later], axis=0)
        target = batch.returns + batch.discounts * (values - alpha * next_log_prob)
        values, errors = [], []
        for critic in taken:
            values.append(critic.forward())
            errors.append(values[-1] - target)
            critic.backward(errors[-1] / batch.size)
            critic.weight_gradients()
        self.critic.optimizer.update()
        if self.num_timesteps % self.log_every == 0:
            loss, mean_q = np.square(errors).mean(axis=1).sum() / 2, np.mean(values)
            row = {"critic_loss": float(loss), "ent_coef": alpha, "mean_q": float(mean_q)}
            self.learning.append({"step": self.num_timesteps, **row})

        # The derivative of every critic; the smallest one's counts.
        values, slopes = [], []
        for critic in now:
            values.append(critic.forward())
            critic.backward(-1 / batch.size)
            slopes.append(critic.input_gradients(start=batch.states.shape[1]))
        smallest = (values == np.min(values, axis=0))[..., None]
        actions, d_actions = batch.policy_actions[: batch.size], (smallest * slopes).sum(axis=0)
        policy.backward(actions, d_actions, d_log_prob=alpha / batch.size)
        self.actor.optimizer.update()

        self._flat_target.lerp_(self._flat_critic, self.tau)


def make_sac(env, settings, seed: int, log_every: int = 1_000) -> FastSAC:
    """Build the learner for an environment, from `rlihf_lib.rl.runs.SACSettings`."""
    names = asdict(settings)
    hidden, discount = names.pop("hidden"), names.pop("discount")
    model = FastSAC(
        StackedPolicy, env, seed=seed, log_every=log_every, device="cpu", gamma=discount,
        buffer_size=200_000,  # transitions: all that a run makes
        policy_kwargs={"net_arch": list(hidden)},
        **names,  # the others are called as in SB3
    )  # fmt: skip
    # Otherwise SB3 leaves a folder in /tmp behind for every run.
    model.set_logger(Logger(folder=None, output_formats=[]))
    return model
