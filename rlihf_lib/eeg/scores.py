"""What p(error) is worth: how well errors are told, and whether p can be taken at its word.

Every score has its interval over trials and, where there is one, its chance level.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import expit, logit
from scipy.stats import rankdata

CONFIDENCE = 0.95
N_BINS = 10  # of p(error), equally wide, in which promised and observed errors are compared
TEMPERATURES = (0.05, 20.0)  # lowest and highest


def probability(log_odds, temperature=1.0, prior=0.5) -> np.ndarray:
    """p(error), Eq. (1) with temperature T: sigmoid(log-odds / T + logit(prior)).

    The log-odds are the evidence in the EEG, logit of error minus logit of correct, shape (n,);
    the prior is the fraction of errors to expect.
    """
    return expit(np.asarray(log_odds) / temperature + logit(prior))


def fit_temperature(log_odds, labels, prior_log_odds=0.0) -> float:
    """The temperature T, within `TEMPERATURES`, with the smallest cross-entropy of `probability`.

    Of validation epochs (1 = error), each with its log-odds of an error before looking at the EEG.
    Above 1 the network was too sure of itself. Guo, Pleiss, Sun, Weinberger (2017), On calibration
    of modern neural networks, ICML, sec. 4.2.
    """
    signs = 2 * np.asarray(labels) - 1

    def cross_entropy(log_temperature):
        evidence = log_odds * np.exp(-log_temperature)
        return np.logaddexp(0, -signs * (evidence + prior_log_odds)).mean()

    best = minimize_scalar(
        cross_entropy, bounds=np.log(TEMPERATURES), method="bounded", options={"xatol": 1e-6}
    )
    return float(np.exp(best.x))


def reliability(p_error, labels) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each bin of p(error): its mean, the fraction of errors (NaN if empty), the epochs."""
    bins = np.minimum((np.asarray(p_error) * N_BINS).astype(int), N_BINS - 1)
    count = np.bincount(bins, minlength=N_BINS)
    with np.errstate(invalid="ignore"):
        promised = np.bincount(bins, p_error, N_BINS) / count
        observed = np.bincount(bins, labels, N_BINS) / count
    return promised, observed, count


def calibration_error(p_error, labels, prior=0.5) -> float:
    """Mean distance between promised and observed (`reliability`), weighted by the epochs.

    Naeini, Cooper, Hauskrecht (2015), AAAI, for the error class.
    """
    promised, observed, count = reliability(p_error, labels)
    filled = count > 0
    return float(np.sum(count[filled] * np.abs(promised - observed)[filled]) / count.sum())


def accuracy(p_error, labels, prior=0.5) -> float:
    """Fraction of epochs judged right at p(error) > 0.5, Bayes' threshold for calibrated p."""
    return float(np.mean((p_error > 0.5) == labels))


def balanced_accuracy(p_error, labels, prior) -> float:
    """Mean of sensitivity and specificity at p(error) > `prior`.

    With calibrated p and both classes counted alike, Bayes' threshold is the fraction of errors
    among the epochs the decoder was trained on, known before the held-out subject is seen.
    """
    said = p_error > prior
    return float((np.mean(said[labels == 1]) + np.mean(~said[labels == 0])) / 2)


def auroc(p_error, labels, prior=0.5) -> np.ndarray:
    """Area under the receiver operating characteristic: the Mann-Whitney statistic.

    Of `p_error`, shape (n, ...), any scores that are larger for errors; one area for each column.
    """
    n_errors = int(np.sum(labels))
    ranks = rankdata(p_error, axis=0)[labels == 1]
    n_pairs = n_errors * (len(labels) - n_errors)
    return (ranks.sum(axis=0) - n_errors * (n_errors + 1) / 2) / n_pairs


#: All of them take `(p_error, labels, prior)`.
SCORES: dict[str, Callable] = {
    "accuracy_online": accuracy,
    "balanced_accuracy": balanced_accuracy,
    "auroc": auroc,
    "ece": calibration_error,
}


def score(p_error, p_raw, labels, prior, n_resamples, rng) -> dict[str, float]:
    """Score one held-out subject.

    From p(error), calibrated and uncalibrated, of epochs of both classes (1 = error), the fraction
    of errors among the training epochs, and the number of bootstrap resamples (over trials, within
    each class) and label permutations.

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
    drawn = []
    for _ in range(n_resamples):
        rows = np.concatenate([rng.choice(group, len(group)) for group in groups])
        drawn.append([function(p_error[rows], labels[rows], prior) for function in SCORES.values()])
    tails = [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]
    result: dict[str, float] = {}
    for (name, function), values in zip(SCORES.items(), np.transpose(drawn), strict=True):
        result[name] = function(p_error, labels, prior)
        result[f"{name}_low"], result[f"{name}_high"] = np.quantile(values, tails)
    result["ece_raw"] = calibration_error(p_raw, labels)
    result["majority"] = float(max(labels.mean(), 1 - labels.mean()))
    permuted = [rng.permutation(labels) for _ in range(n_resamples)]
    chance = [balanced_accuracy(p_error, shuffled, prior) for shuffled in permuted]
    result["balanced_accuracy_chance"] = float(np.quantile(chance, CONFIDENCE))
    exceeding = sum(auroc(p_error, shuffled) >= result["auroc"] for shuffled in permuted)
    result["auroc_p"] = (1 + exceeding) / (1 + n_resamples)
    return result
