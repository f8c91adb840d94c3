import dataclasses
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit, logit

from rlihf_lib.eeg import fitting, lda, loso, scores
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.fitting import DecoderSettings
from rlihf_lib.eeg.preprocessing import Preprocessing
from rlihf_lib.eeg.signals import SubjectEpochs, same_power
from rlihf_lib.eeg.splits import leave_one_subject_out
from rlihf_lib.profiles import PROFILES
from rlihf_lib.study import REPOSITORY, Study

SETTINGS = DecoderSettings(
    max_epochs=10, patience=10, ensemble=2, n_permutations=100, n_validation=1, batch_size=16
)
SMOKE = DecoderSettings(**dataclasses.asdict(PROFILES["smoke"].decoder))
SUBJECTS = ["s02", "s03", "s04", "s05"]
PLACES = [os.environ.get("RLIHF_NER2015"), REPOSITORY.parent / "shared" / "eeg" / "ner2015"]
NER = next((Path(place) for place in PLACES if place and Path(place).is_dir()), None)
TABLES = ("scores.csv", "p_error.csv", "training.csv")


def contents(folder):
    files = [folder / name for name in TABLES]
    files += [folder / "weights" / f"{subject}.safetensors" for subject in SUBJECTS]
    return {file.name: file.read_bytes() for file in files}


@pytest.fixture(scope="module")
def dataset(make_epochs):
    return {subject: make_epochs(seed) for seed, subject in enumerate(SUBJECTS)}


@pytest.fixture(scope="module")
def finished(dataset, tmp_path_factory):
    folder = tmp_path_factory.mktemp("decoder")
    loso.run_loso(dataset, folder, SETTINGS, workers=1)
    return folder


def test_a_planted_error_potential_is_decoded(finished):
    scores = pd.read_csv(finished / "scores.csv")
    assert scores["subject"].tolist() == SUBJECTS
    assert scores["auroc"].mean() > 0.85
    assert (scores["auroc_p"] < 0.05).all()
    assert (scores["n_epochs"] == 60).all() and (scores["n_errors"] == 20).all()
    for column in ("accuracy_pretrain", "accuracy_online", "balanced_accuracy", "ece"):
        assert scores[column].between(0, 1).all()


def test_the_table_keeps_raw_and_temperature_scaled_p(finished):
    table = pd.read_csv(finished / "p_error.csv", float_precision="round_trip")
    for subject, rows in table.groupby("subject"):
        decoder = loso.load_decoder(finished, subject)
        evidence = logit(rows["p_error_raw"]) - logit(decoder.prior)
        scaled = expit(evidence / decoder.temperature + logit(decoder.prior))
        np.testing.assert_allclose(rows["p_error"], scaled, atol=1e-6)


def test_a_person_whose_events_are_swapped_is_warned_of_by_name(dataset, tmp_path):
    swapped = dataset["s03"].copy()
    swapped.events[:, 2] = 3 - swapped.events[:, 2]
    with pytest.warns(UserWarning, match=r"subject s03: AUROC 0\.\d+, as if the two events were"):
        scores = loso.run_loso(dataset | {"s03": swapped}, tmp_path, SETTINGS, workers=1)
    assert scores.set_index("subject")["auroc"].idxmin() == "s03"


def test_a_person_whose_labels_are_random_is_warned_of_by_name(dataset, tmp_path):
    random = dataset["s03"].copy()
    random.events[:, 2] = np.random.default_rng(0).permutation(random.events[:, 2])
    with pytest.warns(UserWarning, match=r"subject s03: AUROC 0\.[3-6]\d, no better than chance"):
        loso.run_loso(dataset | {"s03": random}, tmp_path, SETTINGS, workers=1)


def test_pure_noise_is_not_decoded(make_epochs, tmp_path):
    noise = {s: make_epochs(10 + i, amplitude=0.0) for i, s in enumerate(SUBJECTS)}
    scores = loso.run_loso(noise, tmp_path, SETTINGS, workers=1)
    # Standard error of a subject's AUROC with 20 errors of 60 by chance: 0.08.
    assert abs(scores["auroc"].mean() - 0.5) < 0.12
    assert (scores["auroc_p"] < 0.05).sum() <= 1


