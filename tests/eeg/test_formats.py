"""Reading EEGLAB files in their many forms, and folders of epochs; the door to all sources."""

import mne
import numpy as np
import pytest
import scipy.io

from rlihf_lib.eeg import formats, hri, recordings, simulated

EVENTS = [(11.0, "S  1"), (20.5, "R  1"), (26.25, "FB1"), (26.5, "S  4")]


def data(n_samples=300):
    return np.random.default_rng(0).normal(0, 20, (30, n_samples)).astype(np.float32)


def write(folder, **changes):
    """A small `.set`/`.fdt` pair; `changes` replace fields of its structure."""
    path = folder / "s02_cursor.set"
    simulated.write_set(path, data(), EVENTS)
    if changes:
        eeg = scipy.io.loadmat(path)["EEG"]
        eeg = {name: eeg[name][0, 0] for name in eeg.dtype.names}
        scipy.io.savemat(path, {"EEG": eeg | changes}, format="5", oned_as="row")
    return path


def labels(*names):
    locations = np.zeros(len(names), dtype=[("labels", object)])
    locations["labels"] = names
    return locations


def events(*pairs):
    array = np.zeros(len(pairs), dtype=[("latency", object), ("type", object)])
    array["latency"], array["type"] = zip(*pairs, strict=True)
    return array


def test_reads_back_what_was_written(tmp_path):
    raw = formats.read_eeglab(write(tmp_path))
    assert raw.ch_names == list(hri.CHANNELS)
    assert raw.info["sfreq"] == 256
    assert raw.get_channel_types() == ["eog" if "EOG" in n else "eeg" for n in hri.CHANNELS]
    np.testing.assert_array_equal(raw.get_data(), data().astype(float) * 1e-6)
    assert list(raw.annotations.description) == [name for _, name in EVENTS]
    # Latencies count from 1 and are fractional; MNE keeps microseconds.
    np.testing.assert_allclose(
        raw.annotations.onset * 256 + 1, [at for at, _ in EVENTS], atol=256e-6
    )
    positions = raw.get_montage().get_positions()["ch_pos"]
    assert positions["Fz"][1] > positions["Pz"][1]


def test_data_may_be_embedded_in_the_set_file(tmp_path):
    path = write(tmp_path, data=data())
    path.with_suffix(".fdt").unlink()
    np.testing.assert_array_equal(formats.read_eeglab(path).get_data(), data().astype(float) * 1e-6)


def test_fields_may_lie_at_the_top_of_the_file(tmp_path):
    path = write(tmp_path)
    eeg = scipy.io.loadmat(path)["EEG"]
    scipy.io.savemat(path, {name: eeg[name][0, 0] for name in eeg.dtype.names}, format="5")
    assert formats.read_eeglab(path).n_times == 300


def test_a_renamed_pair_is_found(tmp_path):
    path = write(tmp_path)
    path.with_suffix(".fdt").rename(tmp_path / "x.fdt")
    assert formats.read_eeglab(path.rename(tmp_path / "x.set")).n_times == 300


def test_repeated_eog_labels_are_numbered(tmp_path):
    names = ["EOG3" if "EOG" in name else name for name in hri.CHANNELS]
    raw = formats.read_eeglab(write(tmp_path, chanlocs=labels(*names)))
    assert [name for name in raw.ch_names if "EOG" in name] == ["EOG1", "EOG2", "EOG3"]
    assert raw.get_channel_types().count("eog") == 3


def test_a_repeated_eeg_label_is_refused(tmp_path):
    names = ["Fz" if name == "Cz" else name for name in hri.CHANNELS]
    with pytest.raises(ValueError, match=r"s02_cursor\.set: channel Fz occurs twice"):
        formats.read_eeglab(write(tmp_path, chanlocs=labels(*names)))


@pytest.mark.parametrize("kind", ["S  6", "S6", "S 6", "6", 6, 6.0])
def test_event_types_may_be_strings_or_integers(tmp_path, kind):
    raw = formats.read_eeglab(write(tmp_path, event=events((10.0, kind), (20.0, "FB1"))))
    assert list(raw.annotations.description) == ["S  6", "FB1"]


def test_a_single_event_is_read(tmp_path):
    raw = formats.read_eeglab(write(tmp_path, event=events((10.0, "S  6"))))
    assert list(raw.annotations.description) == ["S  6"]


