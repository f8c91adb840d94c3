"""Statistics over runs: intervals that cover what they say, tests that can reach significance.

What was drawn at random are people and, for each, seeds; a run is one seed of one condition for one
person. Rollouts of one policy are not independent and never count. *Units* (`evaluations.units`)
are an array with a row per person (per run where a condition knows no person, or one) and a column
per seed.

**Intervals** resample people and keep each one's runs together. For the mean that is the bootstrap
of a hierarchy that has the right variance; drawing seeds anew within the people drawn would count
the scatter of seeds twice (Davison & Hinkley 1997, "Bootstrap methods and their application", 3.8;
Ren et al. 2010, J. Applied Statistics 37:1487). That seeds share placements over people is left
out: seeds count as nested. Percentile intervals of few units are too narrow: the resampled variance
lacks the factor n / (n - 1), its quantiles are the normal distribution's, not Student's (Hesterberg
2015, The American Statistician 69:371). He makes up for both by quantiles further out, which can't
leave the range of the data: with five seeds 91 % are covered. Here the arms of the percentile
interval are stretched by the same two factors. In simulated studies of 12 people and 5 seeds 94 to
96 % of the intervals hold the true mean, whether people differ more than seeds or less, whether
scores are normal or runs either learn or fail (not stretched: 90 to 93 %); of five seeds 92 to 95 %
(83 % of normal scores); see
`tests/report/test_coverage.py`. What no interval can do: where one in ten fails, five runs often
show none that did.

**Tests** permute the units. Beside each p stands the smallest that could come out at their number.
"""

from math import comb, factorial

import numpy as np
from scipy import stats

#: Fewer people (seeds, where there are no people) give no interval: their runs are shown instead.
MIN_UNITS = 5
LEVEL = 0.95
RESAMPLES = 2000
PERMUTATIONS = 9999  # all of them where there are no more than that
#: Late success rates that differ by less count as equal: one can in ten. Fixed before the runs it
#: is applied to existed. The paper calls .39 "comparable" to .54, .15 less, so a wider margin would
#: let pass whatever it says; a narrower one asks for more than twelve people can show.
EQUIVALENCE_MARGIN = 0.10


def iqm(values, axis=-1):
    """Interquartile mean: a quarter of the runs, rounded down, left out at each end.

    Less moved by one lucky run than the mean (Agarwal et al. 2021, "Deep reinforcement learning at
    the edge of the statistical precipice", NeurIPS).
    """
    return stats.trim_mean(values, 0.25, axis=axis)


def interval(statistic, *sizes, bounds=(-np.inf, np.inf), corrected=True):
    """95 % bootstrap interval of whatever can be computed from numbered units.

    Parameters
    ----------
    statistic : callable
        Gets an array of unit numbers per sample, shape (..., n), and reduces the last axis: the
        samples' own units, or resampled ones.
    *sizes : int
        Units of each sample, which are resampled independently of each other.
    bounds : tuple of float
        Values the statistic can take.
    corrected : bool
        Stretch the percentile interval for few units (module docstring). With two samples the
        smaller one's correction is used: 94 to 99 % are covered.

    Returns
    -------
    low, high : ndarray
        Shaped like `statistic`; NaN where a sample has fewer than `MIN_UNITS`. The same data give
        the same interval, equal data one of no width.
    """
    units = [np.arange(size) for size in sizes]
    estimate = np.asarray(statistic(*units), float)
    n = min(sizes)
    if n < MIN_UNITS:
        return np.full((2, *estimate.shape), np.nan)
    resampled = stats.bootstrap(
        units,
        lambda *picks, axis: statistic(*picks),
        vectorized=True,
        method="percentile",
        confidence_level=LEVEL,
        n_resamples=RESAMPLES,
        rng=0,
    ).confidence_interval
    tail = (1 + LEVEL) / 2
    stretch = np.sqrt(n / (n - 1)) * stats.t.ppf(tail, n - 1) / stats.norm.ppf(tail)
    arms = np.array(resampled) - estimate
    return np.clip(estimate + arms * (stretch if corrected else 1.0), *bounds)


def mean_interval(means, bounds=(-np.inf, np.inf)):
    """Interval of the mean over units, shape (n_units, ...); see `interval`."""
    means = np.asarray(means, float)
    # Resamples come last, as SciPy wants them.
    return interval(lambda i: np.moveaxis(means, 0, -1)[..., i].mean(-1), len(means), bounds=bounds)


def iqm_interval(scores, bounds=(-np.inf, np.inf)):
    """Interval of the interquartile mean over all runs of the units, shape (n_units, n_seeds)."""
    return interval(lambda i: iqm(scores[i].reshape(*i.shape[:-1], -1)), len(scores), bounds=bounds)


def difference(first, second, paired, bounds=(-np.inf, np.inf)):
    """Mean of the first minus mean of the second, with interval and permutation test.

    Parameters
    ----------
    first, second : ndarray, shape (n_units, n_seeds)
    paired : bool
        Row by row the same people.
    bounds : tuple of float
        Of the difference.

    Returns
    -------
    dict
        difference, ci_low, ci_high, p, smallest_p; see `permutation_test`.
    """
    x, y = np.nanmean(first, axis=1), np.nanmean(second, axis=1)
    if paired:
        low, high = mean_interval(x - y, bounds)
    else:
        low, high = interval(
            lambda i, j: x[i].mean(-1) - y[j].mean(-1), len(x), len(y), bounds=bounds
        )
    p, smallest = permutation_test(x, y, paired)
    return {
        "difference": x.mean() - y.mean(), "ci_low": low, "ci_high": high,
        "p": p, "smallest_p": smallest,
    }  # fmt: skip


