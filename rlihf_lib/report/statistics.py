"""Statistics over runs: interquartile mean, stratified bootstrap intervals, paired tests.

The unit is the run (one seed of one condition), never the rollout: rollouts of one policy are not
independent. After Agarwal et al. (2021), "Deep reinforcement learning at the edge of the
statistical precipice", whose library rliable is no longer kept up.
"""

from itertools import product

import numpy as np


def iqm(values, axis=0):
    """Interquartile mean: the mean of the middle half, less moved by a lucky seed than the mean.

    Parameters
    ----------
    values : array_like
        Scores; along `axis` a quarter of them, rounded down, is left out at each end.
    axis : int

    Returns
    -------
    float or ndarray
        `values` reduced along `axis`.
    """
    values = np.sort(np.asarray(values, float), axis=axis)
    n = values.shape[axis]
    cut = n // 4
    return np.take(values, np.arange(cut, n - cut), axis=axis).mean(axis=axis)


def bootstrap_interval(
    values, strata=None, statistic=np.mean, level=0.95, n_resamples=2000, seed=0
):
    """Percentile bootstrap interval over runs, resampled within strata.

    Parameters
    ----------
    values : array_like, shape (n_runs, ...)
        One row per run.
    strata : array_like, shape (n_runs,), optional
        Group of each run, such as its subject. Groups keep their size in every resample, so the
        interval speaks about new seeds, not about new subjects.
    statistic : callable
        `statistic(values, axis=...)`.
    level : float
        Coverage.
    n_resamples : int
    seed : int
        Of the resampling; the same data give the same interval.

    Returns
    -------
    low, high : float or ndarray, shape (...)
        NaN where no stratum has two runs: one run says nothing about its own uncertainty.
    """
    values = np.asarray(values, float)
    strata = np.zeros(len(values)) if strata is None else np.asarray(strata)
    groups = [np.flatnonzero(strata == stratum) for stratum in np.unique(strata)]
    if not groups or max(map(len, groups)) < 2:
        nothing = np.full(values.shape[1:], np.nan)
        return nothing[()], nothing[()]
    rng = np.random.default_rng(seed)
    picks = np.concatenate(
        [rng.choice(group, size=(n_resamples, len(group))) for group in groups], axis=1
    )
    resampled = statistic(values[picks], axis=1)
    tail = (1 - level) / 2
    low, high = np.quantile(resampled, [tail, 1 - tail], axis=0)
    return low, high


def paired_test(first, second, n_permutations=10_000, seed=0):
    """Two-sided paired permutation test: are the differences centred on zero?

    Under the null hypothesis each difference could as well have had the other sign. All sign
    patterns are tried where there are at most `n_permutations`, else that many random ones.

    Parameters
    ----------
    first, second : array_like, shape (n,)
        Scores that belong together pair by pair, such as two conditions at the same seed.
    n_permutations, seed : int

    Returns
    -------
    difference : float
        Mean of first - second.
    p : float
        With n pairs never below 2 / 2**n: two seeds cannot show significance.

    Raises
    ------
    ValueError
        If the shapes differ or there is no pair.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    if first.shape != second.shape or first.ndim != 1 or not first.size:
        raise ValueError(
            f"paired scores have shapes {first.shape} and {second.shape}; "
            "give two equally long, non-empty lists"
        )
    differences = first - second
    n = len(differences)
    if 2**n <= n_permutations:
        signs = np.array(list(product((1, -1), repeat=n)))
        extra = 0
    else:
        signs = np.random.default_rng(seed).choice((1, -1), size=(n_permutations, n))
        extra = 1  # the observed pattern itself, so that p is never 0
    means = np.abs(signs @ differences) / n
    # Sums in another order may differ in the last bits.
    reached = np.sum(means >= abs(differences.mean()) * (1 - 1e-12))
    return differences.mean(), (reached + extra) / (len(signs) + extra)
