"""Waves, their difference and its size; the table of the simulation's parameters."""

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


@pytest.mark.parametrize("tmin", [-0.2, 0.0])
def test_waves_of_both_classes_are_told_from_what_comes_before_them(tmin):
    planted = epochs(4.0)
    planted.shift_time(tmin, relative=False)
    waves = erp.class_waves(planted, ["Cz"], stop=0.5)
    data = 1e6 * planted.get_data("Cz")[:, 0]
    times = planted.times
    for event, code in (("correct", 1), ("error", 2)):
        wave, mean = waves[event, "Cz"], data[planted.events[:, 2] == code].mean(axis=0)
        mean = mean - mean[times <= 0].mean() * (tmin < 0)
        np.testing.assert_allclose(wave.index, times[times <= 0.5])
        np.testing.assert_allclose(wave, mean[times <= 0.5], atol=1e-9)


def test_peak_over_sd_finds_size_and_latency():
    ratio, latency = erp.peak_over_sd(epochs(4.0))
    assert ratio == pytest.approx(4.0, abs=0.5)
    assert latency == pytest.approx(0.3, abs=0.02)


def test_every_parameter_of_the_simulation_says_where_it_comes_from():
    table = parameter_table()
    assert list(table.index) == [field.name for field in fields(MODEL)]
    assert table["origin"].str.len().min() > 5
