"""A network's parameters in one vector, and Adam's step for such a vector."""

import math

import numba
import numpy as np
import torch
from torch import nn


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
