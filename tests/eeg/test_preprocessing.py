"""From recordings to labelled epochs."""

import os
from pathlib import Path

import mne
import numpy as np
import pytest

from rlihf_lib.eeg import hri, loso, preprocessing, recordings, simulated
from rlihf_lib.eeg.preprocessing import (
    Cohort,
    Preprocessing,
    load_continuous,
    load_epochs,
    load_events,
    prepare,
)

CAUSAL = Preprocessing(phase="minimum")
NER = Path(os.environ.get("RLIHF_NER2015", "/work/shared/eeg/ner2015"))


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Two simulated blocks of s03, preprocessed, in a cache of their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hri, "N_BLOCKS", 2)
        patch.setenv("RLIHF_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


def recording(tmp_path, monkeypatch, data, events):
    """Serve one recording as subject s02 of `hri`."""
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "s02_cursor.set"
    simulated.write_set(path, data, [(at * 256 + 1, name) for at, name in events])
    monkeypatch.setattr(recordings, "recording_path", lambda eeg, subject: path)
    return path


def trial(at, outcome, feedback="FB1"):
    return [(at - 0.5, "S  1"), (at - 0.1, "R  1"), (at, feedback), (at + 0.01, outcome)]


def noise(seconds):
    return np.random.default_rng(0).normal(0, 10, (30, int(seconds * 256))).astype(np.float32)


def test_epochs_are_two_seconds_from_the_onset_on(cache):
    epochs = load_epochs("simulated", "s03")
    assert epochs.info["sfreq"] == 256
    assert epochs.get_data().shape[1:] == (30, 512)
    assert epochs.tmin == 0
    assert epochs.event_id == {"correct": 1, "error": 2}
    assert epochs.get_channel_types().count("eeg") == 27
    labels = epochs.metadata["label"].to_numpy()
    np.testing.assert_array_equal(epochs.events[:, 2] - 1, labels)
    assert 0 < labels.sum() < len(labels)


def test_the_continuous_signal_holds_the_epochs_bit_for_bit(cache):
    epochs = load_epochs("simulated", "s03")
    raw, events = load_continuous("simulated", "s03")
    kept = events[events["status"] == "kept"]
    assert kept["epoch"].tolist() == epochs.metadata["epoch"].tolist()
    data = raw.get_data()
    for epoch, first in zip(epochs.get_data(), kept["sample"], strict=True):
        np.testing.assert_array_equal(epoch, data[:, first : first + 512])


def test_the_window_can_start_before_the_feedback(cache):
    epochs = load_epochs("simulated", "s03")
    longer = load_epochs("simulated", "s03", Preprocessing(before=0.2))
    assert longer.tmin == -51 / 256 and longer.metadata.equals(epochs.metadata)
    np.testing.assert_array_equal(longer.get_data()[..., 51:], epochs.get_data())
    raw, _ = load_continuous("simulated", "s03")
    first = epochs.metadata["sample"][0]
    np.testing.assert_array_equal(longer.get_data()[0], raw.get_data()[:, first - 51 : first + 512])


def test_a_second_call_gives_the_cached_epochs(cache, monkeypatch):
    first = load_epochs("simulated", "s03")
    monkeypatch.setattr(preprocessing, "load_continuous", None)
    second = load_epochs("simulated", "s03")
    np.testing.assert_array_equal(first.get_data(), second.get_data())
    assert first.metadata.equals(second.metadata)
    with pytest.raises(TypeError):  # other settings are another entry of the cache
        load_epochs("simulated", "s03", Preprocessing(h_freq=15.0))


def test_cohorts_of_the_same_people_are_prepared_by_one_reading(cache, monkeypatch):
    settings = [Preprocessing(l_freq=0.5), Preprocessing(l_freq=0.5, before=0.1)]
    cohorts, read = [Cohort("simulated", ["s03"], s) for s in settings], []
    original = recordings.read_recording
    monkeypatch.setattr(recordings, "read_recording", lambda *a: read.append(a) or original(*a))
    prepare(cohorts, workers=1)
    assert len(read) == 1
    monkeypatch.setattr(preprocessing, "load_continuous", None)  # from the cache, from now on
    prepare(cohorts, workers=1)
    assert cohorts[1]["s03"].tmin < cohorts[0]["s03"].tmin == 0


def test_every_feedback_is_accounted_for(cache):
    events = load_events("simulated", "s03")
    assert events["epoch"].tolist() == list(range(100))
    assert events["block"].tolist() == [0] * 50 + [1] * 50
    assert set(events["status"]) <= {"kept", "artefact", "human error"}
    assert (events["status"] == "kept").sum() == len(load_epochs("simulated", "s03"))


def test_the_band_is_1_to_20_hz_and_the_phase_zero(tmp_path, monkeypatch):
    time = np.arange(60 * 256) / 256
    waves = {"Fz": 0.1, "Cz": 8.0, "Pz": 40.0}  # Hz
    data = np.zeros((30, len(time)), np.float32)
    for name, frequency in waves.items():
        data[hri.CHANNELS.index(name)] = 10 * np.sin(2 * np.pi * frequency * time)
    recording(tmp_path, monkeypatch, data, trial(10, "S  4") + trial(20, "S  6"))
    raw, _ = load_continuous("hri", "s02", Preprocessing(reference="recorded"))
    middle = slice(20 * 256, 40 * 256)
    out = {name: raw.get_data(name)[0, middle] * 1e6 for name in waves}
    assert np.abs(out["Fz"]).max() < 0.2  # of 10 uV
    assert np.abs(out["Pz"]).max() < 0.02
    np.testing.assert_allclose(out["Cz"], 10 * np.sin(2 * np.pi * 8 * time[middle]), atol=0.1)


def test_average_reference_is_over_eeg_channels_only(cache):
    epochs = load_epochs("simulated", "s03")
    assert np.abs(epochs.get_data(picks="eeg").mean(axis=1)).max() < 1e-10
    kept = load_epochs("simulated", "s03", Preprocessing(reference="recorded"))
    np.testing.assert_array_equal(epochs.get_data("EOG1")[0], kept.get_data("EOG1")[0])


def test_labels_follow_the_outcome_of_the_same_trial(tmp_path, monkeypatch):
    outcomes = ["S  4", "S  6", "S  5", "S  4", "S  6"]
    events = [event for i, name in enumerate(outcomes) for event in trial(5 + 4 * i, name, "FB2")]
    events.insert(2, events.pop(3))  # the outcome may also come before the feedback
    recording(tmp_path, monkeypatch, noise(30), events)
    table = load_events("hri", "s02")
    assert table["label"].tolist() == [0, 1, -1, 0, 1]
    assert table["status"].tolist() == ["kept", "kept", "human error", "kept", "kept"]
    assert load_epochs("hri", "s02").metadata["epoch"].tolist() == [0, 1, 3, 4]


def test_feedback_without_an_outcome_is_dropped(tmp_path, monkeypatch):
    events = trial(5, "S  4") + trial(9, "S  6")[:-1] + trial(13, "S  6")
    recording(tmp_path, monkeypatch, noise(20), events)
    assert load_events("hri", "s02")["status"].tolist() == ["kept", "no outcome", "kept"]


def test_a_window_past_the_end_of_the_data_is_dropped(tmp_path, monkeypatch):
    events = trial(5, "S  4") + trial(9, "S  6") + trial(18.5, "S  6")
    recording(tmp_path, monkeypatch, noise(20), events)
    assert load_events("hri", "s02")["status"].tolist() == ["kept", "kept", "past the end"]


def test_artefacts_are_dropped_by_eeg_amplitude_and_keep_the_numbering(tmp_path, monkeypatch):
    data = noise(20)
    burst = 300 * np.sin(2 * np.pi * 4 * np.arange(256) / 256)
    data[hri.CHANNELS.index("C4"), 9 * 256 : 10 * 256] += burst
    data[hri.CHANNELS.index("EOG1"), 13 * 256 : 14 * 256] += burst
    events = trial(5, "S  4") + trial(9, "S  6") + trial(13, "S  6")
    recording(tmp_path, monkeypatch, data, events)
    assert load_events("hri", "s02")["status"].tolist() == ["kept", "artefact", "kept"]
    assert load_epochs("hri", "s02").metadata["epoch"].tolist() == [0, 2]
    lenient = load_events("hri", "s02", Preprocessing(reject=1.0))
    assert lenient["status"].tolist() == ["kept"] * 3


def test_a_recording_without_feedback_is_refused(tmp_path, monkeypatch):
    recording(tmp_path, monkeypatch, noise(20), [(5.0, "go"), (9.0, "stop")])
    with pytest.raises(ValueError, match=r"no feedback .* which are go, stop"):
        load_epochs("hri", "s02")


def test_a_changed_recording_is_not_served_from_the_cache(tmp_path, monkeypatch):
    events = trial(5, "S  4") + trial(9, "S  6")
    recording(tmp_path, monkeypatch, noise(20), events)
    first = load_epochs("hri", "s02").get_data()
    recording(tmp_path, monkeypatch, 2 * noise(20), events)
    np.testing.assert_allclose(load_epochs("hri", "s02").get_data(), 2 * first, atol=1e-9)


def test_an_unknown_reference_is_refused():
    with pytest.raises(ValueError, match="'linked' is unknown; choose 'average'"):
        Preprocessing(reference="linked")


# A folder of epochs


def folder(tmp_path, sfreq, n_times, name="sub-01_epo.fif", events=("correct", "error")):
    info = mne.create_info(["Cz", "Fz", "EOG"], sfreq, ["eeg", "eeg", "eog"])
    values = np.random.default_rng(0).normal(0, 1e-5, (12, 3, n_times))
    array = np.column_stack([np.arange(12), np.zeros(12, int), [1, 2] * 6])
    names = dict(zip(events, (1, 2), strict=True))
    epochs = mne.EpochsArray(values, info, array, tmin=-0.1, event_id=names, verbose="error")
    epochs.save(tmp_path / name, fmt="double", verbose="error")
    return tmp_path, values


def test_short_epochs_keep_their_window_rate_and_band(tmp_path):
    path, values = folder(tmp_path, 200.0, 141)
    epochs = load_epochs(path, "01", Preprocessing(reference="recorded"))
    assert (epochs.info["sfreq"], epochs.tmin) == (200.0, pytest.approx(-0.1))
    np.testing.assert_array_equal(epochs.get_data(), values)
    assert epochs.metadata["epoch"].tolist() == list(range(12))
    assert epochs.metadata["label"].tolist() == [0, 1] * 6


def test_long_epochs_are_filtered_and_fast_ones_resampled(tmp_path):
    path, _ = folder(tmp_path, 512.0, 512 * 12)
    epochs = load_epochs(path, "01", Preprocessing(reference="recorded"))
    assert epochs.info["sfreq"] == 256
    power = np.abs(np.fft.rfft(epochs.get_data(), axis=-1)) ** 2
    f = np.fft.rfftfreq(power.shape[-1] * 2 - 2, 1 / 256)
    assert power[..., f > 30].mean() < 1e-3 * power[..., (f > 2) & (f < 18)].mean()


def test_the_decoder_reads_events_of_any_name(tmp_path):
    path, values = folder(tmp_path, 200.0, 141, events=("hit", "miss"))
    epochs = loso.recorded_cohort(path, ["01"], ("hit", "miss"))["01"]
    np.testing.assert_array_equal(epochs.get_data(), values)
    assert epochs.event_id == {"correct": 1, "error": 2}
    with pytest.raises(ValueError, match=r"events: hit, miss\); name the two with --events"):
        loso.recorded_cohort(path, ["01"])["01"]


def test_a_causal_filter_is_for_recordings_and_has_a_cache_of_its_own(cache, tmp_path):
    zero, causal = load_epochs("simulated", "s03"), load_epochs("simulated", "s03", CAUSAL)
    assert zero.events.shape == causal.events.shape
    assert not np.allclose(zero.get_data(), causal.get_data(), atol=1e-6)
    path, _ = folder(tmp_path, 200.0, 141)
    with pytest.raises(ValueError, match="holds epochs; a causal filter needs a continuous"):
        load_epochs(path, "01", CAUSAL)
    with pytest.raises(ValueError, match="phase 'linear' is unknown; choose 'zero' or 'minimum'"):
        Preprocessing(phase="linear")


def test_epochs_of_a_folder_are_not_a_stream(tmp_path):
    path, _ = folder(tmp_path, 200.0, 141)
    for load in (load_continuous, load_events):
        with pytest.raises(ValueError, match=r"holds epochs, not .* or a folder of continuous rec"):
            load(path, "01")


@pytest.mark.skipif(not NER.is_dir(), reason=f"{NER} is not here (RLIHF_NER2015)")
def test_real_error_potentials_are_read():
    assert len(recordings.source_subjects(NER)) == 8
    epochs = load_epochs(NER, "02")
    assert (epochs.info["sfreq"], len(epochs.times)) == (200.0, 141)
    assert epochs.get_channel_types().count("eeg") == 56
    assert epochs.metadata["session"].nunique() == 5
    positions = epochs.get_montage().get_positions()["ch_pos"]
    assert np.isfinite(np.array(list(positions.values()))).all()
