"""Figures of the recordings, from made-up waves and counts."""

import numpy as np
import pandas as pd

from rlihf_lib.eeg import published
from rlihf_lib.report import figures_eeg


def test_bars_add_up_to_all_events():
    counts = pd.DataFrame({"correct": [3, 4], "error": [2, 1], "artefact": [1, 0]}, ["s02", "s03"])
    (ax,) = figures_eeg.trial_counts_figure(counts).axes
    tops = [bar.get_y() + bar.get_height() for bar in ax.containers[-1]]
    assert tops == [6, 5]
    assert ax.get_legend_handles_labels()[1] == ["correct", "error", "dropped: artefact"]
    assert {bar.get_hatch() for bar in ax.containers[2]} == {"//"}


def test_both_waves_and_their_difference_are_drawn_and_the_published_intervals(legend):
    times = np.linspace(-0.2, 0.8, 11)
    rows = pd.MultiIndex.from_product([["correct", "error"], ["Fz", "Cz"], times])
    rows.names = ["event", "channel", "time"]
    waves = np.random.default_rng(0).normal(size=(44, 3))
    waves = pd.DataFrame(waves, rows, ["s02", "s03", "s04"])
    fz, cz, below_fz, below_cz = figures_eeg.waves_figure(waves, published.CZ).axes
    error, correct = (waves.loc[event].loc["Cz"] for event in ("error", "correct"))
    lines = legend(cz)
    np.testing.assert_allclose(lines["error"].get_xdata(), 1000 * times)
    np.testing.assert_allclose(lines["error"].get_ydata(), error.mean(axis=1))
    np.testing.assert_allclose(lines["correct"].get_ydata(), correct.mean(axis=1))
    assert lines["error"].get_linestyle() != lines["correct"].get_linestyle()
    people = np.array([line.get_ydata() for line in below_cz.lines[:3]])
    np.testing.assert_allclose(people, (error - correct).T)
    np.testing.assert_allclose(below_cz.lines[3].get_ydata(), people.mean(axis=0))
    assert [t.get_text() for t in below_cz.texts] == ["P143", "N236", "P324", "N445"]
    assert not [*fz.texts, *cz.texts, *below_fz.texts]


def test_spectra_are_in_decibels():
    spectra = pd.DataFrame({"recorded": [100.0, 10], "preprocessed": [10.0, 1]}, [1.0, 2])
    (ax,) = figures_eeg.spectra_figure(spectra, (1, 20)).axes
    assert ax.get_legend_handles_labels()[1][0] == "pass-band, 1 to 20 Hz"
    assert [line.get_ydata().tolist() for line in ax.lines] == [[20, 10], [10, 0]]
