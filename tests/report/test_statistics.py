"""Statistics against values known otherwise."""

from itertools import combinations, product
from math import comb

import numpy as np
import pytest
from scipy import stats

from rlihf_lib.report import statistics as st

RNG = np.random.default_rng(0)


def test_iqm_is_the_mean_of_the_middle_half():
    assert st.iqm([100, 1, 2, 3, 4, 5, 6, -100]) == pytest.approx(3.5)
    values = RNG.normal(size=(11, 3))
    assert np.allclose(st.iqm(values, axis=0), np.sort(values, axis=0)[2:-2].mean(axis=0))


@pytest.mark.parametrize("n", [5, 12])
def test_of_normal_units_the_interval_is_about_as_long_as_students(n):
    means = RNG.normal(size=(n, 300))
    low, high = st.mean_interval(means)
    student = 2 * stats.t.ppf(0.975, n - 1) * stats.sem(means, axis=0)
    assert np.mean((high - low) / student) == pytest.approx(1, abs=0.04)


def test_below_five_units_there_is_no_interval():
    for n in range(1, 5):
        low, high = st.mean_interval(np.arange(n))
        assert np.isnan(low) and np.isnan(high)
    assert np.isfinite(st.mean_interval(np.arange(5))).all()
    low, high = st.mean_interval(np.ones((3, 4)))
    assert low.shape == high.shape == (4,) and np.isnan([low, high]).all()
    people, seeds = RNG.normal(size=(12, 5)), RNG.normal(size=(4, 1))
    assert np.isnan(st.difference(people, seeds, False)["ci_low"])
    assert np.isnan(st.improvement(people, seeds, False)["improvement_low"])
    assert np.isnan(st.spearman([1, 2, 3, 4], [1, 2, 4, 3])["ci_low"])


@pytest.mark.parametrize("value", [0.0, 0.1, 0.9, 1.0])
def test_equal_runs_give_an_interval_without_width(value):
    scores = np.full((12, 5), value)
    for interval in (st.mean_interval(scores), st.iqm_interval(scores)):
        np.testing.assert_allclose(interval, value)
    tested = st.difference(scores, np.full((5, 1), value), paired=False)
    assert (tested["ci_low"], tested["ci_high"]) == pytest.approx((0, 0)) and tested["p"] == 1
    beats = st.improvement(scores, np.full((5, 1), value), paired=False)
    assert set(beats.values()) == {0.5}


def test_the_same_data_give_the_same_interval_within_its_bounds():
    successes = np.array([1, 1, 1, 1, 0.2])
    assert np.array_equal(st.mean_interval(successes), st.mean_interval(successes))
    assert st.mean_interval(successes)[1] > 1
    assert st.mean_interval(successes, (0, 1))[1] == 1


def test_a_run_that_is_missing_is_neither_beaten_nor_averaged():
    ragged = np.arange(24.0).reshape(12, 2)
    ragged[::3, 1] = np.nan
    below = np.full((12, 2), -1.0)
    for paired in (True, False):
        beats = st.improvement(ragged, below, paired)
        assert set(beats.values()) == {1.0}
    low, high = st.iqm_interval(ragged)
    runs = np.sort(ragged[np.isfinite(ragged)])
    assert st.iqm(ragged.ravel()) == pytest.approx(runs[5:-5].mean())
    assert low < st.iqm(ragged.ravel()) < high


def test_people_are_resampled_not_their_seeds():
    alike = np.tile([0.0, 0, 0, 1, 1], (12, 1))
    assert np.ptp(st.mean_interval(alike.mean(axis=1))) == 0, "all people have the same mean"
    assert np.ptp(st.iqm_interval(alike)) == 0


def test_unpaired_p_counts_all_regroupings():
    x, y = np.array([3.1, 2.0, 4.2, 3.3, 5.0]), np.array([2.2, 1.0, 2.9, 0.3, 3.0])
    p, smallest = st.permutation_test(x, y, paired=False)
    pooled = np.concatenate([x, y])

    def gap(rows):
        other = np.delete(pooled, list(rows))
        return pooled[list(rows)].mean() - other.mean()

    # With groups of one size, Welch's t orders the regroupings like the difference of the means.
    gaps = np.array([gap(rows) for rows in combinations(range(10), 5)])
    by_hand = 2 * np.mean(gaps >= gap(range(5)) - 1e-12)
    assert smallest == 2 / 252 == 2 / comb(10, 5)
    assert p == pytest.approx(max(by_hand, stats.ttest_ind(x, y, equal_var=False).pvalue), rel=1e-3)
    apart = st.permutation_test(np.arange(5) + 100.0, np.arange(5), paired=False)
    assert apart == (2 / 252, 2 / 252)


def test_paired_p_counts_all_signs():
    x, y = RNG.normal(0.5, size=12), RNG.normal(size=12)
    p, smallest = st.permutation_test(x, y, paired=True)
    signs = np.array(list(product((1, -1), repeat=12)))
    means = signs @ (x - y) / 12
    assert p == pytest.approx(np.mean(np.abs(means) >= abs((x - y).mean()) - 1e-12))
    assert smallest == 2 / 4096
    assert st.permutation_test(np.full(12, 0.3), np.full(12, 0.1), True) == (2 / 4096, 2 / 4096)


