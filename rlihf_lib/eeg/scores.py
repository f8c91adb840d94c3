"""How well errors are told from correct events, with intervals over trials and chance levels."""

import numpy as np
from scipy.stats import rankdata

from rlihf_lib.eeg.calibration import expected_calibration_error

CONFIDENCE = 0.95


def accuracy(p_error, labels, prior=0.5):
    """Fraction of epochs judged right at p(error) > 0.5, Bayes' threshold for calibrated p."""
    return float(np.mean((p_error > 0.5) == labels))


def balanced_accuracy(p_error, labels, prior):
    """Mean of sensitivity and specificity at p(error) > `prior`.

    With calibrated p and both classes counted alike, Bayes' threshold is the fraction of errors
    among the epochs the decoder was trained on, known before the held-out subject is seen.
    """
    said = p_error > prior
    return float((np.mean(said[labels == 1]) + np.mean(~said[labels == 0])) / 2)


def auroc(p_error, labels, prior=0.5):
    """Area under the receiver operating characteristic: the Mann-Whitney statistic.

    Of `p_error`, shape (n, ...), any scores that are larger for errors; one area for each column.
    """
    n_errors = int(np.sum(labels))
    ranks = rankdata(p_error, axis=0)[labels == 1]
    n_pairs = n_errors * (len(labels) - n_errors)
    return (ranks.sum(axis=0) - n_errors * (n_errors + 1) / 2) / n_pairs


def calibration_error(p_error, labels, prior=0.5):
    """See `calibration.expected_calibration_error`."""
    return expected_calibration_error(p_error, labels)


SCORES = {
    "accuracy_online": accuracy,
    "balanced_accuracy": balanced_accuracy,
    "auroc": auroc,
    "ece": calibration_error,
}


def score(p_error, p_raw, labels, prior, n_resamples, rng):
    """Score one held-out subject.

    Parameters
    ----------
    p_error, p_raw : ndarray, shape (n,)
        Calibrated and uncalibrated p(error).
    labels : ndarray, shape (n,)
        1 = error, 0 = correct; both must occur.
    prior : float
        Fraction of errors among the training epochs.
    n_resamples : int
        Bootstrap resamples (over trials, within each class) and label permutations.
    rng : numpy.random.Generator

    Returns
    -------
    dict
        Every score of `SCORES` with `_low` and `_high`, its 95 % percentile interval; `ece_raw`;
        `majority`, the accuracy of always giving the more frequent answer; and, against
        permuted labels, `balanced_accuracy_chance` (the 95th percentile, so that one subject in
        twenty would exceed it by luck) and `auroc_p` (one-sided, (1 + exceeding) / (1 + all)).
    """
    p_error, p_raw, labels = map(np.asarray, (p_error, p_raw, labels))
    groups = [np.flatnonzero(labels == label) for label in (0, 1)]
    drawn = {name: [] for name in SCORES}
    for _ in range(n_resamples):
        rows = np.concatenate([rng.choice(group, len(group)) for group in groups])
        for name, function in SCORES.items():
            drawn[name].append(function(p_error[rows], labels[rows], prior))
    result = {}
    for name, function in SCORES.items():
        result[name] = function(p_error, labels, prior)
        tails = [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]
        result[f"{name}_low"], result[f"{name}_high"] = np.quantile(drawn[name], tails)
    result["ece_raw"] = calibration_error(p_raw, labels)
    result["majority"] = float(max(labels.mean(), 1 - labels.mean()))
    permuted = [rng.permutation(labels) for _ in range(n_resamples)]
    chance = [balanced_accuracy(p_error, shuffled, prior) for shuffled in permuted]
    result["balanced_accuracy_chance"] = np.quantile(chance, CONFIDENCE)
    exceeding = sum(auroc(p_error, shuffled) >= result["auroc"] for shuffled in permuted)
    result["auroc_p"] = (1 + exceeding) / (1 + n_resamples)
    return result