def test_the_table_holds_every_held_out_epoch_and_equals_the_saved_decoder(finished, dataset):
    table = pd.read_csv(finished / "p_error.csv", float_precision="round_trip")
    for subject, rows in table.groupby("subject"):
        epochs = dataset[subject]
        assert rows["epoch"].tolist() == epochs.metadata["epoch"].tolist()
        assert rows["label"].tolist() == epochs.metadata["label"].tolist()
        decoder = loso.load_decoder(finished, subject)
        offline = decoder.p_error(epochs.get_data(copy=False))
        np.testing.assert_allclose(rows["p_error"], offline, atol=1e-9)


def test_patterns_are_what_the_filters_follow_not_their_weights(finished, dataset):
    decoder = loso.load_decoder(finished, SUBJECTS[0])
    signals = decoder.input_format.pick(SubjectEpochs.from_mne(SUBJECTS[0], dataset[SUBJECTS[0]]))
    temporal, patterns = decoder.patterns(signals)
    state = decoder.networks.network_state(0)
    weights = state["spatial.weight"].detach().numpy()[:, 0, :, 0].reshape(patterns.shape)
    x = decoder.input_format.condition(signals)
    x = np.apply_along_axis(np.convolve, -1, x, temporal[0][::-1], "same")
    x = x.swapaxes(0, 1).reshape(x.shape[1], -1)
    x -= x.mean(axis=1, keepdims=True)
    followed = weights[0, 0] @ x
    regressed = x @ followed / (followed @ followed)
    np.testing.assert_allclose(patterns[0, 0], regressed, rtol=0.05, atol=0.02)
    np.testing.assert_allclose((patterns * weights).sum(axis=-1), 1, atol=1e-6)
    assert not np.allclose(patterns[0, 0], weights[0, 0], atol=0.1)


@pytest.mark.parametrize("poison", ["signals", "labels"])
def test_the_held_out_subject_touches_nothing_of_its_fold(
    poison, finished, dataset, make_epochs, tmp_path
):
    epochs = dataset["s03"].copy()
    if poison == "signals":
        epochs._data = 1e-3 * np.random.default_rng(0).normal(size=epochs._data.shape)
    else:
        epochs.events[:, 2] = 3 - epochs.events[:, 2]
    loso.run_loso(dataset | {"s03": epochs}, tmp_path, SETTINGS, workers=1)
    clean, poisoned = contents(finished), contents(tmp_path)
    # Weights, normalisation statistics, temperature and prior of its own fold, bit by bit ...
    assert poisoned["s03.safetensors"] == clean["s03.safetensors"]
    # ... while it does train the others.
    for other in ("s02", "s04", "s05"):
        assert poisoned[f"{other}.safetensors"] != clean[f"{other}.safetensors"]


def test_the_same_seed_gives_the_same_files_in_worker_processes_too(finished, dataset, tmp_path):
    loso.run_loso(dataset, tmp_path, SETTINGS, workers=2)
    assert contents(tmp_path) == contents(finished)


def test_finished_folds_are_skipped_and_missing_ones_come_out_the_same(
    dataset, finished, tmp_path, monkeypatch
):
    trained = []
    original = loso.fit_fold

    def counting(pool, *args):
        if len(trained) == 2 and not resumed:
            raise KeyboardInterrupt
        trained.append(pool.fold.test)
        return original(pool, *args)

    resumed = False
    monkeypatch.setattr(loso, "fit_fold", counting)
    with pytest.raises(KeyboardInterrupt):
        loso.run_loso(dataset, tmp_path, SETTINGS, workers=1)
    resumed = True
    loso.run_loso(dataset, tmp_path, SETTINGS, workers=1)
    assert trained == SUBJECTS
    assert contents(tmp_path) == contents(finished)
    loso.run_loso(dataset, tmp_path, SETTINGS, workers=1)
    assert trained == SUBJECTS, "finished folds are skipped"


@pytest.fixture
def trained(tmp_path, monkeypatch):
    """Decode, and count the folds that were trained for it."""
    folds, original = [], loso.fit_fold
    monkeypatch.setattr(loso, "fit_fold", lambda *args: folds.append(args) or original(*args))

    def count(data, settings):
        folds.clear()
        loso.run_loso(data, tmp_path, settings, workers=1)
        return len(folds)

    return count