@pytest.mark.parametrize(
    ("n", "m", "paired", "smallest"),
    [
        (1, 1, False, 1.0), (1, 1, True, 1.0), (2, 2, True, 0.5), (2, 2, False, 1 / 3),
        (3, 2, False, 0.2), (5, 5, False, 2 / 252), (5, 5, True, 2 / 32),
        (12, 5, False, 2 / 6188), (12, 12, True, 2 / 4096), (60, 5, False, 2 / 10_000),
    ],
)  # fmt: skip
def test_the_smallest_p_is_what_the_clearest_data_give(n, m, paired, smallest):
    x, y = 1000 + np.linspace(0, 1, n), np.linspace(0, 1, m)
    p, known = st.permutation_test(x, y, paired)
    assert known == pytest.approx(smallest)
    assert p == pytest.approx(smallest)


def test_groups_without_scatter_can_be_compared():
    assert st.permutation_test([1.0] * 12, [0.0] * 5, False)[0] == pytest.approx(2 / 6188)
    assert st.permutation_test([0.1] * 12, [0.1] * 5, False)[0] == 1
    assert st.permutation_test([0.3] * 5, [0.1 * 3] * 5, True)[0] == 1


def test_where_welchs_p_is_larger_than_that_of_the_permutations_it_counts():
    people, seeds = np.ones(12), np.array([0.0, 0, 0, 0, 1])
    welch = stats.ttest_1samp(seeds, 1).pvalue  # which it is where one group doesn't scatter
    assert st.permutation_test(people, seeds, False)[0] == pytest.approx(welch, rel=1e-3)
    assert welch == pytest.approx(0.016, abs=0.001), "4 of 6188 regroupings would be .001"


def test_the_test_errs_as_often_as_it_says():
    def errs(n, m, spread, trials):
        draws = ((RNG.normal(size=n) * spread, RNG.normal(size=m)) for _ in range(trials))
        return np.mean([st.permutation_test(x, y, False)[0] <= 0.05 for x, y in draws])

    assert errs(5, 5, 1, 300) <= 0.08
    assert errs(5, 5, 3, 300) <= 0.08
    # People's means scatter half as much as seeds do: permutation alone errs in .15 of the studies.
    assert errs(12, 5, 0.5, 80) <= 0.10


def test_equivalence_needs_both_sides_within_the_margin():
    close, far = np.linspace(0.93, 0.99, 5), np.linspace(0.73, 0.79, 5)
    p, smallest = st.equivalence_test(close, close[::-1], paired=False)
    assert p == smallest == 1 / 252
    assert st.equivalence_test(far, close, paired=False)[0] > 0.9
    assert st.equivalence_test(close, far, paired=False)[0] > 0.9
    p, _ = st.equivalence_test(close - st.EQUIVALENCE_MARGIN, close, paired=False)
    assert p > 0.4, "at the margin itself nothing is shown"
    people = np.linspace(0, 1, 12)
    assert st.equivalence_test(people, close, paired=False)[0] > 0.05, "scatter shows nothing"


def test_holm_is_as_in_his_paper():
    np.testing.assert_allclose(st.holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(st.holm([0.4, 0.6]), [0.8, 0.8])
    np.testing.assert_allclose(st.holm(np.full(12, 2 / 252)), 24 / 252)


def test_probability_of_improvement_is_mann_whitneys():
    x, y = RNG.integers(0, 5, size=(12, 5)), RNG.integers(0, 4, size=(5, 1))
    beats = st.improvement(x, y, paired=False)
    known = stats.mannwhitneyu(x.ravel(), y.ravel()).statistic / (x.size * y.size)
    assert beats["improvement"] == pytest.approx(known)
    assert beats["improvement_low"] < known < beats["improvement_high"] <= 1
    always = st.improvement(x + 10, y, paired=False)
    assert set(always.values()) == {1}


def test_paired_runs_meet_those_of_the_same_person():
    level = 10.0 * np.arange(12)[:, None]
    x, y = np.add(level, [[1, 2]]), np.add(level, [[0, 0]])
    assert st.improvement(x, y, paired=True)["improvement"] == 1
    assert st.improvement(x, y, paired=False)["improvement"] < 0.6


def test_spearman_agrees_with_scipy_and_finds_what_is_there():
    x = RNG.normal(size=12)
    y = x + RNG.normal(size=12)
    found, known = st.spearman(x, y), stats.spearmanr(x, y)
    assert found["rho"] == pytest.approx(known.statistic)
    assert found["p"] == pytest.approx(known.pvalue, abs=0.03)
    assert found["ci_low"] < found["rho"] < found["ci_high"]
    ordered = st.spearman(np.arange(12), np.arange(12) ** 3)
    assert ordered["rho"] == 1 and ordered["p"] == ordered["smallest_p"] == 2 / 10_000
    assert st.spearman([1, 2, 3], [1, 2, 3])["p"] == pytest.approx(2 / 6)
    assert np.isfinite(list(st.spearman(x, np.ones(12)).values())).all()
