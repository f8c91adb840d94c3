"""The shipped results of the 12 simulated subjects are as far from the published as was allowed."""

import pandas as pd
import pytest

from rlihf_lib.eeg import published
from rlihf_lib.eeg.hri import SUBJECTS
from rlihf_lib.study import Study

STUDY = Study()


@pytest.fixture
def scores():
    return pd.read_csv(STUDY.decoder / "scores.csv").set_index("subject")


def test_decoding_across_subjects_spreads_as_published(scores):
    assert tuple(scores.index) == SUBJECTS
    auroc = scores["auroc"]
    assert 0.84 <= auroc.mean() <= 0.90 and 0.06 <= auroc.std() <= 0.11
    assert 0.65 <= auroc.min() <= 0.72 and auroc.max() > 0.96
    assert 0.74 <= scores["balanced_accuracy"].mean() <= 0.81
    assert abs(auroc - pd.Series(published.AUROC)).max() <= 0.04
    assert auroc.idxmin() == pd.Series(published.AUROC).idxmin() == "s10"
    assert "s12" not in published.AUROC and abs(auroc["s12"] - auroc.mean()) <= 0.04


def test_a_classical_decoder_is_as_close_to_the_network_as_published(scores):
    classical = pd.read_csv(STUDY.tables / "classical.csv")
    difference = scores["auroc"].mean() - classical["auroc"].mean()
    assert abs(difference) < 0.02  # published: .868 against .869


def test_waves_are_as_published():
    compared = pd.read_csv(STUDY.tables / "waves_against_published.csv")
    inside = compared["simulated"].between(compared["at_least"], compared["at_most"])
    assert len(compared) == 4 and inside.all()
    wave = pd.read_csv(STUDY.tables / "grand_average.csv")
    for sign, start, stop in published.CZ:
        middle = wave["time"].between(start + 0.02, stop - 0.02)
        assert sign * wave.loc[middle, "Cz"].mean() > 0


def test_the_published_values_are_those_of_the_mean_that_is_published():
    assert pd.Series(published.AUROC).mean() == pytest.approx(0.868, abs=0.003)
    assert pd.Series(published.BALANCED_ACCURACY).mean() == pytest.approx(0.771, abs=0.003)
