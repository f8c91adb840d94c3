"""Shrinkage LDA on 50-ms means: the classical decoder, across people and within one.

Blankertz, Lemm, Treder, Haufe, Müller (2011), Single-trial analysis and classification of ERP
components, NeuroImage 56, 814-825. It shares nothing with the networks: by it the simulated
recordings were calibrated, and beside it networks show what they are worth.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.linalg import solve
from threadpoolctl import threadpool_limits

from rlihf_lib.eeg.fitting import DEFAULTS
from rlihf_lib.eeg.scores import auroc, balanced_accuracy
from rlihf_lib.eeg.signals import (
    STEP,
    InputFormat,
    SubjectEpochs,
    averaged,
    covariances,
    inverse_root,
)
from rlihf_lib.eeg.splits import leave_one_subject_out
from rlihf_lib.files import write_csv

N_FOLDS = 10  # within a subject
ENDS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # of windows, s after the feedback
FILTERS = ("forward and backward", "causal")  # of `windows_csv`


def scaling(signals) -> np.ndarray:
    """One over the standard deviation of each channel, as a diagonal matrix; see `whitening`."""
    return np.diag(1 / signals.std(axis=(0, 2)))


def whitening(signals) -> np.ndarray:
    """Symmetric inverse square root of the mean spatial covariance of epochs, without labels.

    He & Wu (2020), Transfer learning for brain-computer interfaces: a Euclidean space data
    alignment approach, IEEE Trans. Biomed. Eng. 67, 399-410.
    """
    return inverse_root(covariances(signals).mean(axis=0))


@threadpool_limits.wrap(limits=1)  # of matrices this small, two threads make a detour
def across_subjects(cohort, settings=DEFAULTS, spatial=whitening, ends=()) -> pd.DataFrame:
    """Decode every subject by what all others teach, leave-one-subject-out, as `loso.run_loso`.

    `spatial`, `whitening` or `scaling`, makes the spatial filters of a subject from all of the
    subject's epochs, without labels. That is more than the networks get, which see nothing of the
    held-out subject but the epoch to decode; LDA needs it. What an earlier answer costs is told by
    windows that end sooner, at `ends` (s after the feedback), as far as the epochs reach; without
    any it is the window of the settings. Columns of the table are subject, window (its end),
    accuracy, balanced_accuracy and auroc.

    Notes
    -----
    The means of a shorter window are the first of a longer one's, and so are their moments, of
    which classifiers are made in a tenth of the time that scikit-learn needs.
    """
    people = {}
    for subject in cohort:
        signals, labels, width, first = _window(subject, cohort[subject], settings)
        means = _flat((spatial(signals) @ averaged(signals, width)).transpose(0, 2, 1))
        people[subject] = [_summed(means[labels == label]) for label in (0, 1)]
    n_channels, rate = signals.shape[1], cohort[subject].info["sfreq"]
    longest = means.shape[1] // n_channels
    counts = {end: round((end - first) * rate) // width for end in ends}
    counts = {end: n for end, n in counts.items() if 0 < n <= longest}
    rows = []
    for fold in leave_one_subject_out(list(cohort)):
        pool = fold.training_pool(people).values()
        classes = [_moments([person[label] for person in pool], n_channels) for label in (0, 1)]
        test = np.concatenate([x for x, *_ in people[fold.test]])
        labels = np.repeat([0, 1], [len(x) for x, *_ in people[fold.test]])
        for end, n in (counts or {first + longest * width / rate: longest}).items():
            weights, bias = _linear(classes, n, n_channels)
            scores = _score(fold.test, test[:, : len(weights)] @ weights + bias, labels)
            rows.append({"subject": fold.test, "window": end, **scores})
    return pd.DataFrame(rows)


def windows_csv(cohort, settings, causal, found, own, recompute=False) -> Path:
    """Path of a table of `across_subjects` at `ENDS`, by the filter: a kept one, or one made anew.

    Filters are "forward and backward", of the cohort, and "causal", of the same people's recordings
    filtered so (`loso.recorded_cohort`), None where there are no recordings. To filter anew takes
    a minute, so the table `found` is kept if, by its AUROC to 0.001, it is of this cohort; else the
    table is written to `own`.
    """
    now, kept = across_subjects(cohort, settings, ends=ENDS), Path(found)
    if kept.is_file() and not recompute:
        table = pd.read_csv(kept, dtype={"subject": str})
        then = table[table["filter"] == FILTERS[0]]
        same = then["subject"].tolist() == now["subject"].tolist()
        if same and np.allclose(then["auroc"], now["auroc"], atol=0.001):
            return kept
    tables = {FILTERS[0]: now}
    if causal is not None:
        tables[FILTERS[1]] = across_subjects(causal, settings, ends=ENDS)
    write_csv(own, pd.concat(tables, names=["filter"]).reset_index("filter"))
    return Path(own)


def _linear(classes, n, n_channels):
    """Weights and bias of LDA on the first n means of each channel, from `_moments`."""
    size, total = n * n_channels, sum(count for count, *_ in classes)
    covariance = sum(
        count / total * _shrunk(square[:size, :size], fourth[n - 1], count)
        for count, _, square, fourth in classes
    )
    (n_correct, correct, *_), (n_error, error, *_) = classes
    weights = solve(covariance, (error - correct)[:size], assume_a="pos")
    return weights, np.log(n_error / n_correct) - weights @ (error + correct)[:size] / 2


def features(subject, epochs, settings, spatial) -> tuple[np.ndarray, np.ndarray]:
    """50-ms means that `across_subjects` decodes, (n, n_channels * n_means), and labels, (n,)."""
    signals, labels, width, _ = _window(subject, epochs, settings)
    return _flat(spatial(signals) @ averaged(signals, width)), labels


def _summed(x):
    """Epochs of a class, and what their moments are made of."""
    return x, x.sum(axis=0), x.T @ x


def _moments(parts, n_channels):
    """Of a class: number of epochs, mean, covariance; sum of |z|^4 by the length of the window.

    z is the epoch, each feature standardised.
    """
    count = sum(len(x) for x, *_ in parts)
    mean = sum(total for _, total, _ in parts) / count
    covariance = sum(square for *_, square in parts) / count - np.outer(mean, mean)
    sd, fourth = np.sqrt(np.diag(covariance)), 0.0
    for x, *_ in parts:
        squares = np.square((x - mean) / sd).reshape(len(x), -1, n_channels).sum(axis=2)
        fourth = fourth + np.square(squares.cumsum(axis=1)).sum(axis=0)
    return count, mean, covariance, fourth


def _shrunk(covariance, fourth, count):
    """Ledoit and Wolf's shrinkage of standardised features, as scikit-learn's "auto"."""
    variance = np.diag(covariance)
    square = np.sum(covariance**2 / np.outer(variance, variance))
    distance = square - len(covariance)
    share = min((fourth / count - square) / count, distance) / distance
    return (1 - share) * covariance + share * np.diag(variance)


@threadpool_limits.wrap(limits=1)
def within_subject(cohort, settings=DEFAULTS) -> pd.DataFrame:
    """Cross-validated decoding of each person, by folds contiguous in time.

    Whitening and classifier are fitted on the training folds only; epochs are in the order of time.
    Columns are subject, accuracy, balanced_accuracy and auroc.
    """
    rows = []
    for subject in cohort:
        signals, labels, width, _ = _window(subject, cohort[subject], settings)
        means, each = averaged(signals, width), covariances(signals)
        n_channels, n_means = means.shape[1:]
        fold = np.arange(len(labels)) * N_FOLDS // len(labels)
        decision = np.zeros(len(labels))
        for k in range(N_FOLDS):
            train = fold != k
            if np.bincount(labels[train], minlength=2).min() < 2:
                continue  # nothing to learn from: undecided
            x = _flat((inverse_root(each[train].mean(axis=0)) @ means).transpose(0, 2, 1))
            split = (x[train & (labels == label)] for label in (0, 1))
            classes = [_moments([_summed(own)], n_channels) for own in split]
            weights, bias = _linear(classes, n_means, n_channels)
            decision[~train] = x[~train] @ weights + bias
        rows.append(_score(subject, decision, labels))
    return pd.DataFrame(rows)


def _window(subject, epochs, settings):
    """Signals in the window, channels by name; labels; samples that make one mean; its start, s."""
    taken = SubjectEpochs.from_mne(subject, epochs, settings.channels)
    layout = InputFormat.of(taken, settings.window)
    signals = layout.pick(taken)[:, np.argsort(layout.channels), layout.start : layout.stop]
    return signals, taken.labels, round(STEP * layout.sfreq), layout.offset / layout.sfreq


def _flat(means):
    return means.reshape(len(means), -1)


def _score(subject, decision, labels):
    return {
        "subject": subject,
        "accuracy": float(np.mean((decision > 0) == labels)),
        "balanced_accuracy": balanced_accuracy(decision, labels, 0),
        "auroc": auroc(decision, labels),
    }
