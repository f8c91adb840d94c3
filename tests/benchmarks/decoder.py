"""Speed of the decoder: training against braindecode's EEGNet, latency of an event, preprocessing.

The reference network is braindecode's, where it is installed (`HOW_TO_INSTALL`; newer releases
cannot be imported without torchaudio, of which there is no CPU build for our PyTorch), otherwise
the layer sequence that was published, `eegnet.EEGNet`. It sees the recordings' own 256 Hz and is
trained one network at a time, by the very loop that trains ours: same epochs, optimiser, learning
rates, batches, passes and choice of the best pass.
"""

import resource
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import torch
from torch import nn

from rlihf_lib.eeg import preprocessing, recordings, scores
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.eegnet import Architecture, EEGNet, half_second_architecture
from rlihf_lib.eeg.ensemble import EEGNetBatch
from rlihf_lib.eeg.fitting import DEFAULTS, join, train
from rlihf_lib.eeg.hri import SUBJECTS
from rlihf_lib.eeg.loso import recorded_cohort
from rlihf_lib.eeg.signals import InputFormat, SubjectEpochs
from rlihf_lib.eeg.splits import leave_one_subject_out
from rlihf_lib.eeg.streaming import replay

PACKAGES = "braindecode==0.8.1 skorch tabulate docstring_inheritance torchinfo einops"
HOW_TO_INSTALL = f"pip install --no-deps {PACKAGES}"


class Reference(nn.Module):
    """One network of someone else, dressed as an `EEGNetBatch` of one so that `train` trains it."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def patch_moments(self, x):
        """Return nothing in the right shape: this network computes its own batch statistics."""
        return x.new_zeros(len(x), 1), x.new_zeros(len(x), 1)

    def forward(self, x, moments=None):
        """Map (n_channels, 1, n, n_times) to logits (1, n, 2)."""
        return self.network(x[:, 0].transpose(0, 1).contiguous())[None]

    def constrain(self):
        """Apply max-norm constraints; braindecode's network does so by itself."""
        if hasattr(self.network, "constrain"):
            self.network.constrain()

    def network_state(self, index):
        """Return weights and statistics."""
        return self.network.state_dict()

    def load_network_states(self, states):
        """Put them back."""
        self.network.load_state_dict(states[0])


def reference_network(n_channels, n_times):
    """Make braindecode's EEGNet with its default sizes, or the published layers without it.

    Returns
    -------
    network : torch.nn.Module
    name : str
        What it is, for the table.
    """
    try:
        import braindecode
        from braindecode import models
    except ImportError as missing:
        name = f"published layers, braindecode not importable ({missing}); {HOW_TO_INSTALL}"
        return EEGNet(Architecture(n_channels, n_times, dropout=DEFAULTS.dropout)), name
    # Its name up to version 0.8, and since.
    make = getattr(models, "EEGNetv4", None) or models.EEGNet
    network = make(n_chans=n_channels, n_outputs=2, n_times=n_times, drop_prob=DEFAULTS.dropout)
    return network, f"braindecode {braindecode.__version__} {make.__name__}"


def loso_comparison(cohort, held_out=SUBJECTS[:1], settings=DEFAULTS):
    """Train folds of leave-one-subject-out both ways, in turn, on one thread.

    Parameters
    ----------
    cohort : Mapping
        As for `loso.run_loso`.
    held_out : sequence of str
        The folds to train. The more, the less chance there is in the comparison of AUROC.
    settings : fitting.DecoderSettings
        For both. Shorter schedules leave ours behind: a network at 32 Hz needs more of its cheap
        passes than one at 256 Hz.

    Returns
    -------
    dict
        loso_speedup: ratio of training epochs (trials) per second and network, validation
        included, median over folds. loso_auroc, loso_auroc_reference: mean AUROC of single
        networks on the held-out subjects, so that ours aren't helped by being averaged.
        loso_reference: the name of the reference.
    """
    folds = leave_one_subject_out(cohort, settings.ensemble, settings.n_validation)
    epochs = {s: SubjectEpochs.from_mne(s, cohort[s], settings.channels) for s in cohort}
    layout = InputFormat.of(next(iter(epochs.values())), settings.window)
    names, ratios, ours, others = [], [], [], []

    def fast(n_channels, n_times, seeds):
        sizes = half_second_architecture(n_channels, n_times, layout.network_sfreq)
        return EEGNetBatch(sizes, seeds)

    def published(n_channels, n_times, seeds):
        torch.manual_seed(seeds[0])
        network, name = reference_network(n_channels, n_times)
        names.append(name)
        return Reference(network)

    with _one_thread():
        for fold in (fold for fold in folds if fold.test in held_out):
            everybody = range(settings.ensemble)
            rate, auroc = _fit(fast, fold, epochs, layout, everybody, settings)
            slow, expected = _fit(
                published, fold, epochs, replace(layout, decimation=1), [0], settings
            )
            ratios.append(rate / slow)
            ours.append(auroc)
            others.append(expected)
    return {
        "loso_speedup": statistics.median(ratios),
        "loso_auroc": float(np.mean(ours)),
        "loso_auroc_reference": float(np.mean(others)),
        "loso_reference": names[0],
    }


