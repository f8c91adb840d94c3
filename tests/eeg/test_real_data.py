"""Recorded error potentials, where they are at hand."""

import os
from pathlib import Path

import pytest

from rlihf_lib.eeg import loso
from rlihf_lib.eeg.fitting import DecoderSettings

REPOSITORY = Path(__file__).resolve().parents[2]
PLACES = [os.environ.get("RLIHF_NER2015"), REPOSITORY.parent / "shared" / "eeg" / "ner2015"]
FOLDER = next((Path(place) for place in PLACES if place and Path(place).is_dir()), None)


@pytest.mark.skipif(FOLDER is None, reason="the NER 2015 epochs are not on this computer")
def test_recorded_error_potentials_are_decoded_across_subjects(tmp_path):
    settings = DecoderSettings(max_epochs=6, ensemble=2, n_permutations=50)
    cohort = loso.recorded_cohort(FOLDER, ["07", "11", "13"])
    scores = loso.run_loso(cohort, tmp_path, settings, workers=1)
    assert scores["auroc"].mean() > 0.6
    assert (scores["auroc_p"] < 0.05).sum() >= 2
