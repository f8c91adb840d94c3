"""EEGNet: the published network, layer by layer, and many of them trained as one.

References
----------
Lawhern, Solon, Waytowich, Gordon, Hung, Lance (2018). EEGNet: a compact convolutional neural
network for EEG-based brain-computer interfaces. J. Neural Eng. 15, 056013 (its Table 2).
"""

import math
from dataclasses import dataclass

import torch
from torch import nn
from torch.nn import functional as F

BATCH_NORM_EPS = 1e-3  # Keras' default, with which EEGNet was published
BATCH_NORM_MOMENTUM = 0.1
SPATIAL_MAX_NORM = 1.0
DENSE_MAX_NORM = 0.25


@dataclass(frozen=True)
class Architecture:
    """Sizes of one EEGNet; the defaults are EEGNet-8,2 for signals at 128 Hz."""

    n_channels: int
    n_times: int
    F1: int = 8
    """Temporal filters."""
    D: int = 2
    """Spatial filters per temporal filter."""
    F2: int = 16
    """Pointwise filters of the separable convolution."""
    kernel: int = 64
    """Samples of a temporal filter: half a second."""
    kernel_separable: int = 16
    """Samples of the second temporal convolution, after the first pooling."""
    pool1: int = 4
    pool2: int = 8
    dropout: float = 0.25
    """Published: 0.25 across subjects, 0.5 within."""

    def __post_init__(self):
        if self.n_times < self.pool1 * self.pool2:
            raise ValueError(
                f"{self.n_times} samples are too few for pooling by {self.pool1} x {self.pool2}; "
                f"give epochs of at least {self.pool1 * self.pool2} samples"
            )

    @property
    def n_features(self):
        """Inputs of the dense layer."""
        return self.F2 * (self.n_times // self.pool1 // self.pool2)


class EEGNet(nn.Module):
    """EEGNet as published, the network the paper decodes error potentials with, Eq. (1).

    Parameters
    ----------
    architecture : Architecture

    Notes
    -----
    The spatial filters keep a norm of at most 1 and the weights of each class one of at most
    0.25: call `constrain` after every optimiser step.
    """

    def __init__(self, architecture):
        super().__init__()
        a = self.architecture = architecture

        def batch_norm(n):
            return nn.BatchNorm2d(n, eps=BATCH_NORM_EPS, momentum=BATCH_NORM_MOMENTUM)

        n = a.F1 * a.D
        self.temporal = nn.Conv2d(1, a.F1, (1, a.kernel), padding="same", bias=False)
        self.norm1 = batch_norm(a.F1)
        self.spatial = nn.Conv2d(a.F1, n, (a.n_channels, 1), groups=a.F1, bias=False)
        self.norm2 = batch_norm(n)
        self.separable = nn.Conv2d(
            n, n, (1, a.kernel_separable), padding="same", groups=n, bias=False
        )
        self.pointwise = nn.Conv2d(n, a.F2, 1, bias=False)
        self.norm3 = batch_norm(a.F2)
        self.dense = nn.Linear(a.n_features, 2)
        for name, weight in self.named_parameters():
            if weight.dim() > 1:
                nn.init.xavier_uniform_(weight)
            elif name == "dense.bias":
                nn.init.zeros_(weight)

    def forward(self, x):
        """Map epochs to logits.

        Parameters
        ----------
        x : Tensor, shape (n, n_channels, n_times)

        Returns
        -------
        Tensor, shape (n, 2)
            Logits of correct and error; `softmax` of them is Eq. (1).
        """
        a = self.architecture
        x = self.norm1(self.temporal(x[:, None]))
        x = F.elu(self.norm2(self.spatial(x)))
        x = F.dropout(F.avg_pool2d(x, (1, a.pool1)), a.dropout, self.training)
        x = F.elu(self.norm3(self.pointwise(self.separable(x))))
        x = F.dropout(F.avg_pool2d(x, (1, a.pool2)), a.dropout, self.training)
        return self.dense(x.flatten(1))

    @torch.no_grad()
    def constrain(self):
        """Apply the published max-norm constraints."""
        self.spatial.weight.copy_(self.spatial.weight.renorm(2, 0, SPATIAL_MAX_NORM))
        self.dense.weight.copy_(self.dense.weight.renorm(2, 0, DENSE_MAX_NORM))


class EEGNetBatch(nn.Module):
    """`n_networks` independent EEGNets of one architecture, computed as one.

    Every network is exactly an `EEGNet`: the same outputs and the same gradients (a test holds
    them together), for a small part of the cost. Three things make the difference:

    - Temporal and spatial filters commute, so the spatial ones go first and the temporal filter
      sees `D` signals instead of `n_channels`.
    - The first batch normalisation would still need the mean and variance over all temporally
      filtered channels. Both follow from the input alone: with p the patch of samples under a
      filter h, E[y] = h'E[p] and E[y^2] = h'E[pp']h. `patch_moments` computes the two
      expectations once per epoch.
    - A convolution of a short signal is a product with a banded (Toeplitz) matrix, and the
      products of all networks are one batched product.

    Parameters
    ----------
    architecture : Architecture
    seeds : sequence of int
        One network each; a network's initial weights depend on its seed alone.
    """

    def __init__(self, architecture, seeds):
        super().__init__()
        self.architecture = architecture
        self.n_networks = len(seeds)
        networks = []
        for seed in seeds:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(seed)
                networks.append(EEGNet(architecture))
        states = [network.state_dict() for network in networks]
        trainable = {name for name, _ in networks[0].named_parameters()}
        self._names = [name for name in states[0] if not name.endswith("num_batches_tracked")]
        for name in self._names:
            stacked = torch.stack([state[name] for state in states])
            attribute = name.replace(".", "_")
            if name in trainable:
                self.register_parameter(attribute, nn.Parameter(stacked))
            else:
                self.register_buffer(attribute, stacked)

    def network_state(self, index):
        """Return the state of one network, for `EEGNet.load_state_dict(..., strict=False)`."""
        return {name: getattr(self, name.replace(".", "_"))[index] for name in self._names}

    @torch.no_grad()
    def load_network_states(self, states):
        """Put back one `network_state` per network."""
        for name in self._names:
            stacked = torch.stack([state[name] for state in states])
            getattr(self, name.replace(".", "_")).copy_(stacked)

    def patch_moments(self, x):
        """Compute first and second moments of the patches a temporal filter sees.

        Parameters
        ----------
        x : Tensor, shape (n, n_channels, n_times)

        Returns
        -------
        mean : Tensor, shape (n, kernel)
        second : Tensor, shape (n, kernel, kernel)
            Averaged over channels and times of each epoch.
        """
        kernel = self.architecture.kernel
        left = (kernel - 1) // 2
        patches = F.pad(x, (left, kernel - 1 - left)).unfold(-1, kernel, 1).flatten(1, 2)
        return patches.mean(1), patches.transpose(1, 2) @ patches / patches.shape[1]

    def forward(self, x, moments=None):
        """Map epochs to logits, each network its own epochs.

        Parameters
        ----------
        x : Tensor, shape (n_channels, n_networks, n, n_times)
        moments : pair of Tensor, shapes (n_networks, kernel), (n_networks, kernel, kernel)
            Means over each network's epochs of `patch_moments`; needed in training mode.

        Returns
        -------
        Tensor, shape (n_networks, n, 2)
        """
        a, g = self.architecture, self.n_networks
        n_filters, n = a.F1 * a.D, x.shape[2]
        spatial = self.spatial_weight.view(g, n_filters, a.n_channels)
        temporal = self.temporal_weight.view(g, a.F1, a.kernel)
        scale, shift = self._first_norm(temporal, moments)
        x = spatial @ x.flatten(2).transpose(0, 1)
        # Filter f's batch normalisation, a scale and a shift, seen through the spatial filters.
        temporal = temporal * scale[..., None]
        shift = shift.repeat_interleave(a.D, 1) * spatial.sum(-1)
        x = x.view(g * a.F1, a.D * n, a.n_times) @ toeplitz(temporal, a.n_times)
        x = x.view(g, n_filters, -1) + shift[..., None]
        x = F.elu(self._norm("norm2", x)).view(g * n_filters, n, a.n_times)
        x = F.dropout(F.avg_pool1d(x, a.pool1), a.dropout, self.training)
        x = x @ toeplitz(self.separable_weight.view(g, n_filters, -1), x.shape[-1])
        n_times = x.shape[-1]
        x = self.pointwise_weight.view(g, a.F2, n_filters) @ x.view(g, n_filters, -1)
        x = F.elu(self._norm("norm3", x)).view(g * a.F2, n, n_times)
        x = F.dropout(F.avg_pool1d(x, a.pool2), a.dropout, self.training)
        x = x.view(g, a.F2, n, -1).transpose(1, 2).reshape(g, n, -1)
        return torch.baddbmm(self.dense_bias[:, None], x, self.dense_weight.transpose(1, 2))

    def _first_norm(self, temporal, moments):
        """Turn the first batch normalisation into a scale and a shift per temporal filter."""
        if self.training:
            mean = (temporal @ moments[0][..., None]).squeeze(-1)
            second = torch.einsum("gfk,gkl,gfl->gf", temporal, moments[1], temporal)
            variance = second - mean**2
            with torch.no_grad():
                self.norm1_running_mean.lerp_(mean, BATCH_NORM_MOMENTUM)
                self.norm1_running_var.lerp_(variance, BATCH_NORM_MOMENTUM)
        else:
            mean, variance = self.norm1_running_mean, self.norm1_running_var
        scale = self.norm1_weight / torch.sqrt(variance + BATCH_NORM_EPS)
        return scale, self.norm1_bias - mean * scale

    def _norm(self, name, x):
        """Batch-normalise (n_networks, filters, n * times), each network and filter by itself."""
        flat = [
            getattr(self, f"{name}_{part}").view(-1)
            for part in ("running_mean", "running_var", "weight", "bias")
        ]
        y = F.batch_norm(
            x.reshape(1, -1, x.shape[-1]),
            *flat,
            self.training,
            BATCH_NORM_MOMENTUM,
            BATCH_NORM_EPS,
        )
        return y.view(x.shape)

    @torch.no_grad()
    def constrain(self):
        """Apply the published max-norm constraints to every network."""
        for weight, limit, dims in (
            (self.spatial_weight, SPATIAL_MAX_NORM, (2, 3, 4)),
            (self.dense_weight, DENSE_MAX_NORM, 2),
        ):
            norm = torch.linalg.vector_norm(weight, dim=dims, keepdim=True)
            weight.mul_(limit / norm.clamp_min(limit))


def toeplitz(kernels, n_times):
    """Write same-padded correlations as matrices: x @ M is x filtered.

    Parameters
    ----------
    kernels : Tensor, shape (a, b, k)
    n_times : int

    Returns
    -------
    Tensor, shape (a * b, n_times, n_times)
        M[s, t] = h[s - t + (k - 1) // 2], zero outside the kernel.
    """
    kernels = kernels.flatten(0, 1)
    left = (kernels.shape[-1] - 1) // 2
    # The band as a sequence by s - t, from -(n_times - 1) to n_times - 1; F.pad also crops.
    before = n_times - 1 - left
    band = F.pad(kernels, (before, 2 * n_times - 1 - before - kernels.shape[-1]))
    return band.unfold(-1, n_times, 1).flip(1).transpose(1, 2)


def half_second_architecture(n_channels, n_times, sfreq, dropout=0.25):
    """Give EEGNet-8,2 for any sampling rate, its spans in seconds as published for 128 Hz.

    Temporal filters of 0.5 s, pooling to about 32 Hz, a second filter of 0.5 s, pooling to about
    8 Hz: twice the published rate, so that an epoch of 0.6 s still gives several time points.
    """
    pool1 = max(1, round(sfreq / 32))
    return Architecture(
        n_channels,
        n_times,
        kernel=math.ceil(sfreq / 2),
        kernel_separable=math.ceil(sfreq / pool1 / 2),
        pool1=pool1,
        pool2=4,
        dropout=dropout,
    )
