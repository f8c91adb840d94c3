"""Shrinkage LDA on spatially whitened 50-ms means: within one person, and across people.

A strong classical decoder, independent of the networks, by which the simulated recordings were
calibrated and can be checked.
"""

import numpy as np
import pandas as pd
from scipy.linalg import eigh
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.metrics import balanced_accuracy_score, roc_auc_score

WINDOW = 0.8  # s after the feedback, as in the published decoding of ErrP-HRI
N_MEANS = 16


def whitening(signals):
    """Symmetric inverse square root of the mean spatial covariance of epochs.

    He & Wu (2020), Transfer learning for brain-computer interfaces: a Euclidean space data
    alignment approach, IEEE Trans. Biomed. Eng. 67, 399-410. It uses no label.

    Parameters
    ----------
    signals : ndarray, shape (n, n_channels, n_times)

    Returns
    -------
    ndarray, shape (n_channels, n_channels)
    """
    covariance = np.mean([np.cov(epoch) for epoch in signals], axis=0)
    power, axes = eigh(covariance)
    # An average reference leaves one direction without power, which must not be blown up.
    return (axes / np.sqrt(power + 1e-3 * power.mean())) @ axes.T


def within_subject(epochs, n_folds=10):
    """Cross-validated decoding of one person, folds contiguous in time.

    Whitening and classifier are fitted on the training folds only.

    Parameters
    ----------
    epochs : mne.BaseEpochs
        With events ``correct`` and ``error``, in the order of time.
    n_folds : int

    Returns
    -------
    dict
        accuracy, balanced_accuracy, auroc.
    """
    signals, labels = _signals(epochs)
    fold = np.arange(len(labels)) * n_folds // len(labels)
    decision = np.empty(len(labels))
    for k in range(n_folds):
        train = fold != k
        means = _means(signals, whitening(signals[train]))
        decision[~train] = _fit(means[train], labels[train]).decision_function(means[~train])
    return _score(decision, labels)


def across_subjects(data):
    """Leave-one-subject-out decoding.

    Every subject is whitened by its own epochs, without labels.

    Parameters
    ----------
    data : dict
        Subject -> mne.BaseEpochs with the same EEG channels.

    Returns
    -------
    pandas.DataFrame
        accuracy, balanced_accuracy, auroc of each held-out subject (index).
    """
    features = {}
    for subject, epochs in data.items():
        signals, labels = _signals(epochs)
        features[subject] = _means(signals, whitening(signals)), labels
    rows = {}
    for test, (means, labels) in features.items():
        pool = [pair for subject, pair in features.items() if subject != test]
        x, y = (np.concatenate(parts) for parts in zip(*pool, strict=True))
        rows[test] = _score(_fit(x, y).decision_function(means), labels)
    return pd.DataFrame.from_dict(rows, orient="index")


def _signals(epochs):
    within = (epochs.times >= 0) & (epochs.times < WINDOW)
    signals = epochs.get_data(picks=sorted(_eeg(epochs)))[..., within]
    return signals, (epochs.events[:, 2] == epochs.event_id["error"]).astype(int)


def _eeg(epochs):
    return [
        n for n, t in zip(epochs.ch_names, epochs.get_channel_types(), strict=True) if t == "eeg"
    ]


def _means(signals, matrix):
    means = [part.mean(axis=-1) for part in np.array_split(signals, N_MEANS, axis=-1)]
    return (matrix @ np.stack(means, axis=-1)).reshape(len(signals), -1)


def _fit(means, labels):
    return LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto").fit(means, labels)


def _score(decision, labels):
    answer = decision > 0
    return {
        "accuracy": float(np.mean(answer == labels)),
        "balanced_accuracy": float(balanced_accuracy_score(labels, answer)),
        "auroc": float(roc_auc_score(labels, decision)),
    }