def _fit(make, fold, epochs, layout, members, settings):
    """Train some networks of a fold; return trials per second and mean AUROC when held out."""
    start = time.perf_counter()
    data = {
        subject: (layout.condition(layout.pick(fold_epochs)).astype(np.float32), fold_epochs.labels)
        for subject, fold_epochs in epochs.items()
    }
    joined = join(fold.training_pool(data), members)
    n_channels, _, n_times = joined.x.shape
    networks = make(n_channels, n_times, list(members))
    history = train(networks, joined, list(members), settings)
    n_trials = history["pass"].nunique() * sum(len(part) for part in joined.training)
    rate = n_trials / (time.perf_counter() - start)
    signals, labels = data[fold.test]
    x = torch.from_numpy(signals).transpose(0, 1)[:, None].expand(-1, len(members), -1, -1)
    with torch.no_grad():
        logits = networks.eval()(x.contiguous())
    log_odds = (logits[..., 1] - logits[..., 0]).numpy()
    return rate, np.mean([scores.auroc(decision, labels) for decision in log_odds])


def decode_latency(n_channels=56, n_events=200):
    """Milliseconds from an epoch's last sample to its p(error): median and 99th percentile.

    One thread, 2 s at 256 Hz of which the first is decoded, an ensemble as in the quick profile.

    Returns
    -------
    dict
        decode_ms_median, decode_ms_p99.
    """
    channels = tuple(f"E{i}" for i in range(n_channels))
    layout = InputFormat(channels, 256.0, 0.0, 512, start=0, stop=256, decimation=8)
    n_times = (layout.stop - layout.start) // layout.decimation
    architecture = half_second_architecture(n_channels, n_times, layout.network_sfreq)
    with _one_thread():
        decoder = Decoder(layout, EEGNetBatch(architecture, range(DEFAULTS.ensemble)))
        signals = np.random.default_rng(0).normal(0, 1e-5, (n_events + 10, n_channels, 512))
        milliseconds = 1000 * replay(decoder, signals)[1][10:]  # the first ones warm up
    return {
        "decode_ms_median": float(np.median(milliseconds)),
        "decode_ms_p99": float(np.quantile(milliseconds, 0.99)),
    }


def preprocessing_cost(subjects=SUBJECTS):
    """Seconds and peak memory of preprocessing simulated recordings, in a process of its own.

    Returns
    -------
    dict
        preprocess_s: from the files to the epochs, nothing cached. preprocess_peak_mib: of the
        whole process, libraries included.
    """
    for subject in subjects:
        recordings.recording_path("simulated", subject)  # simulating is not preprocessing
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        return process.submit(_preprocess, subjects).result()


def _preprocess(subjects):
    settings = preprocessing.Preprocessing()
    start = time.perf_counter()
    for subject in subjects:
        preprocessing.cut(*preprocessing.load_continuous("simulated", subject, settings), settings)
    seconds = time.perf_counter() - start
    unit = 2**20 if sys.platform == "darwin" else 2**10  # bytes there, KiB elsewhere
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    return {"preprocess_s": seconds, "preprocess_peak_mib": peak}


@contextmanager
def _one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def measure():
    """Measure all of it on the simulated recordings; yield the keys above with their values."""
    yield from preprocessing_cost().items()
    yield from decode_latency().items()
    yield from loso_comparison(recorded_cohort("simulated", SUBJECTS)).items()