@pytest.mark.parametrize("people", [3, 6, 12])
@pytest.mark.parametrize("n", [100, 300])
def test_few_people_and_epochs_are_decoded_as_well_as_by_lda(make_epochs, people, n):
    """By networks of the sizes of `smoke`, whose first three held-out people are looked at."""
    cohort = {f"s{i:02}": make_epochs(i, amplitude=4e-6, n=n) for i in range(people)}
    data, _, layout = loso._conditioned(cohort, SMOKE)
    aurocs = {}
    for fold in leave_one_subject_out(list(cohort), SMOKE.ensemble)[:3]:
        decoder, *_ = fitting.fit_fold(fold.training_pool(data), layout, SMOKE)
        held_out = SubjectEpochs.from_mne(fold.test, cohort[fold.test])
        aurocs[fold.test] = scores.auroc(decoder.log_odds(held_out.signals), held_out.labels)
    classical = lda.across_subjects(cohort, SMOKE).set_index("subject")["auroc"][[*aurocs]]
    assert np.mean(list(aurocs.values())) > classical.mean() - 0.02
    assert min(aurocs.values()) > 0.85, "no fold comes out near chance"


def test_a_fold_is_trained_anew_when_data_settings_or_weights_change(
    dataset, make_epochs, tmp_path, trained
):
    settings = DecoderSettings(max_epochs=1, ensemble=1, n_permutations=10)
    assert trained(dataset, settings) == 4
    assert trained(dataset, settings) == 0
    (tmp_path / "weights" / "s04.safetensors").unlink()
    assert trained(dataset, settings) == 1
    assert trained(dataset | {"s05": make_epochs(99)}, settings) == 4
    assert trained(dataset, DecoderSettings(max_epochs=1, ensemble=1, n_permutations=11)) == 4


def test_all_folds_are_trained_anew_when_a_person_joins_or_leaves(dataset, trained):
    settings = DecoderSettings(max_epochs=1, ensemble=1, n_permutations=10)
    three = {subject: dataset[subject] for subject in SUBJECTS[:3]}
    assert [trained(people, settings) for people in (three, dataset, three)] == [3, 4, 3]


def test_folds_trained_on_another_processor_are_recognised(finished, dataset, tmp_path, trained):
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    # Of simulated recordings, one sample in a thousand differs by the amplifier's resolution.
    almost, rng = dataset["s05"].copy(), np.random.default_rng(0)
    almost._data += 0.05e-6 * (rng.random(almost._data.shape) < 1e-3)
    assert not np.array_equal(almost._data, dataset["s05"]._data)
    assert trained(dataset | {"s05": almost}, SETTINGS) == 0
    other = dataset["s05"].copy()
    other._data[0] = 1.5 * other._data[1]
    assert trained(dataset | {"s05": other}, SETTINGS) == 4


def test_the_simulated_people_are_those_that_the_shipped_decoders_know():
    folder = Study().decoder / "folds" / "s02"
    shipped = json.loads((folder / "fold.json").read_text())["power"]["s10"]
    epochs = loso.recorded_cohort("simulated", ["s10"])["s10"]
    epochs = SubjectEpochs.from_mne("s10", epochs)
    assert same_power(epochs.power(), shipped)
    assert not same_power(epochs.power(), [power[::-1] for power in shipped])


def test_channels_are_matched_by_name(finished, dataset, make_epochs, tmp_path):
    order = ["C4", "Pz", "Fz", "C3", "Cz"]
    shuffled = dataset | {"s04": dataset["s04"].copy().reorder_channels(order)}
    loso.run_loso(shuffled, tmp_path, SETTINGS, workers=1)
    for file in ("p_error.csv", "s02.safetensors"):
        assert contents(tmp_path)[file] == contents(finished)[file]


def refused(dataset, changed, tmp_path, message):
    with pytest.raises(ValueError, match=message):
        loso.run_loso(dataset | {"s04": changed}, tmp_path, SETTINGS, workers=1)
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]


def test_a_missing_channel_is_refused(dataset, tmp_path):
    changed = dataset["s04"].copy().drop_channels(["Cz"])
    refused(dataset, changed, tmp_path, "s04 lacks the channel.* Cz")


def test_a_channel_only_one_subject_has_is_left_out(finished, dataset, make_epochs, tmp_path):
    extra = make_epochs(7, channels=("Oz", "Fz", "Cz", "Pz", "C3", "C4")).pick(["Oz"])
    more = dataset["s04"].copy()
    more.add_channels([extra])
    loso.run_loso(dataset | {"s04": more}, tmp_path, SETTINGS, workers=1)
    assert contents(tmp_path)["p_error.csv"] == contents(finished)["p_error.csv"]


def test_nan_is_refused(dataset, tmp_path):
    changed = dataset["s04"].copy()
    changed._data[7, 1, 30] = np.nan
    refused(dataset, changed, tmp_path, "s04: NaN or infinity in epoch 7, channel Cz")


