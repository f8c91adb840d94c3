"""Simulated studies: do 95 % intervals hold the truth in about 95 % of them?"""

import numpy as np
import pytest

from rlihf_lib.report import statistics as st

N = 4000  # studies; the share covered is known to .004


def normal(people_sd, rng, n, seeds):
    """Scores of `n` people: seeds scatter by 1, people by `people_sd`; the true mean is 0."""
    people = rng.normal(size=(N, n, 1)) * people_sd
    return people + rng.normal(size=(N, n, seeds)), 0.0


def bimodal(shape, rng, n, seeds):
    """Late success: a run learns (.8 to 1) or fails (0 to .1), with odds of each person's own."""
    odds = rng.beta(*shape, size=(N, n, 1))
    learns = rng.random((N, n, seeds)) < odds
    level = rng.random((N, n, seeds))
    share = shape[0] / sum(shape)
    return np.where(learns, 0.8 + 0.2 * level, 0.1 * level), 0.9 * share + 0.05 * (1 - share)


STUDIES = [
    *((normal, sd) for sd in (0, 0.5, 1, 2)),
    *((bimodal, shape) for shape in ((2, 2), (0.5, 0.5), (6, 4), (3, 1))),
]


def covered(means, truth, bounds):
    """Share of studies whose interval holds `truth`; many studies are resampled alike at once."""
    hits = []
    for chunk in np.array_split(means, N // 200):
        low, high = st.mean_interval(chunk.T, bounds)
        hits.append((low <= truth) & (truth <= high))
    return np.concatenate(hits).mean()


@pytest.mark.parametrize(("kind", "spread"), STUDIES)
def test_intervals_of_twelve_people_and_five_seeds_cover(kind, spread):
    scores, truth = kind(spread, np.random.default_rng(1), 12, 5)
    bounds = (0, 1) if kind is bimodal else (-np.inf, np.inf)
    assert 0.93 <= covered(scores.mean(axis=2), truth, bounds) <= 0.97


@pytest.mark.parametrize(
    ("kind", "spread"), [(normal, 0), (normal, 2), (bimodal, (2, 2)), (bimodal, (0.5, 0.5))]
)
def test_intervals_of_five_seeds_cover(kind, spread):
    scores, truth = kind(spread, np.random.default_rng(2), 5, 1)
    bounds = (0, 1) if kind is bimodal else (-np.inf, np.inf)
    assert 0.92 <= covered(scores[:, :, 0], truth, bounds) <= 0.97


def test_a_plain_percentile_interval_would_not_cover(monkeypatch):
    scores, truth = normal(0, np.random.default_rng(3), 5, 1)
    monkeypatch.setattr(st.stats.t, "ppf", lambda *_: st.stats.norm.ppf(0.975) * np.sqrt(4 / 5))
    assert covered(scores[:, :, 0], truth, (-np.inf, np.inf)) < 0.88


@pytest.mark.parametrize("seeds_sd", [0.1, 1])
def test_intervals_of_comparisons_cover_at_least(seeds_sd):
    rng = np.random.default_rng(4)
    means = normal(1, rng, 12, 5)[0].mean(axis=2)[:300]
    seeds = rng.normal(size=(300, 5)) * seeds_sd
    low, high = st.interval(lambda i, j: means[:, i].mean(-1) - seeds[:, j].mean(-1), 12, 5)
    assert 0.93 <= np.mean((low <= 0) & (0 <= high))
    scores = normal(1, rng, 12, 5)[0][:150]
    found = [st.improvement(x, y[:, None], False) for x, y in zip(scores, seeds, strict=False)]
    held = [f["improvement_low"] <= 0.5 <= f["improvement_high"] for f in found]
    assert np.mean(held) >= 0.93


def test_intervals_of_the_interquartile_mean_cover():
    scores, truth = normal(1, np.random.default_rng(5), 12, 5)
    intervals = np.array([st.iqm_interval(study) for study in scores[:250]])
    assert np.mean((intervals[:, 0] <= truth) & (truth <= intervals[:, 1])) >= 0.92


@pytest.mark.parametrize("rho", [0, 0.8])
def test_intervals_of_the_correlation_cover(rho, monkeypatch):
    monkeypatch.setattr(st, "PERMUTATIONS", 9)  # p isn't looked at
    rng = np.random.default_rng(6)
    truth = 6 / np.pi * np.arcsin(rho / 2)  # Spearman's of a bivariate normal distribution
    held = []
    for _ in range(400):
        x, y = rng.multivariate_normal([0, 0], [[1, rho], [rho, 1]], size=12).T
        ranks = st.spearman(x, y)
        held.append(ranks["ci_low"] <= truth <= ranks["ci_high"])
    assert np.mean(held) >= 0.92
