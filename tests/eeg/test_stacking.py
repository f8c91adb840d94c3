"""Linear decoders beside the networks."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

from rlihf_lib.eeg import loso, scores
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.fitting import DecoderSettings
from rlihf_lib.eeg.signals import SubjectEpochs, covariances, inverse_root
from rlihf_lib.eeg.splits import leave_one_subject_out
from rlihf_lib.eeg.stacking import fit_linear, stack
from rlihf_lib.eeg.streaming import replay

SETTINGS = DecoderSettings(max_epochs=3, ensemble=2, n_permutations=10, linear=True)
SUBJECTS = ("s02", "s03", "s04")


@pytest.fixture(scope="module")
def cohort(make_epochs):
    return {subject: make_epochs(seed, n=100) for seed, subject in enumerate(SUBJECTS)}


@pytest.fixture(scope="module")
def finished(cohort, tmp_path_factory):
    folder = tmp_path_factory.mktemp("decoder")
    return folder, loso.run_loso(cohort, folder, SETTINGS, workers=1)


def test_weights_are_those_of_scikit_learn():
    rng = np.random.default_rng(0)
    means, labels = rng.normal(size=(80, 4, 3)), rng.random(80) < 0.4
    means[labels] += 0.5
    weights, bias = fit_linear(means, labels, np.repeat("s02", 80))
    lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto", priors=[0.5, 0.5])
    decisions = lda.fit(means.reshape(80, -1), labels).decision_function(means.reshape(80, -1))
    ours = (means * weights).sum((1, 2)) + bias
    np.testing.assert_allclose(ours, decisions - decisions.mean() + ours.mean(), atol=1e-9)
    between = (ours[labels].mean() + ours[~labels].mean()) / 2
    assert between == pytest.approx(0, abs=1e-9), "the decision lies between the classes"


def test_whitening_is_part_of_the_weights():
    rng = np.random.default_rng(0)
    means, labels = rng.normal(size=(80, 4, 3)), np.arange(80) % 2
    covariance = covariances(rng.normal(size=(10, 4, 50)) * [[1], [2], [3], [4]]).mean(0)
    whitened = inverse_root(covariance) @ means
    expected, bias = fit_linear(whitened, labels, np.repeat("s02", 80))
    weights, same = fit_linear(means, labels, np.repeat("s02", 80), covariance)
    assert same == pytest.approx(bias)
    np.testing.assert_allclose((means * weights).sum((1, 2)), (whitened * expected).sum((1, 2)))


def test_who_makes_many_errors_is_not_learnt():
    rng = np.random.default_rng(0)
    subjects, labels = np.repeat(["s02", "s03"], 200), rng.random(400) < np.repeat([0.1, 0.9], 200)
    means = rng.normal(size=(400, 3, 2))
    means[labels, 0] += 1
    means[subjects == "s03", 1] += 5  # of whom an electrode has an offset
    weights, _ = fit_linear(means, labels, subjects)
    assert np.abs(weights[1]).max() < 0.2 * np.abs(weights[0]).max()


def test_useless_networks_leave_the_word_to_the_linear_decoders(cohort):
    data, _, _ = loso._conditioned(cohort, SETTINGS)
    (fold, *_) = leave_one_subject_out(SUBJECTS, 2)
    parts = [
        pd.DataFrame({"network": n, "subject": s, "label": data[s][1], "prior_log_odds": -0.7})
        for n, people in enumerate(fold.validation)
        for s in people
    ]
    validation = pd.concat(parts, ignore_index=True)
    validation["log_odds"] = np.random.default_rng(0).normal(size=len(validation))
    linear, bias, temperature = stack(validation, fold.training_pool(data))
    means, labels = data[fold.test][2], data[fold.test][1]
    assert scores.auroc((means * linear).sum((1, 2)) + bias, labels) > 0.95
    assert scores.auroc(validation["log_odds"], validation["label"]) > 0.9 and temperature > 1


def test_networks_and_linear_decoders_are_saved_and_streamed_as_one(cohort, finished):
    folder, table = finished
    decoder = Decoder.load(folder / "weights" / "s03.safetensors")
    held_out = SubjectEpochs.from_mne("s03", cohort["s03"])
    log_odds = decoder.log_odds(held_out.signals)
    alone = Decoder(decoder.input_format, decoder.networks).log_odds(held_out.signals)
    means = decoder.input_format.means(held_out.signals)
    linear = (means * decoder.linear).sum((1, 2)) + decoder.bias
    np.testing.assert_allclose(log_odds, alone + linear)
    assert np.abs(linear).max() > 0.1
    streamed, _ = replay(decoder, held_out.signals, chunk=7)
    np.testing.assert_allclose(streamed, log_odds)
    p = pd.read_csv(folder / "p_error.csv", dtype={"subject": str}).query("subject == 's03'")
    np.testing.assert_allclose(p["p_error"], decoder.p_error(held_out.signals), rtol=1e-6)
    assert table["auroc"].min() > 0.9


def test_the_held_out_person_changes_nothing_fitted(cohort, finished, make_epochs, tmp_path):
    folder, _ = finished
    loso.run_loso({**cohort, "s04": make_epochs(99, n=100)}, tmp_path, SETTINGS, workers=1)
    first, second = (Decoder.load(f / "weights" / "s04.safetensors") for f in (folder, tmp_path))
    np.testing.assert_array_equal(first.linear, second.linear)
    assert (first.bias, first.temperature) == (second.bias, second.temperature)


def test_folds_with_and_without_are_told_apart(cohort, finished, monkeypatch):
    folder, _ = finished
    trained, original = [], loso.fit_fold
    monkeypatch.setattr(loso, "fit_fold", lambda *a: trained.append(a) or original(*a))
    loso.run_loso(cohort, folder, SETTINGS, workers=1)
    assert not trained
    without = dataclasses.replace(SETTINGS, linear=False)
    assert "linear" not in loso._told(without), "as in folds that are shipped"
    assert loso._told(SETTINGS) != loso._told(without)
