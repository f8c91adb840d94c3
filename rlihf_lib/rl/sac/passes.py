"""Forward and backward passes of SAC's networks, written out.

For networks this small, autograd and the tensors it allocates cost more than the arithmetic. Here
memory is fixed, and a pass is PyTorch's matrix products on it and one compiled loop per layer for
what is done element by element. Gradients land in the parameters' `grad`. `tests/rl/test_sac.py`
holds them to autograd's.
"""

import math

import numpy as np
import torch
from stable_baselines3.sac.policies import LOG_STD_MAX, LOG_STD_MIN
from torch import nn

from rlihf_lib.rl.sac.kernels import norm_relu, norm_relu_backward, read_out, relu, relu_backward
from rlihf_lib.rl.sac.networks import StackedCritic

SQUASH_EPSILON = 1e-6  # SB3's: keeps log(1 - tanh^2) finite


class CriticBuffers:
    """What a pass through a critic leaves behind.

    All passes share them, one critic after the other: what is worked on stays in the cache.
    """

    def __init__(self, critic: StackedCritic, batch_size: int):
        shapes = [(batch_size, weight.shape[2]) for weight in critic.weights[:-1]]
        self.normalised, self.outputs, self.deltas = (
            [torch.empty(shape) for shape in shapes] for _ in range(3)
        )
        self.scales = [np.empty(batch_size, np.float32) for _ in shapes]
        self.d_values = torch.empty(batch_size, 1)


class CriticPass:
    """Values of one of several stacked critics, that of an index, and their derivatives.

    `x`, (batch, n), are observations and actions, read anew by each pass.
    """

    def __init__(self, critic: StackedCritic, index: int, x: torch.Tensor, buffers: CriticBuffers):
        weights = [weight.detach()[index] for weight in critic.weights]
        biases = [bias.detach()[index, 0] for bias in critic.biases]
        inputs, deltas = [x, *buffers.outputs], [*buffers.deltas, buffers.d_values]
        self._values, self._d_values = np.empty(len(x), np.float32), buffers.d_values.numpy()
        self._forward, self._backward, self._gradients = [], [], []
        for i, (z, scale) in enumerate(zip(buffers.normalised, buffers.scales, strict=True)):
            normed = z.numpy(), biases[i].numpy(), inputs[i + 1].numpy(), scale
            self._forward.append((inputs[i], weights[i], z, normed))
            normed_back = z.numpy(), scale, deltas[i].numpy()
            self._backward.append((weights[i + 1], deltas[i + 1].T, deltas[i].T, normed_back))
        self._backward.reverse()
        for i, delta in enumerate(deltas):
            d_weight, d_bias = critic.weights[i].grad[index].T, critic.biases[i].grad[index, 0]
            self._gradients.append((inputs[i], delta, delta.T, d_weight, d_bias))
        self._last = *(part[-1].numpy() for part in (inputs, weights, biases)), self._values
        self._first = deltas[0], weights[0].T

    def forward(self) -> np.ndarray:
        """Return the values, an ndarray (batch,) that the next call overwrites."""
        for x, weight, z, normed in self._forward:
            torch.mm(x, weight, out=z)
            norm_relu(*normed)
        read_out(*self._last)
        return self._values

    def backward(self, d_values: np.ndarray | float) -> None:
        """Carry the loss's derivative by the values back through the layers."""
        self._d_values[:, 0] = d_values
        for weight, above, below, normed in self._backward:
            torch.mm(weight, above, out=below)
            norm_relu_backward(*normed)

    def weight_gradients(self) -> None:
        """Leave the gradients that `backward` implies in the critic's parameters."""
        _weight_gradients(self._gradients)

    def input_gradients(self, start: int) -> np.ndarray:
        """Return the gradient that `backward` implies for x[:, start:]."""
        delta, weight = self._first
        return torch.mm(delta, weight[:, start:]).numpy()


