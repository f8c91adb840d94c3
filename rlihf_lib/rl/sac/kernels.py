"""The loops of `rl/sac/passes.py` that work element by element, compiled."""

import numba
import numpy as np

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
