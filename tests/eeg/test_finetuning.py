import numpy as np
import pytest

from rlihf_lib.eeg import finetuning, loso
from rlihf_lib.eeg.fitting import DecoderSettings

SUBJECTS = ["s02", "s03", "s04"]
SETTINGS = DecoderSettings(max_epochs=4, ensemble=1, n_permutations=10, batch_size=16)


@pytest.fixture(scope="module")
def dataset(make_epochs):
    return {subject: make_epochs(seed, n=90) for seed, subject in enumerate(SUBJECTS)}


@pytest.fixture(scope="module")
def folder(dataset, tmp_path_factory):
    folder = tmp_path_factory.mktemp("decoder")
    loso.run_loso(dataset, folder, SETTINGS, workers=1)
    return folder


def test_fine_tuning_learns_the_events_it_gets_and_leaves_the_decoder_alone(folder, dataset):
    decoder = loso.load_decoder(folder, "s02")
    signals = dataset["s02"].get_data(copy=False)
    flipped = 1 - dataset["s02"].metadata["label"].to_numpy()
    before = decoder.p_error(signals)

    def loss(p):
        return -np.mean(np.log(np.where(flipped == 1, p, 1 - p)))

    adapted = finetuning.fine_tune(decoder, signals, flipped, learning_rate=1e-3)
    assert loss(adapted.p_error(signals)) < loss(before) - 0.02
    np.testing.assert_array_equal(decoder.p_error(signals), before)


def test_no_update_is_the_decoder_itself_and_all_are_scored_on_the_same_later_events(
    folder, dataset
):
    updates = finetuning.online_update(dataset, folder, SETTINGS, counts=(0, 10, 30))
    assert updates["n_events"].tolist() == [0, 10, 30] * 3
    assert (updates["n_scored"] == 60).all()
    labels = dataset["s03"].metadata["label"].to_numpy()[30:]
    p = loso.load_decoder(folder, "s03").p_error(dataset["s03"].get_data(copy=False)[30:])
    row = updates[(updates["subject"] == "s03") & (updates["n_events"] == 0)].iloc[0]
    assert row["accuracy"] == pytest.approx(np.mean((p > 0.5) == labels))


def test_scored_events_do_not_touch_the_update(folder, dataset, monkeypatch):
    seen = []
    original = finetuning.fine_tune

    def spying(decoder, signals, labels):
        seen.append(signals.copy())
        return original(decoder, signals, labels)

    monkeypatch.setattr(finetuning, "fine_tune", spying)
    finetuning.online_update({"s02": dataset["s02"]}, folder, SETTINGS, counts=(0, 10, 30))
    expected = dataset["s02"].get_data(copy=False)
    assert [len(signals) for signals in seen] == [10, 30]
    for signals in seen:
        np.testing.assert_array_equal(signals, expected[: len(signals)])


def test_too_few_events_to_score_are_refused(folder, dataset):
    with pytest.raises(ValueError, match="fine-tune on fewer"):
        finetuning.online_update(dataset, folder, SETTINGS, counts=(0, 90))


def test_short_recordings_are_updated_on_fewer_events():
    assert finetuning.feasible_counts(480) == (0, 20, 50, 100)
    assert finetuning.feasible_counts(60) == (0, 20)
    assert finetuning.feasible_counts(10) == (0,)
