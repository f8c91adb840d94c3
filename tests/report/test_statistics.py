"""Statistics against values known otherwise."""

import numpy as np
import pytest
from scipy import stats

from rlihf_lib.report.statistics import bootstrap_interval, iqm, paired_test


def test_iqm_is_the_mean_of_the_middle_half():
    assert iqm([100, 1, 2, 3, 4, 5, 6, -100]) == pytest.approx(3.5)
    values = np.random.default_rng(0).normal(size=(11, 3))
    assert np.allclose(iqm(values), stats.trim_mean(values, 0.25))


def test_bootstrap_interval_agrees_with_scipy():
    values = np.random.default_rng(1).gamma(2, size=30)
    low, high = bootstrap_interval(values, n_resamples=20_000)
    known = stats.bootstrap(
        (values,), np.mean, method="percentile", n_resamples=20_000, rng=2
    ).confidence_interval
    assert (low, high) == pytest.approx(known, abs=0.02)


def test_bootstrap_interval_covers_the_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(3)
    hits = 0
    for seed in range(300):
        low, high = bootstrap_interval(rng.normal(size=40), n_resamples=300, seed=seed)
        hits += low <= 0 <= high
    assert 0.90 <= hits / 300 <= 0.98


def test_strata_keep_their_size_so_differences_between_them_do_not_widen_the_interval():
    values = np.array([0.0, 0.1, 10.0, 10.1])
    narrow = bootstrap_interval(values, strata=["a", "a", "b", "b"])
    wide = bootstrap_interval(values)
    assert np.ptp(narrow) <= 0.1 + 1e-9
    assert np.ptp(wide) > 5


def test_one_run_has_no_interval():
    assert np.isnan(bootstrap_interval([1.0])).all()
    assert np.isnan(bootstrap_interval([1.0, 2.0], strata=["a", "b"])).all()
    low, high = bootstrap_interval(np.ones((1, 4)))
    assert low.shape == high.shape == (4,) and np.isnan(low).all()


def test_the_same_data_give_the_same_interval():
    values = np.random.default_rng(4).normal(size=6)
    assert bootstrap_interval(values) == bootstrap_interval(values)


def test_paired_test_agrees_with_scipy_and_knows_its_limits():
    rng = np.random.default_rng(5)
    first, second = rng.normal(0.8, size=9), rng.normal(size=9)
    difference, p = paired_test(first, second)
    known = stats.permutation_test(
        (first, second),
        lambda x, y, axis: np.mean(x - y, axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=np.inf,
    )
    assert difference == pytest.approx((first - second).mean())
    assert p == pytest.approx(known.pvalue)
    assert paired_test([1.0, 2.0], [0.0, 0.0])[1] == 0.5, "two pairs cannot do better"
    _, random_p = paired_test(rng.normal(3, 1, 30), np.zeros(30), n_permutations=2000)
    assert 0 < random_p < 0.01


@pytest.mark.parametrize(("first", "second"), [([1.0], [1.0, 2.0]), ([], [])])
def test_scores_that_are_not_pairs_are_refused(first, second):
    with pytest.raises(ValueError, match="equally long"):
        paired_test(first, second)
