"""A network's parameters in one vector, and Adam's step for such a vector."""

import math

import numba
import numpy as np
import torch
from torch import nn


def flatten(module):
    """Move a module's parameters, and their gradients, into one vector each.

    The parameters keep names, shapes and values; one operation then updates them all.

    Parameters
    ----------
    module : torch.nn.Module

    Returns
    -------
    torch.nn.Parameter
        All parameters in a row; its `grad` holds their gradients.
    """
    parameters = list(module.parameters())
    flat = nn.Parameter(nn.utils.parameters_to_vector(parameters).detach())
    flat.grad = torch.zeros_like(flat)
    sizes = [parameter.numel() for parameter in parameters]
    for parameter, values, gradient in zip(
        parameters, flat.detach().split(sizes), flat.grad.split(sizes), strict=True
    ):
        parameter.data = values.view_as(parameter)
        parameter.grad = gradient.view_as(parameter)
    return flat


# Divisions as in NumPy: a check for zero would keep the loop from being vectorised.
@numba.njit(cache=True, error_model="numpy")
def _adam(values, gradient, mean, square, beta1, beta2, step_size, correction, epsilon):
    one = np.float32(1)
    for i in range(len(values)):
        mean[i] += (one - beta1) * (gradient[i] - mean[i])
        square[i] += (one - beta2) * (gradient[i] * gradient[i] - square[i])
        values[i] -= step_size * mean[i] / (np.sqrt(square[i]) * correction + epsilon)


def adam_step(optimizer):
    """Do what `optimizer.step()` does for one vector, at a fraction of the overhead.

    Parameters
    ----------
    optimizer : torch.optim.Adam
        Of a single one-dimensional parameter, without weight decay or variants. Keeps the state, so
        that it is saved and loaded with the learner.
    """
    group = optimizer.param_groups[0]
    (vector,) = group["params"]
    state = optimizer.state[vector]
    if not state:
        state["step"] = torch.tensor(0.0)
        state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(vector), torch.zeros_like(vector)
    state["step"] += 1
    step, (beta1, beta2) = state["step"].item(), group["betas"]
    constants = (
        beta1, beta2, group["lr"] / (1 - beta1**step), 1 / math.sqrt(1 - beta2**step), group["eps"]
    )  # fmt: skip
    arrays = (vector.detach(), vector.grad, state["exp_avg"], state["exp_avg_sq"])
    _adam(*(array.numpy() for array in arrays), *map(np.float32, constants))
