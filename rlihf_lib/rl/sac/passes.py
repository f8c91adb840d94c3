"""Forward and backward passes of SAC's networks, written out.

For networks this small, autograd and the tensors it allocates cost more than the arithmetic. Here
memory is fixed, and a pass is PyTorch's matrix products on it and one compiled loop per layer for
what is done element by element. Gradients land in the parameters' `grad`.
"""

import math

import numba
import numpy as np
import torch
from stable_baselines3.sac.policies import LOG_STD_MAX, LOG_STD_MIN
from torch import nn

from rlihf_lib.rl.sac.networks import StackedCritic

SQUASH_EPSILON = 1e-6  # SB3's: keeps log(1 - tanh^2) finite
# Sums may be reordered, which lets them be vectorised.
compiled = numba.njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
# A Python number would turn the arithmetic into float64.
ZERO, ONE = np.float32(0), np.float32(1)
LAYER_NORM_EPSILON = np.float32(1e-5)  # PyTorch's


@compiled
def norm_relu(z, bias, y, scale) -> None:
    """z <- layer_norm(z + bias), y <- relu(z), scale <- 1 / standard deviation."""
    batch, width = z.shape
    for i in range(batch):
        total, squares = ZERO, ZERO
        for j in range(width):
            z[i, j] += bias[j]
            total += z[i, j]
        mean = total / np.float32(width)
        for j in range(width):
            z[i, j] -= mean
            squares += z[i, j] * z[i, j]
        factor = ONE / np.sqrt(squares / np.float32(width) + LAYER_NORM_EPSILON)
        for j in range(width):
            z[i, j] *= factor
            y[i, j] = max(z[i, j], ZERO)
        scale[i] = factor


@compiled
def norm_relu_backward(z, scale, delta) -> None:
    """delta <- gradient before `norm_relu`, from that after it; z is the normalised one."""
    batch, width = z.shape
    for i in range(batch):
        total, product = ZERO, ZERO
        for j in range(width):
            d = delta[i, j] if z[i, j] > ZERO else ZERO
            delta[i, j] = d
            total += d
            product += d * z[i, j]
        mean, slope = total / np.float32(width), product / np.float32(width)
        for j in range(width):
            delta[i, j] = scale[i] * (delta[i, j] - mean - slope * z[i, j])


@compiled
def read_out(y, weight, bias, values) -> None:
    """values <- y weight + bias; MKL takes five times as long for a single column."""
    batch, width = y.shape
    for i in range(batch):
        total = bias[0]
        for j in range(width):
            total += y[i, j] * weight[j, 0]
        values[i] = total


@compiled
def relu(y, bias) -> None:
    """y <- relu(y + bias)."""
    for i in range(len(y)):
        for j in range(y.shape[1]):
            y[i, j] = max(y[i, j] + bias[j], ZERO)


@compiled
def relu_backward(y, delta) -> None:
    """delta <- gradient before the relu whose output is y, from that after it."""
    for i in range(len(delta)):
        for j in range(delta.shape[1]):
            delta[i, j] = delta[i, j] if y[i, j] > ZERO else ZERO


class CriticBuffers:
    """What a pass through a critic leaves behind; shared by all, which keeps it in the cache."""

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
        self._forward, self._backward = [], []
        for i, (z, scale) in enumerate(zip(buffers.normalised, buffers.scales, strict=True)):
            normed = z.numpy(), biases[i].numpy(), inputs[i + 1].numpy(), scale
            self._forward.append((inputs[i], weights[i], z, normed))
            normed_back = z.numpy(), scale, deltas[i].numpy()
            self._backward.append((weights[i + 1], deltas[i + 1].T, deltas[i].T, normed_back))
        d_weights = [weight.grad[index].T for weight in critic.weights]
        d_biases = [bias.grad[index, 0] for bias in critic.biases]
        transposed = [delta.T for delta in deltas]
        self._gradients = list(zip(inputs, deltas, transposed, d_weights, d_biases, strict=True))
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
        for weight, above, below, normed in reversed(self._backward):
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
        inputs, top = [x, *outputs[:-1]], outputs[-1]
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
        self._heads = [
            (head.bias.detach(), top, head.weight.detach().T, mean)
            for head, mean in zip(heads, means, strict=True)
        ]
        self._top = deltas[-1], [head.weight.detach() for head in heads], d_means
        parts = zip((*layers, *heads), (*inputs, top, top), (*deltas, *d_means), strict=True)
        self._gradients = [
            (y[:batch_size], delta, delta.T, layer.weight.grad, layer.bias.grad)
            for layer, y, delta in parts
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
        """Leave the gradients in the actor's parameters, from the loss's derivatives.

        By the actions drawn, (batch_size, n_actions), and by each log-probability.
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
        for rectified, delta, weight, below in reversed(self._backward):
            relu_backward(*rectified)
            if below is not None:
                torch.mm(delta, weight, out=below)
        _weight_gradients(self._gradients)


def _weight_gradients(parts):
    """Leave the gradients of linear layers, each by its input and its output's delta."""
    for x, delta, transposed, d_weight, d_bias in parts:
        torch.mm(transposed, x, out=d_weight)
        torch.sum(delta, dim=0, out=d_bias)
