"""Reading EEGLAB files in their many forms; the door to the built-in sources."""

import numpy as np
import pytest
import scipy.io

from rlihf_lib.eeg import hri, recordings, simulated
from rlihf_lib.eeg.eeglab import read_eeglab

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
    raw = read_eeglab(write(tmp_path))
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
    np.testing.assert_array_equal(read_eeglab(path).get_data(), data().astype(float) * 1e-6)


def test_fields_may_lie_at_the_top_of_the_file(tmp_path):
    path = write(tmp_path)
    eeg = scipy.io.loadmat(path)["EEG"]
    scipy.io.savemat(path, {name: eeg[name][0, 0] for name in eeg.dtype.names}, format="5")
    assert read_eeglab(path).n_times == 300


def test_a_renamed_pair_is_found(tmp_path):
    path = write(tmp_path)
    path.with_suffix(".fdt").rename(tmp_path / "x.fdt")
    assert read_eeglab(path.rename(tmp_path / "x.set")).n_times == 300


def test_repeated_eog_labels_are_numbered(tmp_path):
    names = ["EOG3" if "EOG" in name else name for name in hri.CHANNELS]
    raw = read_eeglab(write(tmp_path, chanlocs=labels(*names)))
    assert [name for name in raw.ch_names if "EOG" in name] == ["EOG1", "EOG2", "EOG3"]
    assert raw.get_channel_types().count("eog") == 3


def test_a_repeated_eeg_label_is_refused(tmp_path):
    names = ["Fz" if name == "Cz" else name for name in hri.CHANNELS]
    with pytest.raises(ValueError, match=r"s02_cursor\.set: channel Fz occurs twice"):
        read_eeglab(write(tmp_path, chanlocs=labels(*names)))


@pytest.mark.parametrize("kind", ["S  6", "S6", "S 6", "6", 6, 6.0])
def test_event_types_may_be_strings_or_integers(tmp_path, kind):
    raw = read_eeglab(write(tmp_path, event=events((10.0, kind), (20.0, "FB1"))))
    assert list(raw.annotations.description) == ["S  6", "FB1"]


def test_a_single_event_is_read(tmp_path):
    raw = read_eeglab(write(tmp_path, event=events((10.0, "S  6"))))
    assert list(raw.annotations.description) == ["S  6"]


@pytest.mark.parametrize("latency", [302.5, 1e9, np.nan, 0.5])
def test_an_event_outside_the_data_is_left_out_with_a_warning(tmp_path, latency):
    path = write(tmp_path, event=events((10.0, "S  4"), (latency, "S  9")))
    with pytest.warns(RuntimeWarning, match=r"outside data range|onset that is NaN"):
        raw = read_eeglab(path)
    assert list(raw.annotations.description) == ["S  4"]


def test_an_event_before_the_data_is_refused(tmp_path):
    path = write(tmp_path, event=events((10.0, "S  4"), (-3.0, "S  9")))
    with pytest.raises(ValueError, match=r"s02_cursor\.set .* event sample index is negative"):
        read_eeglab(path)


def test_a_truncated_fdt_is_refused(tmp_path):
    path = write(tmp_path)
    fdt = path.with_suffix(".fdt")
    fdt.write_bytes(fdt.read_bytes()[:-4])
    with pytest.raises(ValueError, match=r"s02_cursor\.fdt has 35996 bytes, expected 36000"):
        read_eeglab(path)


def test_a_missing_fdt_is_named(tmp_path):
    path = write(tmp_path)
    path.with_suffix(".fdt").unlink()
    with pytest.raises(FileNotFoundError, match=r"s02_cursor\.fdt"):
        read_eeglab(path)


def test_a_missing_set_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.set"):
        read_eeglab(tmp_path / "none.set")


@pytest.mark.parametrize("content", [b"", b"<html>", "half"])
def test_a_set_that_is_not_one_is_refused(tmp_path, content):
    path = write(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content == "half" else content)
    with pytest.raises(ValueError, match=r"s02_cursor\.set is not a readable continuous EEGLAB"):
        read_eeglab(path)


def test_a_matlab_file_of_something_else_is_refused(tmp_path):
    scipy.io.savemat(tmp_path / "x.set", {"weights": 1.0})
    with pytest.raises(ValueError, match=r"x\.set is not a readable continuous EEGLAB"):
        read_eeglab(tmp_path / "x.set")


def test_an_epoched_set_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"s02_cursor\.set .* number of trials is 5"):
        read_eeglab(write(tmp_path, trials=5.0))


def test_nan_is_refused_with_its_channel_and_time(tmp_path):
    values = data()
    values[1, 128] = np.nan
    with pytest.raises(ValueError, match=r"NaN or infinite, the first in channel Fz at 0\.500 s"):
        read_eeglab(write(tmp_path, data=values))


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