def improvement(first, second, paired):
    """Probability that a run of the first beats a run of the second, ties counting half.

    Agarwal et al. (2021); with paired people a run meets only runs of the same person. Arguments as
    in `difference`.

    Returns
    -------
    dict
        improvement, improvement_low, improvement_high.
    """
    a, b = first[:, None, :, None], second[None, :, None, :]
    beats = ((a > b) + 0.5 * (a == b)).mean(axis=(-2, -1))
    if paired:
        beats = np.diag(beats)
        low, high = mean_interval(beats, (0, 1))
    else:
        low, high = interval(
            lambda i, j: beats[i[..., :, None], j[..., None, :]].mean(axis=(-2, -1)),
            *beats.shape,
            bounds=(0, 1),
        )
    return {
        "improvement": beats.mean(), "improvement_low": low, "improvement_high": high
    }  # fmt: skip


def permutation_test(first, second, paired, alternative="two-sided"):
    """Test the difference between the means of two groups of units.

    Paired, each person's difference changes sign. Unpaired, units change groups and Welch's t is
    compared, so that groups may scatter differently (Janssen 1997, Statistics & Probability Letters
    36:9). Of its p and that of Welch's t-test the larger counts: the first alone errs too often
    where the smaller group scatters more (.15 at .05), the second where scores aren't normal. So
    twelve people against five seeds err in .02 to .08 of simulated studies; in .17 only where a
    baseline's seeds fail one time in four, and so often none of five. What isn't honest: to average
    people within each seed and permute seeds errs in .05 to .6, for it takes the people for given;
    to flip signs of each person's difference from the mean baseline, whose luck is common to all.

    Parameters
    ----------
    first, second : array_like, shape (n_units,)
    paired : bool
    alternative : {"two-sided", "less", "greater"}

    Returns
    -------
    p, smallest : float
        The second: what p would be at this number of units if the data were as extreme as can be.
        All permutations up to `PERMUTATIONS`, random ones beyond.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    n, m = len(first), len(second)
    if min(n, m) < 2:
        return 1.0, 1.0
    count = 2**n if paired else comb(n + m, n)
    sides = 2 if alternative == "two-sided" else 1
    smallest = min(1.0, sides / min(count, PERMUTATIONS + 1))
    # Rounded, so that what is equal on paper is equal.
    scale = np.abs([*first, *second]).max() or 1.0
    if paired:
        samples = (np.round((first - second) / scale, 12),)
    else:
        samples = [np.round((group - first[0]) / scale, 12) for group in (first, second)]
    p = stats.permutation_test(
        samples,
        np.mean if paired else lambda *groups, axis: _welch(*groups, axis).statistic,
        permutation_type="samples" if paired else "independent",
        alternative=alternative,
        vectorized=True,
        n_resamples=PERMUTATIONS,
        rng=0,
    ).pvalue
    return float(p if paired else max(p, _welch(*samples, 0, alternative).pvalue)), smallest


def _welch(x, y, axis, alternative="two-sided"):
    """Welch's t-test of scores up to 1 in size; groups without scatter count as having a little."""
    groups = [(s.mean(axis), s.std(axis, ddof=1) + 1e-6, s.shape[axis]) for s in (x, y)]
    return stats.ttest_ind_from_stats(
        *groups[0], *groups[1], equal_var=False, alternative=alternative
    )


def equivalence_test(first, second, paired, margin=EQUIVALENCE_MARGIN):
    """Two one-sided tests that the means differ by less than `margin`.

    Schuirmann (1987), J. Pharmacokinetics and Biopharmaceutics 15:657.

    Returns
    -------
    p, smallest : float
        A small p says equivalent; a large one, not shown.
    """
    first = np.asarray(first, float)
    low = permutation_test(first + margin, second, paired, "greater")
    high = permutation_test(first - margin, second, paired, "less")
    return max(low, high)


def holm(p):
    """Holm's correction: p of every test of a family such that any error has the stated level."""
    p = np.asarray(p, float)
    order = np.argsort(p)
    corrected = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)).clip(max=1)
    return corrected[np.argsort(order)]


def spearman(x, y):
    """Rank correlation over people, with bootstrap interval and permutation test.

    The plain percentile interval covers 95 to 98 % at twelve people, so it is not stretched. A
    resample in which all are equal counts as no correlation.

    Returns
    -------
    dict
        rho, ci_low, ci_high (NaN below `MIN_UNITS`), p, smallest_p, n.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    n = len(x)

    def rho(i):
        ranks = stats.rankdata(x[i], axis=-1), stats.rankdata(y[i], axis=-1)
        a, b = (r - r.mean(-1, keepdims=True) for r in ranks)
        scale = np.sqrt((a**2).sum(-1) * (b**2).sum(-1))
        return (a * b).sum(-1) / np.where(scale > 0, scale, 1)

    low, high = interval(rho, n, bounds=(-1, 1), corrected=False)
    smallest = min(1.0, 2 / min(factorial(n), PERMUTATIONS + 1))
    ranks = stats.rankdata(y)
    p = stats.permutation_test(
        (stats.rankdata(x),),
        lambda a, axis: (a * ranks).sum(axis=axis),
        permutation_type="pairings",
        vectorized=True,
        n_resamples=PERMUTATIONS,
        rng=0,
    ).pvalue if n > 1 else 1.0  # fmt: skip
    return {
        "rho": float(rho(np.arange(n))), "ci_low": low, "ci_high": high,
        "p": p, "smallest_p": smallest, "n": n,
    }  # fmt: skip
