"""Difference waves, confidence band and size; the table of the simulation's parameters."""

from dataclasses import fields

import mne
import numpy as np
import pytest

from rlihf_lib.eeg import erp
from rlihf_lib.eeg.simulated import MODEL, parameter_table


def epochs(shift):
    """200 epochs at Cz; errors are `shift` standard deviations higher around 0.3 s."""
    rng = np.random.default_rng(0)
    info = mne.create_info(["Cz", "EOG1"], 256, ["eeg", "eog"])
    labels = np.arange(200) % 2
    time = np.arange(512) / 256
    slow = np.repeat(rng.normal(0, 1, (200, 2, 1)), 512, axis=2)
    slow[:, 0] += shift * labels[:, None] * np.exp(-0.5 * ((time - 0.3) / 0.05) ** 2)
    events = np.column_stack([np.arange(200), 0 * labels, labels + 1])
    return mne.EpochsArray(
        1e-6 * slow, info, events, event_id={"correct": 1, "error": 2}, verbose="error"
    )


def test_difference_is_error_minus_correct_on_eeg_channels():
    planted = epochs(4.0)
    wave = erp.difference_wave(planted)
    data, labels = planted.get_data("Cz")[:, 0], planted.events[:, 2]
    expected = data[labels == 2].mean(axis=0) - data[labels == 1].mean(axis=0)
    assert wave.ch_names == ["Cz"]
    np.testing.assert_allclose(wave.data[0], expected, atol=1e-12)


def test_peak_over_sd_finds_size_and_latency():
    ratio, latency = erp.peak_over_sd(epochs(4.0))
    assert ratio == pytest.approx(4.0, abs=0.5)
    assert latency == pytest.approx(0.3, abs=0.02)


def test_confidence_band_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(0)
    _, low, high = erp.confidence_band(rng.normal(1.0, 2.0, (6, 4000)))
    assert np.mean((low < 1.0) & (high > 1.0)) == pytest.approx(0.95, abs=0.015)


def test_every_parameter_of_the_simulation_says_where_it_comes_from():
    table = parameter_table()
    assert list(table.index) == [field.name for field in fields(MODEL)]
    assert table["origin"].str.len().min() > 5
