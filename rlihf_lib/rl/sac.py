"""Soft Actor-Critic: Stable-Baselines3's, with normalised critics and a faster update.

The algorithm and its interface are `stable_baselines3.SAC` (Haarnoja et al. 2018). Three things
differ. The critics' hidden layers are normalised (`LayerNorm`), which keeps values from running
away under noisy rewards (Ball et al. 2023, RLPD). The critics are fitted to observations and
actions with a little noise, which smooths them (Bishop 1995): without it, critics of pilots with
decoded feedback had learnt a third to a half of the noise of each older epoch by heart. And `train`
does the same arithmetic without autograd and other bookkeeping, which takes more than half the time
for networks this small.
"""

import math

import torch
from stable_baselines3 import SAC
from stable_baselines3.common.logger import Logger

from rlihf_lib.rl.backpropagation import ActorPass, CriticBuffers, CriticPass
from rlihf_lib.rl.batch import Batch
from rlihf_lib.rl.flat import adam_step, flatten
from rlihf_lib.rl.networks import StackedPolicy


class FastSAC(SAC):
    """Stable-Baselines3's SAC with `train` written out for a `StackedPolicy`.

    Parameters
    ----------
    critic_noise : pair of float
        Standard deviation of the noise added to the observations and actions critics are fitted to.
    *args, **kwargs
        As for `stable_baselines3.SAC`.
    """

    def __init__(self, *args, critic_noise=(0.0, 0.0), **kwargs):
        self.critic_noise = critic_noise
        super().__init__(*args, **kwargs)

    def _setup_model(self):
        super()._setup_model()
        self._flat_critic, self._flat_target = flatten(self.critic), flatten(self.critic_target)
        for network, flat in ((self.critic, self._flat_critic), (self.actor, flatten(self.actor))):
            network.optimizer = torch.optim.Adam([flat], lr=self.lr_schedule(1))
        self.log_ent_coef.grad = torch.zeros(1)
        self._batch = None

    def _excluded_save_params(self):
        buffers = ["_flat_critic", "_flat_target", "_batch", "_passes"]
        return [*super()._excluded_save_params(), *buffers]

    @torch.no_grad()
    def train(self, gradient_steps, batch_size=64):
        """Update critics, actor and entropy coefficient `gradient_steps` times (Haarnoja 2018)."""
        if self._batch is None or self._batch.size != batch_size:
            batch = self._batch = Batch(self.policy, batch_size, self.critic_noise)
            buffers = CriticBuffers(self.critic, batch_size)
            self._passes = (
                ActorPass(self.actor, batch.states, batch_size),
                CriticPass(self.critic_target, batch.later, buffers),
                CriticPass(self.critic, batch.taken, buffers),
                CriticPass(self.critic, batch.now, buffers),
            )
        for _ in range(gradient_steps):
            self._update(self._batch, *self._passes)
        self._n_updates += gradient_steps

    def _update(self, batch, policy, later, taken, now):
        batch.draw(self.replay_buffer, self.n_steps, self.gamma)
        log_prob = policy.forward(batch.policy_actions)
        log_prob, next_log_prob = log_prob[: batch.size], log_prob[batch.size :]

        alpha = math.exp(self.log_ent_coef.item())
        self.log_ent_coef.grad.fill_(-float(log_prob.mean()) - self.target_entropy)
        adam_step(self.ent_coef_optimizer)

        soft = later.forward().min(axis=0)[:, 0] - alpha * next_log_prob
        target = batch.returns + batch.discounts * soft
        taken.backward((taken.forward() - target[:, None]) / batch.size)
        taken.weight_gradients()
        adam_step(self.critic.optimizer)

        values = now.forward()
        now.backward((values == values.min(axis=0)) / -batch.size)
        actions = batch.policy_actions[: batch.size]
        d_actions = now.input_gradients(start=batch.states.shape[1])
        policy.backward(actions, d_actions, d_log_prob=alpha / batch.size)
        adam_step(self.actor.optimizer)

        self._flat_target.lerp_(self._flat_critic, self.tau)


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
        critic_noise=settings.critic_noise,
        policy_kwargs={"net_arch": list(settings.hidden)},
        seed=seed,
        device="cpu",
    )
    # Otherwise SB3 leaves a folder in /tmp behind for every run.
    model.set_logger(Logger(folder=None, output_formats=[]))
    return model
