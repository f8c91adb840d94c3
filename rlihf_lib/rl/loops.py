"""The loops of `rl/backpropagation.py` that work element by element, compiled."""

import numba
import numpy as np

# Sums may be reordered, which lets them be vectorised.
compiled = numba.njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
# A Python number would turn the arithmetic into float64.
ZERO, ONE = np.float32(0), np.float32(1)
LAYER_NORM_EPSILON = np.float32(1e-5)  # PyTorch's


@compiled
def norm_relu(z, bias, y, scale):
    """z <- layer_norm(z + bias), y <- relu(z), scale <- 1 / standard deviation."""
    n_critics, batch, width = z.shape
    for c in range(n_critics):
        for i in range(batch):
            total, squares = ZERO, ZERO
            for j in range(width):
                z[c, i, j] += bias[c, 0, j]
                total += z[c, i, j]
            mean = total / np.float32(width)
            for j in range(width):
                z[c, i, j] -= mean
                squares += z[c, i, j] * z[c, i, j]
            factor = ONE / np.sqrt(squares / np.float32(width) + LAYER_NORM_EPSILON)
            for j in range(width):
                z[c, i, j] *= factor
                y[c, i, j] = max(z[c, i, j], ZERO)
            scale[c, i] = factor


@compiled
def norm_relu_backward(z, scale, delta):
    """delta <- gradient before `norm_relu`, from that after it; z is the normalised one."""
    n_critics, batch, width = z.shape
    for c in range(n_critics):
        for i in range(batch):
            total, product = ZERO, ZERO
            for j in range(width):
                d = delta[c, i, j] if z[c, i, j] > ZERO else ZERO
                delta[c, i, j] = d
                total += d
                product += d * z[c, i, j]
            mean, slope = total / np.float32(width), product / np.float32(width)
            for j in range(width):
                delta[c, i, j] = scale[c, i] * (delta[c, i, j] - mean - slope * z[c, i, j])


@compiled
def read_out(y, weight, bias, values):
    """values <- y weight + bias; MKL takes five times as long for a single column."""
    n_critics, batch, width = y.shape
    for c in range(n_critics):
        for i in range(batch):
            total = bias[c, 0, 0]
            for j in range(width):
                total += y[c, i, j] * weight[c, j, 0]
            values[c, i, 0] = total


@compiled
def relu(y, bias):
    """y <- relu(y + bias)."""
    for i in range(len(y)):
        for j in range(y.shape[1]):
            y[i, j] = max(y[i, j] + bias[j], ZERO)


@compiled
def relu_backward(y, delta):
    """delta <- gradient before the relu whose output is y, from that after it."""
    for i in range(len(delta)):
        for j in range(delta.shape[1]):
            delta[i, j] = delta[i, j] if y[i, j] > ZERO else ZERO
