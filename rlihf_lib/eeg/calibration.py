"""From logits to probabilities that can be taken at their word."""

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import expit, logit


def fit_temperature(log_odds, labels, prior_log_odds=0.0):
    """Find the temperature T with which `probability` has the smallest cross-entropy.

    Guo, Pleiss, Sun, Weinberger (2017), On calibration of modern neural networks, ICML, sec. 4.2.

    Parameters
    ----------
    log_odds : ndarray, shape (n,)
        Of validation epochs: logit of error minus logit of correct.
    labels : ndarray, shape (n,)
        1 = error, 0 = correct.
    prior_log_odds : ndarray, shape (n,)
        Log-odds of an error before looking at the EEG.

    Returns
    -------
    float
        Between 0.05 and 20. Above 1 the network was too sure of itself.
    """
    signs = 2 * np.asarray(labels) - 1

    def cross_entropy(log_temperature):
        evidence = log_odds * np.exp(-log_temperature)
        return np.logaddexp(0, -signs * (evidence + prior_log_odds)).mean()

    best = minimize_scalar(
        cross_entropy, bounds=(np.log(0.05), np.log(20)), method="bounded", options={"xatol": 1e-6}
    )
    return float(np.exp(best.x))


def probability(log_odds, temperature=1.0, prior=0.5):
    """Return p(error), Eq. (1) with temperature T and the errors to expect.

    Parameters
    ----------
    log_odds : ndarray, shape (n,)
        Evidence of an error in the EEG: logit of error minus logit of correct.
    temperature : float
    prior : float
        Fraction of errors to expect.

    Returns
    -------
    ndarray, shape (n,)
        sigmoid(log-odds / T + logit(prior)).
    """
    return expit(np.asarray(log_odds) / temperature + logit(prior))


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
