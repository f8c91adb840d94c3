"""Forward and backward passes of SAC's networks, written out.

For networks this small, autograd and the tensors it allocates cost more than the arithmetic. Here
memory is fixed, and a pass is a fixed list of operations on it: PyTorch's matrix products, and one
compiled loop per layer for what is done element by element. Gradients land in the parameters'
`grad`. `tests/rl/test_sac.py` holds them to autograd's.
"""

import math
from functools import partial

import numpy as np
import torch
from stable_baselines3.sac.policies import LOG_STD_MAX, LOG_STD_MIN
from torch import nn

from rlihf_lib.rl.sac.kernels import norm_relu, norm_relu_backward, read_out, relu, relu_backward

SQUASH_EPSILON = 1e-6  # SB3's: keeps log(1 - tanh^2) finite


class CriticBuffers:
    """What a pass through a critic leaves behind.

    All passes share them, one critic after the other: what is worked on stays in the cache.

    Parameters
    ----------
    critic : rlihf_lib.rl.sac.networks.StackedCritic
    batch_size : int
    """

    def __init__(self, critic, batch_size):
        shapes = [(batch_size, weight.shape[2]) for weight in critic.weights[:-1]]
        self.normalised, self.outputs, self.deltas = (
            [torch.empty(shape) for shape in shapes] for _ in range(3)
        )
        self.scales = [np.empty(batch_size, np.float32) for _ in shapes]
        self.d_values = torch.empty(batch_size, 1)


class CriticPass:
    """Values of one of several stacked critics and their derivatives.

    Parameters
    ----------
    critic : rlihf_lib.rl.sac.networks.StackedCritic
    index : int
        Which of them.
    x : Tensor, shape (batch, n)
        Observations and actions; read anew by each pass.
    buffers : CriticBuffers
    """

    def __init__(self, critic, index, x, buffers):
        weights = [weight.detach()[index] for weight in critic.weights]
        biases = [bias.detach()[index, 0] for bias in critic.biases]
        inputs = [x, *buffers.outputs]
        deltas = [*buffers.deltas, buffers.d_values]
        self._values, self._d_values = np.empty(len(x), np.float32), buffers.d_values.numpy()
        self._forward, self._backward, self._weight_gradients = [], [], []
        for i, (z, scale, y, delta) in enumerate(
            zip(buffers.normalised, buffers.scales, buffers.outputs, buffers.deltas, strict=True)
        ):
            self._forward += [
                partial(torch.mm, inputs[i], weights[i], out=z),
                partial(norm_relu, z.numpy(), biases[i].numpy(), y.numpy(), scale),
            ]
            self._backward = [
                partial(torch.mm, weights[i + 1], deltas[i + 1].T, out=delta.T),
                partial(norm_relu_backward, z.numpy(), scale, delta.numpy()),
                *self._backward,
            ]
        last = (inputs[-1], weights[-1], biases[-1])
        self._forward.append(partial(read_out, *(tensor.numpy() for tensor in last), self._values))
        for weight, bias, y, delta in zip(
            critic.weights, critic.biases, inputs, deltas, strict=True
        ):
            self._weight_gradients += [
                partial(torch.mm, delta.T, y, out=weight.grad[index].T),
                partial(torch.sum, delta, dim=0, out=bias.grad[index, 0]),
            ]
        self._first = deltas[0], weights[0].T

    def forward(self):
        """Return the values, an ndarray (batch,) that the next call overwrites."""
        for operation in self._forward:
            operation()
        return self._values

    def backward(self, d_values):
        """Carry the loss's derivative by the values back through the layers."""
        self._d_values[:, 0] = d_values
        for operation in self._backward:
            operation()

    def weight_gradients(self):
        """Leave the gradients that `backward` implies in the critic's parameters."""
        for operation in self._weight_gradients:
            operation()

    def input_gradients(self, start):
        """Return the gradient that `backward` implies for x[:, start:], an ndarray."""
        delta, weight = self._first
        return torch.mm(delta, weight[:, start:]).numpy()