@pytest.mark.parametrize("latency", [302.5, 1e9, np.nan, 0.5])
def test_an_event_outside_the_data_is_left_out_with_a_warning(tmp_path, latency):
    path = write(tmp_path, event=events((10.0, "S  4"), (latency, "S  9")))
    with pytest.warns(RuntimeWarning, match=r"outside data range|onset that is NaN"):
        raw = formats.read_eeglab(path)
    assert list(raw.annotations.description) == ["S  4"]


def test_an_event_before_the_data_is_refused(tmp_path):
    path = write(tmp_path, event=events((10.0, "S  4"), (-3.0, "S  9")))
    with pytest.raises(ValueError, match=r"s02_cursor\.set .* event sample index is negative"):
        formats.read_eeglab(path)


def test_a_truncated_fdt_is_refused(tmp_path):
    path = write(tmp_path)
    fdt = path.with_suffix(".fdt")
    fdt.write_bytes(fdt.read_bytes()[:-4])
    with pytest.raises(ValueError, match=r"s02_cursor\.fdt has 35996 bytes, expected 36000"):
        formats.read_eeglab(path)


def test_a_missing_fdt_is_named(tmp_path):
    path = write(tmp_path)
    path.with_suffix(".fdt").unlink()
    with pytest.raises(FileNotFoundError, match=r"s02_cursor\.fdt"):
        formats.read_eeglab(path)


def test_a_missing_set_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.set"):
        formats.read_eeglab(tmp_path / "none.set")


@pytest.mark.parametrize("content", [b"", b"<html>", "half"])
def test_a_set_that_is_not_one_is_refused(tmp_path, content):
    path = write(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content == "half" else content)
    with pytest.raises(ValueError, match=r"s02_cursor\.set is not a readable continuous EEGLAB"):
        formats.read_eeglab(path)


def test_a_matlab_file_of_something_else_is_refused(tmp_path):
    scipy.io.savemat(tmp_path / "x.set", {"weights": 1.0})
    with pytest.raises(ValueError, match=r"x\.set is not a readable continuous EEGLAB"):
        formats.read_eeglab(tmp_path / "x.set")


def test_an_epoched_set_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"s02_cursor\.set .* number of trials is 5"):
        formats.read_eeglab(write(tmp_path, trials=5.0))


def test_nan_is_refused_with_its_channel_and_time(tmp_path):
    values = data()
    values[1, 128] = np.nan
    with pytest.raises(ValueError, match=r"NaN or infinite, the first in channel Fz at 0\.500 s"):
        formats.read_eeglab(write(tmp_path, data=values))


def test_a_missing_channel_is_refused(tmp_path, monkeypatch):
    names = ["A1" if name == "Cz" else name for name in hri.CHANNELS]
    path = write(tmp_path, chanlocs=labels(*names))
    monkeypatch.setattr(recordings, "recording_path", lambda eeg, subject: path)
    with pytest.raises(ValueError, match=r"s02_cursor\.set: channel Cz is missing"):
        recordings.read_recording("hri", "s02")


@pytest.mark.parametrize("eeg", ["simulated", "hri"])
def test_an_unknown_subject_is_refused(eeg):
    with pytest.raises(ValueError, match=r"unknown subject 's01' .* s02, s03"):
        recordings.recording_path(eeg, "s01")


# A folder of epochs


def epochs_file(folder, name, labels, channels=("Cz", "Fz", "EOG"), events=None, **layout):
    layout = {"sfreq": 200.0, "tmin": -0.1, "n_times": 141} | layout
    types = ["eog" if "EOG" in channel else "eeg" for channel in channels]
    info = mne.create_info(list(channels), layout["sfreq"], types)
    values = np.array([[hash_of(channel) for channel in channels]] * len(labels), float)
    values = np.repeat(values[:, :, None], layout["n_times"], axis=2) * 1e-6
    onsets = np.arange(len(labels))
    array = np.column_stack([onsets, 0 * onsets, np.array(labels) + 1])
    events = events or {"correct": 1, "error": 2}
    present = {key: code for key, code in events.items() if code in array[:, 2]}
    epochs = mne.EpochsArray(
        values, info, array, tmin=layout["tmin"], event_id=present, verbose="error"
    )
    epochs.save(folder / name, verbose="error")


def hash_of(channel):
    return sum(channel.encode())


