"""EEGNet: the published network, layer by layer.

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
    F1: int = 8  # temporal filters
    D: int = 2  # spatial filters per temporal filter
    F2: int = 16  # pointwise filters of the separable convolution
    kernel: int = 64  # samples of a temporal filter: half a second
    kernel_separable: int = 16  # samples of the second one, after the first pooling
    pool1: int = 4
    pool2: int = 8
    dropout: float = 0.25  # published: 0.25 across subjects, 0.5 within

    def __post_init__(self):
        if self.n_times < self.pool1 * self.pool2:
            raise ValueError(
                f"{self.n_times} samples are too few for pooling by {self.pool1} x {self.pool2}; "
                f"give epochs of at least {self.pool1 * self.pool2} samples"
            )


class EEGNet(nn.Module):
    """EEGNet as published, the network the paper decodes error potentials with, Eq. (1).

    The spatial filters keep a norm of at most 1 and the weights of each class one of at most
    0.25: call `constrain` after every optimiser step.
    """

    def __init__(self, architecture: Architecture):
        super().__init__()
        a = self.architecture = architecture
        n = a.F1 * a.D
        self.temporal = nn.Conv2d(1, a.F1, (1, a.kernel), padding="same", bias=False)
        self.norm1 = nn.BatchNorm2d(a.F1, BATCH_NORM_EPS, BATCH_NORM_MOMENTUM)
        self.spatial = nn.Conv2d(a.F1, n, (a.n_channels, 1), groups=a.F1, bias=False)
        self.norm2 = nn.BatchNorm2d(n, BATCH_NORM_EPS, BATCH_NORM_MOMENTUM)
        second = (1, a.kernel_separable)
        self.separable = nn.Conv2d(n, n, second, padding="same", groups=n, bias=False)
        self.pointwise = nn.Conv2d(n, a.F2, 1, bias=False)
        self.norm3 = nn.BatchNorm2d(a.F2, BATCH_NORM_EPS, BATCH_NORM_MOMENTUM)
        self.dense = nn.Linear(a.F2 * (a.n_times // a.pool1 // a.pool2), 2)
        for name, weight in self.named_parameters():
            if weight.dim() > 1:
                nn.init.xavier_uniform_(weight)
            elif name == "dense.bias":
                nn.init.zeros_(weight)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Logits of correct and error, (n, 2), for Eq. (1); of epochs (n, n_channels, n_times)."""
        a = self.architecture
        x = self.norm1(self.temporal(x[:, None]))
        x = F.elu(self.norm2(self.spatial(x)))
        x = F.dropout(F.avg_pool2d(x, (1, a.pool1)), a.dropout, self.training)
        x = F.elu(self.norm3(self.pointwise(self.separable(x))))
        x = F.dropout(F.avg_pool2d(x, (1, a.pool2)), a.dropout, self.training)
        return self.dense(x.flatten(1))

    @torch.no_grad()
    def constrain(self) -> None:
        """Apply the published max-norm constraints."""
        self.spatial.weight.copy_(self.spatial.weight.renorm(2, 0, SPATIAL_MAX_NORM))
        self.dense.weight.copy_(self.dense.weight.renorm(2, 0, DENSE_MAX_NORM))


def half_second_architecture(n_channels, n_times, sfreq, dropout=0.25) -> Architecture:
    """EEGNet-8,2 for any sampling rate, its spans in seconds as published for 128 Hz.

    Temporal filters of 0.5 s, pooling to about 32 Hz, a second filter of 0.5 s, pooling to about
    8 Hz: twice the published rate, so that an epoch of 0.6 s still gives several time points.
    """
    pool1 = max(1, round(sfreq / 32))
    return Architecture(
        n_channels, n_times, kernel=math.ceil(sfreq / 2),
        kernel_separable=math.ceil(sfreq / pool1 / 2), pool1=pool1, pool2=4, dropout=dropout,
    )  # fmt: skip