def test_another_rate_or_length_is_refused(dataset, make_epochs, tmp_path):
    refused(dataset, make_epochs(2, sfreq=100.0), tmp_path, "s04: epochs at 100 Hz")
    refused(dataset, make_epochs(2, duration=0.5), tmp_path, "64 samples")


def test_a_missing_class_is_refused(dataset, tmp_path):
    changed = dataset["s04"]["correct"]
    refused(dataset, changed, tmp_path, "s04: .*both classes are needed")


def test_a_damaged_decoder_is_refused(finished, tmp_path):
    good = (finished / "weights" / "s02.safetensors").read_bytes()
    path = tmp_path / "s02.safetensors"
    path.write_bytes(good[: len(good) // 2])
    with pytest.raises(ValueError, match=r"s02\.safetensors is not a decoder"):
        Decoder.load(path)
    with pytest.raises(FileNotFoundError, match="run notebook 02"):
        loso.load_decoder(tmp_path, "s03")


def test_results_that_were_edited_are_named_and_not_believed(finished, dataset, tmp_path):
    shutil.copytree(finished, tmp_path / "decoder")
    edited = tmp_path / "decoder" / "folds" / "s03" / "p_error.csv"
    edited.write_text(edited.read_text().replace("0.", "0.9", 1))
    with pytest.raises(ValueError, match=r"s03/p_error.csv is not what was written"):
        loso.run_loso(dataset, tmp_path / "decoder", SETTINGS, workers=1)
    assert loso.run_loso(dataset, tmp_path / "decoder", SETTINGS, 1, recompute=True) is not None
    assert contents(tmp_path / "decoder") == contents(finished)
    weights = tmp_path / "decoder" / "weights" / "s02.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1] + b"x")
    with pytest.raises(ValueError, match=r"decoder/weights/s02.safetensors is not what was writt"):
        loso.load_decoder(tmp_path / "decoder", "s03")
    with pytest.raises(ValueError, match=r"s02.safetensors is not what was .*delete .*folds/s02 "):
        loso.run_loso(dataset, tmp_path / "decoder", SETTINGS, workers=1)


def test_interrupted_retraining_can_be_read_as_unfinished_and_goes_on(
    finished, dataset, tmp_path, monkeypatch
):
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    train, folds = loso.fit_fold, []

    def interrupted(*args):
        folds.append(args)
        if len(folds) == 2:
            raise KeyboardInterrupt
        return train(*args)

    monkeypatch.setattr(loso, "fit_fold", interrupted)
    others = dataclasses.replace(SETTINGS, max_epochs=1)
    with pytest.raises(KeyboardInterrupt):
        loso.run_loso(dataset, tmp_path, others, workers=1)
    with pytest.raises(FileNotFoundError, match="does not exist yet; run notebook 02"):
        loso.load_decoder(tmp_path, "s02")
    loso.run_loso(dataset, tmp_path, others, workers=1)
    assert len(folds) == 5 and loso.load_decoder(tmp_path, "s02")


def test_the_config_says_what_was_run(finished):
    config = json.loads((finished / "config.json").read_text())
    assert config["subjects"] == SUBJECTS
    assert config["settings"]["ensemble"] == 2
    assert config["input_format"]["channels"] == ["Fz", "Cz", "Pz", "C3", "C4"]
    assert set(config["folds"]) == set(SUBJECTS)


@pytest.mark.skipif(NER is None, reason="the NER 2015 epochs are not on this computer")
def test_recorded_error_potentials_are_decoded_across_subjects(tmp_path):
    settings = DecoderSettings(max_epochs=6, ensemble=2, n_permutations=50)
    cohort = loso.recorded_cohort(NER, ["07", "11", "13"])
    scores = loso.run_loso(cohort, tmp_path, settings, workers=1)
    assert scores["auroc"].mean() > 0.6
    assert (scores["auroc_p"] < 0.05).sum() >= 2


def test_a_decoder_for_somebody_to_come_learns_from_everybody(dataset, make_epochs):
    cohort = Held(dataset)
    decoder = loso.train_decoder(cohort, SETTINGS)
    newcomer = make_epochs(20)
    p_error = decoder.p_error(newcomer.get_data())
    assert scores.auroc(p_error, newcomer.metadata["label"].to_numpy()) > 0.85
    assert decoder.band is None
    cohort.settings = Preprocessing(phase="minimum")
    assert loso.train_decoder(cohort, dataclasses.replace(SETTINGS, max_epochs=1)).band == (1, 20)


class Held(dict):
    """A cohort of epochs in memory."""

    settings = Preprocessing()
