"""Speed of the decoder: training against the published network, and latency of a decoded event.

The reference is braindecode's EEGNet as a layer sequence with its default sizes (`eegnet.EEGNet`),
in a plain PyTorch loop. braindecode 1.8 itself cannot be imported without torchaudio, of which
there is no CPU build for our PyTorch.
"""

import statistics
import time

import numpy as np
import torch
from torch.nn import functional as F

from rlihf_lib.eeg.dataset import EEG_CHANNELS
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.eegnet import Architecture, EEGNet, EEGNetBatch, half_second_architecture
from rlihf_lib.eeg.fitting import DEFAULTS, DecoderSettings, train
from rlihf_lib.eeg.signals import InputFormat
from rlihf_lib.eeg.streaming import replay

SFREQ = 256.0
N_TIMES = 512  # 2 s, of which the first is decoded


def input_format(n_channels=27):
    """Format of the ErrP-HRI epochs, or of epochs with another number of channels."""
    channels = tuple(f"E{i}" for i in range(n_channels))
    return InputFormat(channels, SFREQ, 0.0, N_TIMES, start=0, stop=int(SFREQ), decimation=8)


def loso_speedup(repeats=3, n_epochs=1024):
    """Ratio of training epochs (trials) per second and network, one thread each.

    Both sides train on the same trials, by the same optimiser and batch size: ours all networks of
    a fold with validation, exactly as `fitting.fit_fold` does, the reference one network without
    validation, at the recordings' own 256 Hz. Median of alternating repeats.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return statistics.median(_ours(n_epochs) / _reference() for _ in range(repeats))
    finally:
        torch.set_num_threads(threads)


def _ours(n_epochs, n_passes=3):
    layout = input_format()
    rng = np.random.default_rng(0)
    signals = rng.normal(0, 1e-5, (n_epochs, len(layout.channels), N_TIMES))
    settings = DecoderSettings(max_epochs=n_passes)
    seeds = list(range(settings.ensemble))
    start = time.perf_counter()
    x = torch.from_numpy(layout.condition(signals).astype(np.float32)).transpose(0, 1).contiguous()
    y = torch.from_numpy(rng.integers(0, 2, n_epochs))
    networks = EEGNetBatch(
        half_second_architecture(x.shape[0], x.shape[2], layout.network_sfreq), seeds
    )
    rows = [torch.arange(n_epochs)] * len(seeds)
    validation = [torch.arange(n_epochs // 10)] * len(seeds)
    train(networks, x, y, torch.zeros(n_epochs), rows, validation, seeds, settings)
    return n_epochs * n_passes * len(seeds) / (time.perf_counter() - start)


def _reference(n_batches=3):
    network = EEGNet(Architecture(len(EEG_CHANNELS), int(SFREQ)))
    optimizer = torch.optim.Adam(network.parameters(), lr=DEFAULTS.learning_rate)
    generator = torch.Generator().manual_seed(0)
    size = DEFAULTS.batch_size
    x = torch.randn(size, len(EEG_CHANNELS), int(SFREQ), generator=generator)
    y = torch.randint(2, (size,), generator=generator)
    start = time.perf_counter()
    for _ in range(n_batches):
        optimizer.zero_grad()
        F.cross_entropy(network(x), y).backward()
        optimizer.step()
        network.constrain()
    return size * n_batches / (time.perf_counter() - start)


def decode_latency(n_channels=56, n_events=200):
    """Milliseconds from an epoch's last sample to its p(error): median and 99th percentile.

    One thread, 256 Hz, an ensemble as in the quick profile.

    Returns
    -------
    dict
        decode_ms_median, decode_ms_p99.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        layout = input_format(n_channels)
        n_times = (layout.stop - layout.start) // layout.decimation
        architecture = half_second_architecture(n_channels, n_times, layout.network_sfreq)
        decoder = Decoder(layout, EEGNetBatch(architecture, range(DEFAULTS.ensemble)))
        signals = np.random.default_rng(0).normal(0, 1e-5, (n_events + 10, n_channels, N_TIMES))
        milliseconds = 1000 * replay(decoder, signals)[1][10:]  # the first ones warm up
    finally:
        torch.set_num_threads(threads)
    return {
        "decode_ms_median": float(np.median(milliseconds)),
        "decode_ms_p99": float(np.quantile(milliseconds, 0.99)),
    }


def measure(repeats=3):
    """Measure all of it; return loso_speedup, decode_ms_median, decode_ms_p99."""
    return {"loso_speedup": loso_speedup(repeats), **decode_latency()}
