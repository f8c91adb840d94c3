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
leave the range of the data; here the arms of the interval are stretched by the same two factors. In
simulated studies of 12 people and 5 seeds 94 to 96 % of the intervals hold the true mean, of five
seeds 92 to 95 % (not stretched: 90 to 93 % and 83 %; `tests/report/test_coverage.py`). What none
can do: where one in ten fails, five runs often show none that did.

**Tests** permute the units. Beside each p stands the smallest that could come out at their number.
"""

from collections.abc import Callable
from math import comb, factorial

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

#: Fewer people (seeds, where there are no people) give no interval: their runs are shown instead.
MIN_UNITS = 5
LEVEL = 0.95
RESAMPLES = 2000
PERMUTATIONS = 9999  # all of them where there are no more than that
#: Late success rates that differ by less count as equal: one can in ten. Fixed before the runs it
#: is applied to existed. The paper calls .39 "comparable" to .54, so a wider margin would let pass
#: whatever it says; a narrower one asks for more than twelve people can show.
EQUIVALENCE_MARGIN = 0.10
NO_BOUNDS = (-np.inf, np.inf)
PROBABILITY = (0.0, 1.0)
# Of scores scaled to 1. What is equal on paper is equal; who doesn't scatter has a t, too.
DECIMALS, LEAST_SCATTER = 12, 1e-6


def iqm(values: ArrayLike, axis: int = -1) -> np.ndarray:
    """Interquartile mean: a quarter of the runs, rounded down, left out at each end.

    Less moved by one lucky run than the mean (Agarwal et al. 2021, "Deep reinforcement learning at
    the edge of the statistical precipice", NeurIPS). NaN is no run.
    """
    return stats.trim_mean(values, 0.25, axis=axis, nan_policy="omit")


def interval(
    statistic: Callable, *sizes: int, bounds: tuple = NO_BOUNDS, corrected: bool = True
) -> np.ndarray:
    """95 % bootstrap interval, shape (2, ...), of whatever can be computed from numbered units.

    `statistic` gets an array of unit numbers per sample, shape (..., n), its own or resampled ones,
    and reduces the last axis; it can take values within `bounds`. Samples, of `sizes` units each,
    are resampled independently. `corrected` stretches the percentile interval for few units (module
    docstring); with two samples the smaller one's correction is used: 94 to 99 % are covered.

    NaN where a sample has fewer than `MIN_UNITS`. The same data give the same interval, equal data
    one of no width.
    """
    units, n = [np.arange(size) for size in sizes], min(sizes)
    estimate = np.asarray(statistic(*units), float)
    if n < MIN_UNITS:
        return np.full((2, *estimate.shape), np.nan)
    arms = stats.bootstrap(
        units, lambda *picks, axis: statistic(*picks), vectorized=True, method="percentile",
        confidence_level=LEVEL, n_resamples=RESAMPLES, rng=0,
    ).confidence_interval - estimate  # fmt: skip
    if corrected:
        tail = (1 + LEVEL) / 2
        arms *= np.sqrt(n / (n - 1)) * stats.t.ppf(tail, n - 1) / stats.norm.ppf(tail)
    return np.clip(estimate + arms, *bounds)


def mean_interval(means: ArrayLike, bounds: tuple = NO_BOUNDS) -> np.ndarray:
    """Interval of the mean over units, shape (n_units, ...); see `interval`."""
    last = np.moveaxis(np.asarray(means, float), 0, -1)  # where SciPy wants resamples
    return interval(lambda i: last[..., i].mean(-1), last.shape[-1], bounds=bounds)


def iqm_interval(scores: np.ndarray, bounds: tuple = NO_BOUNDS) -> np.ndarray:
    """Interval of the interquartile mean over all runs of the units, shape (n_units, n_seeds)."""
    return interval(lambda i: iqm(scores[i].reshape(*i.shape[:-1], -1)), len(scores), bounds=bounds)


def difference(
    first: np.ndarray, second: np.ndarray, paired: bool, bounds: tuple = NO_BOUNDS
) -> dict[str, float]:
    """Mean of the first units minus mean of the second, with interval and `permutation_test`.

    Of arrays of shape (n_units, n_seeds); `paired` if row by row they are the same people. Returns
    difference, ci_low, ci_high (within `bounds`), p, smallest_p.
    """
    x, y = np.nanmean(first, axis=1), np.nanmean(second, axis=1)
    if paired:
        low, high = mean_interval(x - y, bounds)
    else:
        sizes = len(x), len(y)
        low, high = interval(lambda i, j: x[i].mean(-1) - y[j].mean(-1), *sizes, bounds=bounds)
    found = {"difference": x.mean() - y.mean(), "ci_low": low, "ci_high": high}
    return found | dict(zip(("p", "smallest_p"), permutation_test(x, y, paired), strict=True))


def improvement(first: np.ndarray, second: np.ndarray, paired: bool) -> dict[str, float]:
    """Probability that a run of the first beats a run of the second, ties counting half.

    Agarwal et al. (2021); with paired people a run meets only runs of the same person, a missing
    one (NaN) none. Arguments as in `difference`. Returns improvement, improvement_low,
    improvement_high.
    """
    a, b = first[:, None, :, None], second[None, :, None, :]
    beats = np.nanmean((1 + np.sign(a - b)) / 2, axis=(-2, -1))
    if paired:
        beats = np.diag(beats)
        low, high = mean_interval(beats, PROBABILITY)
    else:
        low, high = interval(
            lambda i, j: beats[i[..., :, None], j[..., None, :]].mean(axis=(-2, -1)), *beats.shape,
            bounds=PROBABILITY,
        )  # fmt: skip
    return {"improvement": beats.mean(), "improvement_low": low, "improvement_high": high}


def permutation_test(
    first: ArrayLike, second: ArrayLike, paired: bool, alternative: str = "two-sided"
) -> tuple[float, float]:
    """Test the difference between the means of two groups of units, shapes (n,) and (m,).

    Paired, each person's difference changes sign. Unpaired, units change groups and Welch's t is
    compared, so that groups may scatter differently (Janssen 1997, Statistics & Probability Letters
    36:9). Of its p and that of Welch's t-test the larger counts: the first alone errs too often
    where the smaller group scatters more (.15 at .05), the second where scores aren't normal. So
    twelve people against five seeds err in .02 to .08 of simulated studies; in .17 only where a
    baseline's seeds fail one time in four, and so often none of five. What isn't honest: to average
    people within each seed and permute seeds errs in .05 to .6, for it takes the people for given;
    to flip signs of each person's difference from the mean baseline, whose luck is common to all.

    Returns p, from all permutations up to `PERMUTATIONS` and random ones beyond, and the smallest p
    that could come out at this number of units.
    """
    x, y = np.asarray(first, float), np.asarray(second, float)
    n, m = len(x), len(y)
    if min(n, m) < 2:
        return 1.0, 1.0
    sides = 2 if alternative == "two-sided" else 1
    smallest = _smallest(2**n if paired else comb(n + m, n), sides)
    scale = np.abs([*x, *y]).max() or 1.0
    groups = (x - y,) if paired else (x - x[0], y - x[0])
    samples = [np.round(group / scale, DECIMALS) for group in groups]

    def welch(*groups, axis=-1):
        a, b = ((g.mean(axis), g.std(axis, ddof=1) + LEAST_SCATTER, g.shape[axis]) for g in groups)
        return stats.ttest_ind_from_stats(*a, *b, equal_var=False, alternative=alternative)

    p = stats.permutation_test(
        samples, np.mean if paired else lambda *groups, axis: welch(*groups, axis=axis).statistic,
        permutation_type="samples" if paired else "independent", vectorized=True,
        alternative=alternative, n_resamples=PERMUTATIONS, rng=0,
    ).pvalue  # fmt: skip
    return float(p if paired else max(p, welch(*samples).pvalue)), smallest


def _smallest(ways, sides):
    return min(1.0, sides / min(ways, PERMUTATIONS + 1))


def equivalence_test(
    first: np.ndarray, second: np.ndarray, paired: bool, margin: float = EQUIVALENCE_MARGIN
) -> tuple[float, float]:
    """Two one-sided tests that the means differ by less than `margin`; as `permutation_test`.

    Schuirmann (1987), J. Pharmacokinetics and Biopharmaceutics 15:657. A small p says equivalent; a
    large one, not shown.
    """
    low = permutation_test(first + margin, second, paired, "greater")
    high = permutation_test(first - margin, second, paired, "less")
    return max(low, high)


def holm(p: ArrayLike) -> np.ndarray:
    """Holm's correction: p of every test of a family such that any error has the stated level."""
    p = np.asarray(p, float)
    order, n = np.argsort(p), np.isfinite(p).sum()  # NaN, which is last, is no test
    corrected = np.maximum.accumulate(p[order] * np.arange(n, n - len(p), -1)).clip(max=1)
    return corrected[np.argsort(order)]


def spearman(x: ArrayLike, y: ArrayLike) -> dict[str, float]:
    """Rank correlation over people, with bootstrap interval and permutation test.

    The plain percentile interval covers 95 to 98 % at twelve people, so it is not stretched. Where
    all are equal, also in a resample, there is no correlation. Returns rho, ci_low, ci_high (NaN
    below `MIN_UNITS`), p, smallest_p, n.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    n = len(x)

    def rho(i):
        a, b = (stats.rankdata(values[i], axis=-1) - (n + 1) / 2 for values in (x, y))
        scale = np.sqrt((a**2).sum(-1) * (b**2).sum(-1))
        return (a * b).sum(-1) / np.where(scale > 0, scale, 1)

    low, high = interval(rho, n, bounds=(-1, 1), corrected=False)
    found, p = float(rho(np.arange(n))), 1.0
    if found:
        method = stats.PermutationMethod(n_resamples=PERMUTATIONS, rng=0)
        p = stats.pearsonr(stats.rankdata(x), stats.rankdata(y), method=method).pvalue
    smallest = _smallest(factorial(n), 2)
    return {"rho": found, "ci_low": low, "ci_high": high, "p": p, "smallest_p": smallest, "n": n}
