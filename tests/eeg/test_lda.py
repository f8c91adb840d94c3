"""The classical decoder finds what is planted, nothing in noise, and uses no label it must not."""

from dataclasses import replace

import mne
import numpy as np
import pandas as pd
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.metrics import roc_auc_score

from rlihf_lib.eeg import lda
from rlihf_lib.eeg.fitting import DEFAULTS


def epochs(seed, size, n=200):
    """Correlated noise at five channels; errors add `size` SD at one of them around 0.3 s."""
    rng = np.random.default_rng(seed)
    info = mne.create_info(["A", "B", "C", "D", "E"], 128, "eeg")
    labels = rng.permutation(np.arange(n) % 2)
    mixing = np.eye(5) + 0.8
    signals = np.einsum("ij,njt->nit", mixing, rng.normal(size=(n, 5, 128)))
    time = np.arange(128) / 128
    signals[:, 2] += size * labels[:, None] * np.exp(-0.5 * ((time - 0.3) / 0.05) ** 2)
    events = np.column_stack([np.arange(n), 0 * labels, labels + 1])
    return mne.EpochsArray(
        1e-5 * signals, info, events, event_id={"correct": 1, "error": 2}, verbose="error",
        metadata=pd.DataFrame({"epoch": np.arange(n)}),
    )  # fmt: skip


def across(data, **told):
    return lda.across_subjects(data, **told).set_index("subject")


def within(data):
    return lda.within_subject({"0": data}).iloc[0]


@pytest.mark.parametrize("spatial", [lda.whitening, lda.scaling])
def test_a_planted_response_is_decoded_across_subjects_and_noise_is_not(spatial):
    planted = across({f"{seed}": epochs(seed, 1.5) for seed in range(4)}, spatial=spatial)
    assert planted["auroc"].min() > 0.9 and planted["balanced_accuracy"].min() > 0.8
    noise = across({f"{seed}": epochs(seed, 0.0) for seed in range(4)}, spatial=spatial)
    assert noise["auroc"].mean() == pytest.approx(0.5, abs=0.08)


def test_a_planted_response_is_decoded_within_a_subject_and_noise_is_not():
    assert within(epochs(0, 1.0))["accuracy"] > 0.85
    assert within(epochs(0, 0.0))["auroc"] == pytest.approx(0.5, abs=0.12)


def test_whitening_makes_the_mean_covariance_the_identity():
    signals = epochs(0, 0.0).get_data()
    matrix = lda.whitening(signals)
    covariance = np.mean([np.cov(matrix @ epoch) for epoch in signals], axis=0)
    np.testing.assert_allclose(covariance, np.eye(5), atol=0.02)


@pytest.mark.parametrize("spatial", [lda.whitening, lda.scaling])
def test_across_subjects_no_label_of_the_held_out_person_is_used(spatial):
    data = {f"{seed}": epochs(seed, 0.3) for seed in range(3)}
    honest = across(data, spatial=spatial)["auroc"]
    data["1"].events[:, 2] = 3 - data["1"].events[:, 2]
    assert across(data, spatial=spatial)["auroc"]["1"] == pytest.approx(1 - honest["1"])


def test_within_a_subject_labels_of_a_test_fold_do_not_help():
    """Labels drawn at random, one per tenth of the session, can be had from the fold only."""
    noise = epochs(0, 0.0)
    noise.events[:, 2] = 1 + np.repeat(np.arange(10) % 2, 20)
    assert within(noise)["auroc"] < 0.65


@pytest.mark.parametrize("spatial", [lda.whitening, lda.scaling])
def test_it_is_scikit_learns_lda(spatial):
    data = {f"{seed}": epochs(seed, 0.7) for seed in range(4)}
    table = across(data, spatial=spatial)
    parts = {who: lda.features(who, data[who], DEFAULTS, spatial) for who in data}
    for held_out, (test, labels) in parts.items():
        x, y = (np.concatenate([parts[w][i] for w in data if w != held_out]) for i in (0, 1))
        model = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto").fit(x, y)
        decision = model.decision_function(test)
        assert table.loc[held_out, "auroc"] == pytest.approx(roc_auc_score(labels, decision))
        assert table.loc[held_out, "accuracy"] == pytest.approx(model.score(test, labels))


def test_a_window_before_the_response_is_chance_and_a_shorter_one_knows_no_more():
    data = {f"{seed}": epochs(seed, 0.7) for seed in range(4)}
    table = lda.across_subjects(data, spatial=no_filter, ends=(0.15, 0.4, 1.0, 1.2))
    auroc = table.pivot(index="subject", columns="window", values="auroc")
    assert auroc.columns.tolist() == [0.15, 0.4, 1.0], "there is nothing after 1 s"
    assert auroc[0.15].mean() == pytest.approx(0.5, abs=0.08)
    alone = across(data, settings=replace(DEFAULTS, window=(0.0, 0.4)), spatial=no_filter)
    np.testing.assert_allclose(auroc[0.4], alone["auroc"], atol=1e-12)


def test_windows_end_when_they_say_even_of_epochs_that_begin_later():
    data = {f"{seed}": epochs(seed, 0.7).crop(0.25) for seed in range(3)}
    table = across(data, spatial=no_filter, ends=(0.2, 0.5))
    assert set(table["window"]) == {0.5}, "there is nothing before 0.25 s"
    alone = across(data, settings=replace(DEFAULTS, window=(0.0, 0.5)), spatial=no_filter)
    np.testing.assert_allclose(table["auroc"], alone["auroc"], atol=1e-12)
    np.testing.assert_allclose(across(data)["window"], 1.0)


def no_filter(signals):
    return np.eye(signals.shape[1])
