"""Batches of n-step transitions, drawn from Stable-Baselines3's replay buffer."""

import numba
import numpy as np
import torch

# Arrays of a replay buffer, shape (n, n_envs, ...).
MEMORY = ("observations", "actions", "next_observations", "rewards", "dones", "timeouts")


@numba.njit(cache=True)
def _fill_in(memory, starts, envs, limits, batch):
    """Fill in what `Batch` holds: transitions from steps `starts` of environments, (n,), on.

    Each is followed for n_steps, until its episode or the buffer, at `newest`, ends.
    """
    observations, actions, next_observations, rewards, dones, timeouts = memory
    rows, returns, discounts = batch
    n_steps, gamma, newest = limits
    size, n_observations, n_actions = len(returns), observations.shape[2], actions.shape[2]
    for i in range(size):  # loops, as Numba takes twice as long to copy slices this short
        at, env = starts[i], envs[i]
        for j in range(n_observations):
            rows[i, j] = rows[2 * size + i, j] = observations[at, env, j]
        for j in range(n_actions):
            rows[2 * size + i, n_observations + j] = actions[at, env, j]
        total, weight = 0.0, 1.0
        for step in range(n_steps):
            total += weight * rewards[at, env]
            weight *= gamma
            if step == n_steps - 1 or dones[at, env] or timeouts[at, env] or at == newest:
                break
            at = (at + 1) % len(observations)
        for j in range(n_observations):
            rows[size + i, j] = next_observations[at, env, j]
        returns[i] = total
        terminated = dones[at, env] and not timeouts[at, env]
        discounts[i] = 0.0 if terminated else weight


class Batch:
    """One batch, in memory that every draw reuses.

    `states` holds the states and below them the states `n_steps` later; `policy_actions` is there
    for the policy's actions in them. The critics' inputs share their memory: `now` and `later` are
    states with the policy's actions, `taken` with those taken. `returns` are the rewards in
    between, `discounts` what the value of the later state counts: 0 where the episode terminated.
    To the observations and actions in `taken`, noise of two standard deviations is added.
    """

    def __init__(self, policy, size: int, noise: tuple[float, float]):
        (n_observations,), (n_actions,) = policy.observation_space.shape, policy.action_space.shape
        self.size = size
        self._rows = torch.empty(3 * size, n_observations + n_actions)
        self.now, self.later, self.taken = self._rows.split(size)
        self.states = self._rows[: 2 * size, :n_observations]
        self.policy_actions = self._rows[: 2 * size, n_observations:].numpy()
        self.returns, self.discounts = np.empty((2, size), np.float32)
        self._noisy, self._noise = any(noise), torch.empty_like(self.taken)
        self._scale = torch.tensor([noise[0]] * n_observations + [noise[1]] * n_actions)

    def draw(self, buffer, n_steps: int, gamma: float) -> None:
        """Fill the batch: the transitions, and the random numbers, of SB3's `buffer.sample`."""
        filled = buffer.buffer_size if buffer.full else buffer.pos
        starts = np.random.randint(0, filled, size=self.size)  # noqa: NPY002 (as SB3 does)
        envs = np.random.randint(0, buffer.n_envs, size=self.size)  # noqa: NPY002
        memory = tuple(getattr(buffer, name) for name in MEMORY)
        limits = n_steps, gamma, (buffer.pos - 1) % buffer.buffer_size
        _fill_in(memory, starts, envs, limits, (self._rows.numpy(), self.returns, self.discounts))
        if self._noisy:  # else the random numbers stay those of SB3
            self.taken.addcmul_(self._noise.normal_(), self._scale)
