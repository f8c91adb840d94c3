import numpy as np
import pytest
from sklearn.metrics import balanced_accuracy_score, roc_auc_score

from rlihf_lib.eeg import scores


@pytest.fixture
def table():
    rng = np.random.default_rng(1)
    labels = (rng.random(300) < 0.3).astype(int)
    return np.round(np.clip(0.3 + 0.25 * labels + rng.normal(0, 0.2, 300), 0, 1), 2), labels


def test_scores_equal_scikit_learns_ties_included(table):
    p, labels = table
    assert scores.auroc(p, labels) == pytest.approx(roc_auc_score(labels, p))
    expected = balanced_accuracy_score(labels, p > 0.3)
    assert scores.balanced_accuracy(p, labels, 0.3) == pytest.approx(expected)
    assert scores.accuracy(p, labels) == pytest.approx(np.mean((p > 0.5) == labels))


def test_intervals_hold_the_score_and_chance_is_below_a_good_decoder(table):
    p, labels = table
    row = scores.score(p, p, labels, 0.3, 300, np.random.default_rng(0))
    for name in ("accuracy_online", "balanced_accuracy", "auroc"):
        assert row[f"{name}_low"] < row[name] < row[f"{name}_high"]
        assert row[f"{name}_high"] - row[f"{name}_low"] < 0.2
    assert 0.5 < row["balanced_accuracy_chance"] < 0.6 < row["balanced_accuracy"]
    assert row["auroc_p"] == pytest.approx(1 / 301)
    assert row["majority"] == pytest.approx(1 - labels.mean())


def test_a_decoder_that_guesses_is_not_significant():
    rng = np.random.default_rng(2)
    p, labels = rng.random(300), (rng.random(300) < 0.3).astype(int)
    row = scores.score(p, p, labels, 0.3, 300, np.random.default_rng(0))
    assert row["auroc_p"] > 0.05
    assert row["auroc_low"] < 0.5 < row["auroc_high"]


def test_the_same_generator_gives_the_same_intervals(table):
    p, labels = table
    first, second = (
        scores.score(p, p, labels, 0.3, 50, np.random.default_rng(3)) for _ in range(2)
    )
    assert first == second


@pytest.fixture
def honest():
    """Log-odds that mean what they say."""
    rng = np.random.default_rng(0)
    log_odds = rng.normal(0, 1.5, 20_000)
    return log_odds, (rng.random(20_000) < scores.probability(log_odds)).astype(int)


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_the_temperature_undoes_wrong_confidence(honest, factor):
    log_odds, labels = honest
    temperature = scores.fit_temperature(log_odds * factor, labels)
    assert temperature == pytest.approx(factor, rel=0.05)
    before = scores.calibration_error(scores.probability(log_odds * factor), labels)
    after = scores.calibration_error(scores.probability(log_odds * factor, temperature), labels)
    assert after < 0.015
    assert after < before / 4 or factor == 1.0


def test_calibration_error_by_hand():
    p = np.array([0.1, 0.1, 0.9, 0.9])
    assert scores.calibration_error(p, np.array([0, 0, 1, 1])) == pytest.approx(0.1)
    assert scores.calibration_error(p, np.array([1, 1, 0, 0])) == pytest.approx(0.9)
    assert scores.calibration_error(np.full(4, 0.5), np.array([0, 1, 0, 1])) == pytest.approx(0)


def test_reliability_counts_every_epoch_once_even_at_the_ends():
    promised, observed, count = scores.reliability(np.array([0.0, 1.0, 1.0]), np.array([0, 1, 0]))
    assert count.tolist() == [1] + [0] * 8 + [2]
    assert promised[-1] == 1 and observed[-1] == 0.5 and np.isnan(observed[1])
