"""From logits to probabilities that can be taken at their word."""

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import expit


def fit_temperature(log_odds, labels):
    """Find the temperature T with which sigmoid(log-odds / T) has the smallest cross-entropy.

    Guo, Pleiss, Sun, Weinberger (2017), On calibration of modern neural networks, ICML, sec. 4.2.

    Parameters
    ----------
    log_odds : ndarray, shape (n,)
        Of validation epochs: logit of error minus logit of correct.
    labels : ndarray, shape (n,)
        1 = error, 0 = correct.

    Returns
    -------
    float
        Between 0.05 and 20. Above 1 the network was too sure of itself.
    """
    signs = 2 * np.asarray(labels) - 1

    def cross_entropy(log_temperature):
        return np.logaddexp(0, -signs * log_odds * np.exp(-log_temperature)).mean()

    best = minimize_scalar(
        cross_entropy, bounds=(np.log(0.05), np.log(20)), method="bounded", options={"xatol": 1e-6}
    )
    return float(np.exp(best.x))


def probability(log_odds, temperature=1.0):
    """Return p(error) = sigmoid(log-odds / T), Eq. (1) for two classes with temperature T."""
    return expit(np.asarray(log_odds) / temperature)


def reliability(p_error, labels, n_bins=10):
    """Compare what is promised with what is observed, in bins of equal width.

    Parameters
    ----------
    p_error, labels : ndarray, shape (n,)
    n_bins : int

    Returns
    -------
    promised, observed : ndarray, shape (n_bins,)
        Mean p(error) and fraction of errors of each bin; NaN in an empty one.
    count : ndarray, shape (n_bins,)
    """
    bins = np.minimum((np.asarray(p_error) * n_bins).astype(int), n_bins - 1)
    count = np.bincount(bins, minlength=n_bins)
    with np.errstate(invalid="ignore"):
        promised = np.bincount(bins, p_error, n_bins) / count
        observed = np.bincount(bins, labels, n_bins) / count
    return promised, observed, count


def expected_calibration_error(p_error, labels, n_bins=10):
    """Mean distance between promised and observed, weighted by the epochs of each bin.

    Naeini, Cooper, Hauskrecht (2015), AAAI, for the error class; bins as in `reliability`.
    """
    promised, observed, count = reliability(p_error, labels, n_bins)
    filled = count > 0
    return float(np.sum(count[filled] * np.abs(promised - observed)[filled]) / count.sum())