def test_sessions_are_joined_and_channels_matched_by_name(tmp_path):
    epochs_file(tmp_path, "sub-07_ses-01_epo.fif", [0, 0])
    epochs_file(tmp_path, "sub-07_ses-02_epo.fif", [1, 0, 1], channels=("EOG", "Fz", "Cz"))
    epochs_file(tmp_path, "sub-11_epo.fif", [1, 0])
    (tmp_path / "notes.txt").write_text("not EEG")
    assert recordings.source_subjects(tmp_path) == ["07", "11"]
    epochs = formats.read_folder_epochs(tmp_path, "07")
    assert epochs.ch_names == ["Cz", "Fz", "EOG"]
    assert epochs.tmin == pytest.approx(-0.1)
    assert epochs.metadata["label"].tolist() == [0, 0, 1, 0, 1]
    assert epochs.metadata["session"].tolist() == ["01", "01", "02", "02", "02"]
    for channel in epochs.ch_names:
        np.testing.assert_allclose(epochs.get_data(channel), hash_of(channel) * 1e-6, rtol=1e-6)


def test_electrodes_get_the_position_of_their_name_and_keep_their_own(tmp_path):
    epochs_file(tmp_path, "sub-01_epo.fif", [0, 1])
    info = formats.read_folder_epochs(tmp_path, "01").info
    found = info.get_montage().get_positions()["ch_pos"]
    assert found["Fz"][1] > found["Cz"][1] + 0.03
    own = {"Cz": (0.0, 0.01, 0.1), "Fz": (0.0, 0.07, 0.08)}
    epochs = mne.read_epochs(tmp_path / "sub-01_epo.fif", verbose="error")
    epochs.set_montage(mne.channels.make_dig_montage(own, coord_frame="head"), on_missing="ignore")
    epochs.save(tmp_path / "sub-01_epo.fif", overwrite=True, verbose="error")
    info = formats.read_folder_epochs(tmp_path, "01").info
    np.testing.assert_allclose(info["chs"][0]["loc"][:3], own["Cz"], atol=1e-6)


def test_event_names_are_configurable_and_others_left_out(tmp_path):
    names = {"hit": 1, "miss": 2, "rest": 3}
    epochs_file(tmp_path, "sub-01_epo.fif", [0, 1, 2, 1], events=names)
    epochs = formats.read_folder_epochs(tmp_path, "01", ("hit", "miss"))
    assert epochs.metadata["label"].tolist() == [0, 1, 1]


def test_a_subject_without_one_class_is_refused(tmp_path):
    epochs_file(tmp_path, "sub-01_epo.fif", [0, 0])
    with pytest.raises(ValueError, match=r"subject 01 has no epoch of the event 'error'"):
        formats.read_folder_epochs(tmp_path, "01")


def test_an_unknown_subject_of_a_folder_is_refused(tmp_path):
    epochs_file(tmp_path, "sub-01_epo.fif", [0, 1])
    with pytest.raises(ValueError, match=r"unknown subject '02' .* choose one of 01"):
        formats.read_folder_epochs(tmp_path, "02")


@pytest.mark.parametrize("layout", [{"sfreq": 250.0}, {"tmin": 0.0}, {"n_times": 100}])
def test_sessions_of_another_layout_are_refused(tmp_path, layout):
    epochs_file(tmp_path, "sub-01_ses-1_epo.fif", [0, 1])
    epochs_file(tmp_path, "sub-01_ses-2_epo.fif", [0, 1], **layout)
    with pytest.raises(ValueError, match=r"ses-2_epo\.fif: sampling rate, window start"):
        formats.read_folder_epochs(tmp_path, "01")


def test_a_session_that_lacks_a_channel_is_refused(tmp_path):
    epochs_file(tmp_path, "sub-01_ses-1_epo.fif", [0, 1])
    epochs_file(tmp_path, "sub-01_ses-2_epo.fif", [0, 1], channels=("Cz", "EOG"))
    with pytest.raises(ValueError, match=r"ses-2_epo\.fif: channel Fz is missing"):
        formats.read_folder_epochs(tmp_path, "01")


def test_a_damaged_epochs_file_is_named(tmp_path):
    epochs_file(tmp_path, "sub-01_epo.fif", [0, 1])
    path = tmp_path / "sub-01_epo.fif"
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(ValueError, match=r"sub-01_epo\.fif cannot be read"):
        formats.read_folder_epochs(tmp_path, "01")


def test_a_folder_without_epochs_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no file named sub-XX"):
        recordings.source_subjects(tmp_path)


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"'simulated', 'hri', or a folder"):
        recordings.source_subjects(tmp_path / "none")