class ActorPass:
    """Actions of SB3's actor, a squashed Gaussian policy, and their derivatives.

    `x`, (rows, n), are observations, read anew by each pass; the first `batch_size` of them enter
    the backward pass.
    """

    def __init__(self, actor, x: torch.Tensor, batch_size: int):
        layers = [layer for layer in actor.latent_pi if isinstance(layer, nn.Linear)]
        heads = (actor.mu, actor.log_std)
        outputs = [torch.empty(len(x), layer.out_features) for layer in layers]
        deltas = [y[:batch_size].clone() for y in outputs]
        inputs, top = [x, *outputs], outputs[-1]
        means = torch.empty(2, len(x), actor.mu.out_features)  # and logarithms of deviations
        d_means = torch.empty(2, batch_size, actor.mu.out_features)
        noise = torch.empty_like(means[0])
        self._mean, self._log_std = means.numpy()
        self._d_mean, self._d_log_std = d_means.numpy()
        self._noise, self._draws = noise.numpy(), noise.split(batch_size)
        self._forward, self._backward = [], []
        for i, (layer, y, delta) in enumerate(zip(layers, outputs, deltas, strict=True)):
            weight, bias = layer.weight.detach(), layer.bias.detach().numpy()
            below = deltas[i - 1] if i else None
            self._forward.append((inputs[i], weight.T, y, (y.numpy(), bias)))
            self._backward.append(((y.numpy(), delta.numpy()), delta, weight, below))
        self._backward.reverse()
        self._heads = [
            (head.bias.detach(), top, head.weight.detach().T, mean)
            for head, mean in zip(heads, means, strict=True)
        ]
        self._top = deltas[-1], [head.weight.detach() for head in heads], d_means
        self._gradients = [
            (y[:batch_size], delta, delta.T, layer.weight.grad, layer.bias.grad)
            for layer, y, delta in zip(
                (*layers, *heads), (*inputs[:-1], top, top), (*deltas, *d_means), strict=True
            )
        ]

    def forward(self, actions: np.ndarray) -> np.ndarray:
        """Draw `actions`, ndarray (rows, n_actions); return their log-probabilities (rows,)."""
        for x, weight, y, biased in self._forward:
            torch.mm(x, weight, out=y)
            relu(*biased)
        for bias, y, weight, mean in self._heads:
            torch.addmm(bias, y, weight, out=mean)
        for draw in self._draws:  # one per batch of states, as in SB3
            draw.normal_()
        log_std = np.clip(self._log_std, LOG_STD_MIN, LOG_STD_MAX)
        self._deviation = np.exp(log_std) * self._noise
        np.tanh(self._mean + self._deviation, out=actions)
        surprise = 0.5 * self._noise**2 + log_std + 0.5 * math.log(2 * math.pi)
        return -(surprise + np.log(1 - actions**2 + SQUASH_EPSILON)).sum(axis=1)

    def backward(self, actions: np.ndarray, d_actions: np.ndarray, d_log_prob: float) -> None:
        """Leave the gradients in the actor's parameters.

        From the actions drawn, (batch_size, n_actions), and the loss's derivatives by them and by
        each log-probability.
        """
        log_std, deviation = self._log_std[: len(actions)], self._deviation[: len(actions)]
        slope = 1 - actions**2
        d_prob = 2 * d_log_prob * actions / (slope + SQUASH_EPSILON)
        np.multiply(slope, d_prob + d_actions, out=self._d_mean)
        inside = (log_std >= LOG_STD_MIN) & (log_std <= LOG_STD_MAX)
        np.multiply(inside, self._d_mean * deviation - d_log_prob, out=self._d_log_std)
        above, (mean_weight, log_std_weight), (d_mean, d_log_std) = self._top
        torch.mm(d_mean, mean_weight, out=above)
        above.addmm_(d_log_std, log_std_weight)
        for rectified, delta, weight, below in self._backward:
            relu_backward(*rectified)
            if below is not None:
                torch.mm(delta, weight, out=below)
        _weight_gradients(self._gradients)


def _weight_gradients(parts):
    """Leave the gradients of linear layers, each by its input and its output's delta."""
    for x, delta, transposed, d_weight, d_bias in parts:
        torch.mm(transposed, x, out=d_weight)
        torch.sum(delta, dim=0, out=d_bias)
