"""Many EEGNets computed as one, which is why leave-one-subject-out is fast."""

from typing import TYPE_CHECKING, Any

import torch
from torch import nn
from torch.nn import functional as F

from rlihf_lib.eeg import eegnet
from rlihf_lib.eeg.eegnet import Architecture, EEGNet


class EEGNetBatch(nn.Module):
    """`n_networks` independent EEGNets of one architecture, computed as one.

    Every network is exactly an `EEGNet`: the same outputs and the same gradients (a test holds
    them together), for a small part of the cost. Three things make the difference:

    - Temporal and spatial filters commute, so the spatial ones go first and the temporal filter
      sees `D` signals instead of `n_channels`.
    - The first batch normalisation would still need the mean and variance over all temporally
      filtered channels. Both follow from the input alone: with p the patch of samples under a
      filter h, E[y] = h'E[p] and E[y^2] = h'E[pp']h. `patch_moments` computes them per epoch.
    - A convolution of a short signal is a product with a banded (Toeplitz) matrix, and the
      products of all networks are one batched product.

    There is a network for each of the `seeds`, on which alone its initial weights depend. Every
    weight and running statistic of `EEGNet` is here under its own name, stacked over networks.
    """

    if TYPE_CHECKING:  # of what is registered by name

        def __getattr__(self, name: str) -> Any: ...

    def __init__(self, architecture: Architecture, seeds):
        super().__init__()
        self.architecture = architecture
        self.n_networks = len(seeds)
        networks = []
        for seed in seeds:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(seed)
                networks.append(EEGNet(architecture))
        weights, statistics = torch.func.stack_module_state(networks)
        statistics = {n: v for n, v in statistics.items() if not n.endswith("num_batches_tracked")}
        for name, stacked in weights.items():
            self.register_parameter(name.replace(".", "_"), nn.Parameter(stacked))
        for name, stacked in statistics.items():
            self.register_buffer(name.replace(".", "_"), stacked)
        self._names = [*weights, *statistics]

    def network_state(self, index) -> dict[str, torch.Tensor]:
        """State of one network, for `EEGNet.load_state_dict(..., strict=False)`."""
        return {name: getattr(self, name.replace(".", "_"))[index] for name in self._names}

    @torch.no_grad()
    def load_network_states(self, states) -> None:
        """Put back one `network_state` per network."""
        for name in self._names:
            stacked = torch.stack([state[name] for state in states])
            getattr(self, name.replace(".", "_")).copy_(stacked)

    def patch_moments(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """First and second moments of the patches a temporal filter sees in each of some epochs.

        From (n, n_channels, n_times) to (n, kernel) and (n, kernel, kernel).
        """
        kernel = self.architecture.kernel
        left = (kernel - 1) // 2
        patches = F.pad(x, (left, kernel - 1 - left)).unfold(-1, kernel, 1).flatten(1, 2)
        return patches.mean(1), patches.transpose(1, 2) @ patches / patches.shape[1]

    def forward(self, x: torch.Tensor, moments=None) -> torch.Tensor:
        """Logits, shape (n_networks, n, 2), of epochs, shape (n_channels, n_networks, n, n_times).

        `moments`, needed in training mode, are the means over each network's epochs of
        `patch_moments`, shapes (n_networks, kernel) and (n_networks, kernel, kernel).
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
                self.norm1_running_mean.lerp_(mean, eegnet.BATCH_NORM_MOMENTUM)
                self.norm1_running_var.lerp_(variance, eegnet.BATCH_NORM_MOMENTUM)
        else:
            mean, variance = self.norm1_running_mean, self.norm1_running_var
        scale = self.norm1_weight / torch.sqrt(variance + eegnet.BATCH_NORM_EPS)
        return scale, self.norm1_bias - mean * scale

    def _norm(self, name, x):
        """Batch-normalise (n_networks, filters, n * times), each network and filter by itself."""
        parts = ("running_mean", "running_var", "weight", "bias")
        mean, variance, scale, shift = (getattr(self, f"{name}_{part}").view(-1) for part in parts)
        y = F.batch_norm(
            x.reshape(1, -1, x.shape[-1]), mean, variance, scale, shift,
            self.training, eegnet.BATCH_NORM_MOMENTUM, eegnet.BATCH_NORM_EPS,
        )  # fmt: skip
        return y.view(x.shape)

    @torch.no_grad()
    def constrain(self) -> None:
        """Apply the published max-norm constraints to every network."""
        for weight, limit, dims in (
            (self.spatial_weight, eegnet.SPATIAL_MAX_NORM, (2, 3, 4)),
            (self.dense_weight, eegnet.DENSE_MAX_NORM, 2),
        ):
            norm = torch.linalg.vector_norm(weight, dim=dims, keepdim=True)
            weight.mul_(limit / norm.clamp_min(limit))


def toeplitz(kernels, n_times) -> torch.Tensor:
    """Write same-padded correlations as matrices: x @ M is x filtered.

    From kernels h, shape (a, b, k), to M[s, t] = h[s - t + (k - 1) // 2], zero outside the kernel,
    shape (a * b, n_times, n_times).
    """
    kernels = kernels.flatten(0, 1)
    left = (kernels.shape[-1] - 1) // 2
    # The band as a sequence by s - t, from -(n_times - 1) to n_times - 1; F.pad also crops.
    before = n_times - 1 - left
    band = F.pad(kernels, (before, 2 * n_times - 1 - before - kernels.shape[-1]))
    return band.unfold(-1, n_times, 1).flip(1).transpose(1, 2)
