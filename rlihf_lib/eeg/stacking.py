"""Linear decoders beside the networks, each weighted by what it gives people it did not train on.

Two shrinkage LDAs on 50-ms means, of the EEG as it is and of whitened EEG, make other mistakes than
the networks do. Wolpert (1992), Stacked generalization, Neural Networks 5, 241-259; weights are not
negative, after Breiman (1996), Stacked regressions, Machine Learning 24, 49-64.
"""

import numpy as np
import pandas as pd
from scipy.optimize import minimize
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from threadpoolctl import threadpool_limits

from rlihf_lib.eeg.signals import covariances, inverse_root

LEAST = 0.05  # weight of the networks, relative to their spread


@threadpool_limits.wrap(limits=1)  # of matrices this small, two threads make a detour
def fit_linear(means, labels, subjects, covariance=None) -> tuple[np.ndarray, float]:
    """Weights (n_channels, k) and bias of a shrinkage LDA on means (n, n_channels, k).

    With a spatial covariance, it is fitted to means that this whitens. Every subject is centred
    between its two classes, so that what is learnt is not who makes many errors; the bias expects
    the centre of a new person where that of the others is on average.
    """
    spatial = np.eye(means.shape[1]) if covariance is None else inverse_root(covariance)
    x = (spatial @ means).reshape(len(means), -1)
    who, names = pd.factorize(subjects)
    people = [who == number for number in range(len(names))]
    centres = [(x[p & (labels == 1)].mean(0) + x[p & (labels == 0)].mean(0)) / 2 for p in people]
    lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto", priors=[0.5, 0.5])
    lda.fit(x - np.array(centres)[who], labels)
    bias = float(lda.intercept_[0] - lda.coef_[0] @ np.mean(centres, axis=0))
    return spatial.T @ lda.coef_[0].reshape(means.shape[1:]), bias


def stack(validation: pd.DataFrame, pool) -> tuple[np.ndarray, float, float]:
    """Linear weights and bias to be added to the networks' log-odds, and the temperature of all.

    From `fitting._validate`'s table, what each network gives the people who validate it, whose
    log-odds become those of all decoders together, and a `splits.TrainingPool` whose subjects have
    epochs, labels and `InputFormat.means`.
    """
    spatial = {subject: covariances(pool[subject][0]).mean(axis=0) for subject in pool}
    columns = np.empty((len(validation), 3))
    columns[:, 0] = validation["log_odds"]
    for network, people in enumerate(pool.fold.validation):
        fitted = _fit_both(pool, spatial, pool.fold.training(network))
        for subject in people:
            rows = (validation["network"] == network) & (validation["subject"] == subject)
            for column, (weights, bias) in enumerate(fitted, start=1):
                columns[rows, column] = (pool[subject][2] * weights).sum((1, 2)) + bias
    scale = columns.std(axis=0)
    signs = 2 * validation["label"].to_numpy() - 1
    offsets = validation["prior_log_odds"].to_numpy()

    def cross_entropy(weights):
        return np.logaddexp(0, -signs * (columns / scale @ weights + offsets)).mean()

    bounds = [(LEAST, None), (0, None), (0, None)]
    weights = minimize(cross_entropy, np.full(3, 0.3), bounds=bounds).x / scale
    temperature = float(1 / weights[0])
    validation["log_odds"] = temperature * columns @ weights
    parts = zip(temperature * weights[1:], _fit_both(pool, spatial, tuple(pool)), strict=True)
    linear, bias = zip(*((w * linear, w * bias) for w, (linear, bias) in parts), strict=True)
    return sum(linear), float(sum(bias)), temperature


def _fit_both(pool, spatial, people):
    """Fit to some people of a pool, as it is and whitened."""
    labels, means = (np.concatenate([pool[s][part] for s in people]) for part in (1, 2))
    subjects = np.repeat(people, [len(pool[subject][1]) for subject in people])
    covariance = np.mean([spatial[subject] for subject in people], axis=0)
    return fit_linear(means, labels, subjects), fit_linear(means, labels, subjects, covariance)
