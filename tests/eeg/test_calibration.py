import numpy as np
import pytest

from rlihf_lib.eeg.calibration import (
    expected_calibration_error,
    fit_temperature,
    probability,
    reliability,
)


@pytest.fixture
def honest():
    """Log-odds that mean what they say."""
    rng = np.random.default_rng(0)
    log_odds = rng.normal(0, 1.5, 20_000)
    return log_odds, (rng.random(20_000) < probability(log_odds)).astype(int)


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_the_temperature_undoes_wrong_confidence(honest, factor):
    log_odds, labels = honest
    temperature = fit_temperature(log_odds * factor, labels)
    assert temperature == pytest.approx(factor, rel=0.05)
    before = expected_calibration_error(probability(log_odds * factor), labels)
    after = expected_calibration_error(probability(log_odds * factor, temperature), labels)
    assert after < 0.015
    assert after < before / 4 or factor == 1.0


def test_calibration_error_by_hand():
    p = np.array([0.1, 0.1, 0.9, 0.9])
    assert expected_calibration_error(p, np.array([0, 0, 1, 1])) == pytest.approx(0.1)
    assert expected_calibration_error(p, np.array([1, 1, 0, 0])) == pytest.approx(0.9)
    assert expected_calibration_error(np.full(4, 0.5), np.array([0, 1, 0, 1])) == pytest.approx(0)


def test_reliability_counts_every_epoch_once_even_at_the_ends():
    promised, observed, count = reliability(np.array([0.0, 1.0, 1.0]), np.array([0, 1, 0]))
    assert count.tolist() == [1] + [0] * 8 + [2]
    assert promised[-1] == 1 and observed[-1] == 0.5 and np.isnan(observed[1])
