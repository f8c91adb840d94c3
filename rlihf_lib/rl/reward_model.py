"""A model of the observer's feedback: an ensemble of networks of observation and action."""

import numpy as np
import torch

from rlihf_lib.rl.sac.networks import StackedCritic

N_NETWORKS, HIDDEN, LEARNING_RATE = 5, (64, 64), 1e-3
UPDATES, PASSES, BATCH = 200, 20, 256  # of Adam in a fit, at most; over few answers
FIRST = 0.1  # of their first outputs, relative to PyTorch's
INPUT_NOISE = 0.1  # standard deviation, on observations and actions that they are fitted to


class RewardModel:
    """Networks of observation and action, so many numbers, each fitted to its own resample."""

    def __init__(self, n_inputs: int, seed: int):
        self._random = torch.Generator().manual_seed(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self._networks = StackedCritic(n_inputs, HIDDEN, N_NETWORKS)
        with torch.no_grad():  # what they say before they know anything should not count
            for parameters in (self._networks.weights, self._networks.biases):
                parameters[-1].mul_(FIRST)
        self._optimizer = torch.optim.Adam(self._networks.parameters(), LEARNING_RATE)
        self._mean = 0.5
        self._weights = torch.empty(N_NETWORKS, 0, 1)

    def _outputs(self, inputs):
        return torch.stack(self._networks(inputs, inputs[:, :0]))

    @torch.no_grad()
    def predict(self, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Feedback of observations with actions, (n, n_inputs), and how far networks disagree."""
        outputs = self._mean + self._outputs(torch.from_numpy(inputs)).squeeze(-1).numpy()
        return outputs.mean(0), outputs.std(0)

    def fit(self, inputs: np.ndarray, answers: np.ndarray) -> None:
        """Go on learning from all answers so far, (n,), earlier ones first."""
        x, y = torch.from_numpy(inputs), torch.from_numpy(answers.astype(np.float32))[:, None]
        self._mean = float(y.mean())
        new = torch.full((N_NETWORKS, len(y) - self._weights.shape[1], 1), 1.0)
        self._weights = torch.cat([self._weights, torch.poisson(new, self._random)], dim=1)
        for _ in range(min(UPDATES, -(-PASSES * len(y) // BATCH))):
            chosen = torch.randint(len(y), (BATCH,), generator=self._random)
            noise = torch.randn(BATCH, x.shape[1], generator=self._random)
            errors = self._mean + self._outputs(x[chosen] + INPUT_NOISE * noise) - y[chosen]
            self._optimizer.zero_grad()
            (self._weights[:, chosen] * errors**2).mean().mul(N_NETWORKS).backward()
            self._optimizer.step()
