"""Figures of the recordings, from made-up waves and counts."""

import numpy as np
import pandas as pd

from rlihf_lib.report import figures_eeg


def test_bars_add_up_to_all_events():
    counts = pd.DataFrame({"correct": [3, 4], "error": [2, 1], "artefact": [1, 0]}, ["s02", "s03"])
    (ax,) = figures_eeg.trial_counts_figure(counts).axes
    tops = [bar.get_y() + bar.get_height() for bar in ax.containers[-1]]
    assert tops == [6, 5]
    assert ax.get_legend_handles_labels()[1] == ["correct", "error", "dropped: artefact"]
    assert {bar.get_hatch() for bar in ax.containers[2]} == {"//"}


def test_waves_are_in_microvolts_with_their_mean_and_the_published_marks():
    times = np.linspace(0, 0.8, 9)
    waves = np.random.default_rng(0).normal(size=(3, 9)) * 1e-6
    fz, cz = figures_eeg.difference_waves_figure({"Fz": waves, "Cz": waves}, times, True).axes
    mean = fz.lines[-1]
    np.testing.assert_allclose(mean.get_xdata(), 1000 * times)
    np.testing.assert_allclose(mean.get_ydata(), 1e6 * waves.mean(axis=0))
    assert not fz.texts and [text.get_text() for text in cz.texts] == ["+", "−", "+", "−"]


def test_spectra_are_in_decibels():
    spectra = pd.DataFrame({"recorded": [100.0, 10], "preprocessed": [10.0, 1]}, [1.0, 2])
    (ax,) = figures_eeg.spectra_figure(spectra, (1, 20)).axes
    assert [line.get_ydata().tolist() for line in ax.lines] == [[20, 10], [10, 0]]