class ActorPass:
    """Actions of the squashed Gaussian policy and their derivatives.

    Parameters
    ----------
    actor : stable_baselines3.sac.policies.Actor
    x : Tensor, shape (rows, n)
        Observations; read anew by each pass.
    batch_size : int
        The first so many of them enter the backward pass.
    """

    def __init__(self, actor, x, batch_size):
        layers = [layer for layer in actor.latent_pi if isinstance(layer, nn.Linear)]
        outputs = [torch.empty(len(x), layer.out_features) for layer in layers]
        heads = torch.empty(2, len(x), actor.mu.out_features)
        self._mean, self._log_std = heads.numpy()
        noise = torch.empty_like(heads[0])
        self._noise = noise.numpy()
        d_heads = torch.empty(2, batch_size, actor.mu.out_features)
        self._d_mean, self._d_log_std = d_heads.numpy()
        deltas = [y[:batch_size].clone() for y in outputs]
        inputs = [x, *outputs]
        self._forward, self._backward = [], []
        for i, (layer, y, delta) in enumerate(zip(layers, outputs, deltas, strict=True)):
            weight, bias = layer.weight.detach(), layer.bias.detach()
            self._forward += [
                partial(torch.mm, inputs[i], weight.T, out=y),
                partial(relu, y.numpy(), bias.numpy()),
            ]
            back = [
                partial(relu_backward, y.numpy(), delta.numpy()),
                *_gradients(layer, inputs[i][:batch_size], delta),
            ]
            if i > 0:
                back.append(partial(torch.mm, delta, weight, out=deltas[i - 1]))
            self._backward = back + self._backward
        for layer, head in zip((actor.mu, actor.log_std), heads, strict=True):
            weight, bias = layer.weight.detach(), layer.bias.detach()
            self._forward.append(partial(torch.addmm, bias, outputs[-1], weight.T, out=head))
        # One draw per batch of states, as in SB3.
        self._forward += [part.normal_ for part in noise.split(batch_size)]
        mean, log_std = actor.mu, actor.log_std
        self._backward = [
            partial(torch.mm, d_heads[0], mean.weight.detach(), out=deltas[-1]),
            partial(deltas[-1].addmm_, d_heads[1], log_std.weight.detach()),
            *_gradients(mean, outputs[-1][:batch_size], d_heads[0]),
            *_gradients(log_std, outputs[-1][:batch_size], d_heads[1]),
            *self._backward,
        ]

    def forward(self, actions):
        """Draw `actions`, ndarray (rows, n_actions); return their log-probabilities (rows,)."""
        for operation in self._forward:
            operation()
        log_std = np.clip(self._log_std, LOG_STD_MIN, LOG_STD_MAX)
        self._deviation = np.exp(log_std) * self._noise
        np.tanh(self._mean + self._deviation, out=actions)
        surprise = 0.5 * self._noise**2 + log_std + 0.5 * math.log(2 * math.pi)
        return -(surprise + np.log(1 - actions**2 + SQUASH_EPSILON)).sum(axis=1)

    def backward(self, actions, d_actions, d_log_prob):
        """Leave the gradients in the actor's parameters.

        Parameters
        ----------
        actions, d_actions : ndarray, shape (batch_size, n_actions)
            What `forward` drew, and the loss's derivative by it.
        d_log_prob : float
            The loss's derivative by each log-probability.
        """
        log_std, deviation = self._log_std[: len(actions)], self._deviation[: len(actions)]
        slope = 1 - actions**2
        d_prob = 2 * d_log_prob * actions / (slope + SQUASH_EPSILON)
        np.multiply(slope, d_prob + d_actions, out=self._d_mean)
        inside = (log_std >= LOG_STD_MIN) & (log_std <= LOG_STD_MAX)
        np.multiply(inside, self._d_mean * deviation - d_log_prob, out=self._d_log_std)
        for operation in self._backward:
            operation()


def _gradients(layer, x, delta):
    """Operations that leave a linear layer's gradients in its parameters."""
    return [
        partial(torch.mm, delta.T, x, out=layer.weight.grad),
        partial(torch.sum, delta, dim=0, out=layer.bias.grad),
    ]
