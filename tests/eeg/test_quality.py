"""Signals that cannot be EEG are refused before anything is trained: by file, channel, remedy."""

import mne
import numpy as np
import pytest

from rlihf_lib.eeg.loso import recorded_cohort, run_loso
from rlihf_lib.eeg.preprocessing import Preprocessing, load_epochs
from tests.eeg import writers

SUBJECTS = ["01", "02", "03"]


def write(folder, make_epochs, change, who="02"):
    """Epochs of three people; those of one are changed, in volts (n, n_channels, n_times)."""
    folder.mkdir()
    for number, subject in enumerate(SUBJECTS):
        epochs = make_epochs(number)
        if subject == who:
            epochs._data[:] = change(epochs._data, epochs.times)
        epochs.save(folder / f"sub-{subject}_epo.fif", fmt="double", verbose="error")
    return folder


def pulse(values, times):
    return values + 5e-4 * (np.abs(times - 0.02) < 0.01)


def scaled(factor, *channels):
    def change(values, times):
        values = values.copy()
        values[:, channels or slice(None)] *= factor
        return values

    return change


NO_EEG = {
    "microvolts": (scaled(1e6), r"vary by \d\.\d+e\+06 µV .* not in volts"),
    "millivolts": (scaled(1e3), r"vary by 4\.\d+e\+03 µV .* not in volts"),
    "nanovolts as if microvolts": (scaled(1e-3), r"vary by 0\.00\d+ µV .* not in volts"),
    "a flat person": (scaled(0), r"vary by 0 µV .*; nothing was recorded"),
    "a flat reference": (scaled(0, 3), r"channel C3 is flat, .* --drop-channels C3"),
    "a constant channel": (
        lambda values, times: np.where(np.arange(5)[:, None] == 3, 0.005, values),
        r"channel C3 is flat, .* --drop-channels C3",
    ),
    "a loose electrode": (
        scaled(30, 3), r"(60 of 60|30 of 30) epochs exceed 200 µV .* --drop-channels C3"
    ),
    "one channel in microvolts": (scaled(1e6, 3), r"epochs exceed .* on channel C3, "),
    "a pulse at the event": (pulse, r"60 of 60 epochs exceed 200 µV .* pulses"),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*offsets")
@pytest.mark.parametrize("kind", NO_EEG)
def test_what_is_no_eeg_is_refused_before_training(kind, make_epochs, tmp_path):
    change, message = NO_EEG[kind]
    folder = write(tmp_path / "mine", make_epochs, change)
    with pytest.raises(ValueError, match=rf"sub-02_epo\.fif: .*{message}"):
        run_loso(recorded_cohort(folder, SUBJECTS), tmp_path / "out")
    assert not list((tmp_path / "out").rglob("*.csv"))


def test_the_channel_that_is_at_fault_can_be_dropped(make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs, scaled(30, 3))
    cohort = recorded_cohort(folder, SUBJECTS, drop_channels=["C3"])
    assert cohort["02"].ch_names == ["Fz", "Cz", "Pz", "C4"]


@pytest.mark.parametrize("where", [slice(None), 1])
def test_an_offset_of_short_epochs_is_taken_out_with_a_warning(where, make_epochs, tmp_path):
    def shift(values, times):
        values = values.copy()
        values[:, where] += 0.005
        return values

    folder = write(tmp_path / "mine", make_epochs, shift)
    settings = Preprocessing(reference="recorded")
    with pytest.warns(UserWarning, match=r"sub-02_epo\.fif: .*up to 500\d µV, on"):
        values = load_epochs(folder, "02", settings).get_data()
    expected = make_epochs(1).get_data()
    np.testing.assert_allclose(values, expected - expected.mean(axis=2, keepdims=True), atol=1e-12)
    untouched = load_epochs(folder, "01", settings).get_data()
    np.testing.assert_array_equal(untouched, make_epochs(0).get_data())


def test_one_session_is_enough_to_be_refused(make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs, scaled(1))
    other = make_epochs(7)
    other._data *= 1e6
    other.save(folder / "sub-01_ses-2_epo.fif", verbose="error")
    with pytest.raises(ValueError, match=r"sub-01_ses-2_epo\.fif: its channels vary by"):
        load_epochs(folder, "01")


def test_nan_in_epochs_is_named(make_epochs, tmp_path):
    def lost(values, times):
        values = values.copy()
        values[4, 1, 64] = np.nan
        return values

    folder = write(tmp_path / "mine", make_epochs, lost)
    with pytest.raises(ValueError, match=r"sub-02_epo\.fif: 1 samples .* channel Cz at 0\.500 s"):
        load_epochs(folder, "02")


@pytest.mark.parametrize("kind", ["microvolts", "a flat reference", "a loose electrode"])
def test_recordings_are_checked_alike(kind, tmp_path, monkeypatch):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    signal, events = writers.planted(0)
    change, message = NO_EEG[kind]
    (tmp_path / "mine").mkdir()
    writers.fif(tmp_path / "mine" / "sub-01_eeg.fif", change(signal[None], None)[0], events)
    # The average reference would hide what is flat.
    for reference in ("recorded", "average"):
        with pytest.raises(ValueError, match=rf"sub-01_eeg\.fif: .*{message}"):
            load_epochs(tmp_path / "mine", "01", Preprocessing(reference=reference))


def test_epochs_of_people_are_left_as_they_are(make_epochs, tmp_path):
    def few_movements(values, times):
        values = values.copy()
        values[:25, 0] += 1e-3 * np.sin(40 * times)
        return values

    folder = write(tmp_path / "mine", make_epochs, few_movements)
    assert len(load_epochs(folder, "02")) == 60, "whoever cut them decided which to keep"
    assert isinstance(load_epochs(folder, "02"), mne.BaseEpochs)
