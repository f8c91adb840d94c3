"""Folders of epochs: sessions joined, channels that all have, labels by name; what is told."""

import mne
import numpy as np
import pytest

from rlihf_lib.eeg import overview, recordings
from rlihf_lib.eeg.preprocessing import Preprocessing, load_epochs
from tests.eeg.writers import NAMES

SETTINGS = Preprocessing(reference="recorded")


def write(folder, name, channels=NAMES, labels=(0, 1) * 6, events=None, change=None, **layout):
    """Epochs whose channels are noise about nothing; the noise of a channel is known by its name.

    `change` gets them before they are saved.
    """
    layout = {"sfreq": 200.0, "tmin": -0.1, "n_times": 141} | layout
    types = ["eog" if "EOG" in channel else "eeg" for channel in channels]
    info = mne.create_info(list(channels), layout["sfreq"], types)
    shape = len(labels), layout["n_times"]
    values = np.stack([noise(channel, name, shape) for channel in channels], axis=1)
    array = np.column_stack([np.arange(len(labels)), 0 * np.array(labels), np.array(labels) + 1])
    events = events or {"correct": 1, "error": 2}
    present = {key: code for key, code in events.items() if code in array[:, 2]}
    epochs = mne.EpochsArray(values, info, array, layout["tmin"], present, verbose="error")
    if change:
        change(epochs)
    epochs.save(folder / name, fmt="double", overwrite=True, verbose="error")


def noise(channel, name, shape):
    rng = np.random.default_rng([*channel.encode(), *name.encode()])
    return rng.normal(0, 1e-5, shape)


def test_sessions_are_joined_and_channels_matched_by_name(tmp_path):
    write(tmp_path, "sub-07_ses-01_epo.fif", ("Cz", "Fz", "EOG"), [0] * 5)
    write(tmp_path, "sub-07_ses-02_epo.fif", ("EOG", "Fz", "Cz"), [1] * 5)
    write(tmp_path, "sub-11_epo.fif", ("Cz", "Fz", "EOG"))
    (tmp_path / "notes.txt").write_text("not EEG")
    assert recordings.source_subjects(tmp_path) == ["07", "11"]
    epochs = load_epochs(tmp_path, "07", SETTINGS)
    assert epochs.ch_names == ["Cz", "Fz", "EOG"] and epochs.tmin == pytest.approx(-0.1)
    assert epochs.metadata["label"].tolist() == [0] * 5 + [1] * 5
    assert epochs.metadata["session"].tolist() == ["01"] * 5 + ["02"] * 5
    for number, channel in enumerate(epochs.ch_names):
        sessions = [noise(channel, f"sub-07_ses-0{n}_epo.fif", (5, 141)) for n in (1, 2)]
        np.testing.assert_array_equal(epochs.get_data()[:, number], np.concatenate(sessions))
    assert overview.notes(tmp_path) == []


def test_electrodes_get_the_position_of_their_name_and_keep_their_own(tmp_path):
    write(tmp_path, "sub-01_epo.fif", ("Cz", "Fz"))
    found = load_epochs(tmp_path, "01", SETTINGS).get_montage().get_positions()["ch_pos"]
    assert found["Fz"][1] > found["Cz"][1] + 0.03
    own = {"Cz": (0.0, 0.01, 0.1), "Fz": (0.0, 0.07, 0.08)}
    montage = mne.channels.make_dig_montage(own, coord_frame="head")
    write(tmp_path, "sub-01_epo.fif", ("Cz", "Fz"), change=lambda e: e.set_montage(montage))
    info = load_epochs(tmp_path, "01", SETTINGS).info
    np.testing.assert_allclose(info["chs"][0]["loc"][:3], own["Cz"], atol=1e-6)


def test_event_names_are_configurable_and_others_left_out(tmp_path):
    names = {"hit/left": 1, "miss": 2, "rest": 3}
    write(tmp_path, "sub-01_epo.fif", labels=(0, 1, 2) * 5, events=names)
    settings = Preprocessing(correct_event="hit", error_event="miss")
    assert load_epochs(tmp_path, "01", settings).metadata["label"].tolist() == [0, 1] * 5


def test_a_subject_without_one_class_is_refused_with_the_names_there_are(tmp_path):
    write(tmp_path, "sub-01_epo.fif", labels=[0, 2] * 6, events={"correct": 1, "rest": 3})
    message = r"subject 01 has no epoch of the event 'error' \(its events: correct, rest\)"
    with pytest.raises(ValueError, match=message):
        load_epochs(tmp_path, "01", SETTINGS)


@pytest.mark.parametrize("n", [1, 4])
def test_a_subject_with_hardly_an_error_is_refused(tmp_path, n):
    write(tmp_path, "sub-01_epo.fif", labels=[0] * 20 + [1] * n)
    with pytest.raises(
        ValueError, match=rf"subject 01: epochs left of the event 'error': {n}, .* 20"
    ):
        load_epochs(tmp_path, "01", SETTINGS)


def test_an_unknown_subject_of_a_folder_is_refused(tmp_path):
    write(tmp_path, "sub-01_epo.fif")
    with pytest.raises(ValueError, match=r"unknown subject '02' .* choose one of 01"):
        load_epochs(tmp_path, "02", SETTINGS)


@pytest.mark.parametrize("layout", [{"sfreq": 250.0}, {"tmin": 0.0}, {"n_times": 100}])
def test_sessions_of_another_layout_are_refused(tmp_path, layout):
    write(tmp_path, "sub-01_ses-1_epo.fif")
    write(tmp_path, "sub-01_ses-2_epo.fif", **layout)
    with pytest.raises(ValueError, match=r"ses-2_epo\.fif: sampling rate, window start"):
        load_epochs(tmp_path, "01", SETTINGS)


@pytest.mark.parametrize("where", ["sub-01_ses-2_epo.fif", "sub-02_epo.fif"])
@pytest.mark.parametrize("less", [NAMES[1:], (*NAMES[1:], "Oz")])
def test_channels_that_all_people_and_sessions_have_are_used_and_the_others_named(
    tmp_path, where, less
):
    write(tmp_path, "sub-01_ses-1_epo.fif")
    write(tmp_path, "sub-03_epo.fif")
    write(tmp_path, where, less)
    for subject in recordings.source_subjects(tmp_path):
        assert load_epochs(tmp_path, subject, SETTINGS).ch_names == list(NAMES[1:])
    first, *more = overview.notes(tmp_path)
    assert first == f"left out: Fz (not in {where})"
    others = {"sub-01_ses-1_epo.fif", "sub-03_epo.fif"}
    assert more == ([f"left out: Oz (not in {', '.join(sorted(others))})"] if "Oz" in less else [])


def test_a_channel_of_different_types_is_left_out(tmp_path):
    write(tmp_path, "sub-01_epo.fif")
    write(tmp_path, "sub-02_epo.fif", change=lambda e: e.set_channel_types({"Fz": "eog"}))
    assert load_epochs(tmp_path, "01", SETTINGS).ch_names == list(NAMES[1:])
    assert overview.notes(tmp_path) == ["left out: Fz (of different types, eeg, eog)"]


def test_people_without_a_common_channel_are_refused(tmp_path):
    write(tmp_path, "sub-01_epo.fif", NAMES[:2])
    write(tmp_path, "sub-02_epo.fif", NAMES[2:])
    with pytest.raises(ValueError, match=r"no EEG channel is in all files .*sub-02_epo.fif: Pz"):
        load_epochs(tmp_path, "01", SETTINGS)


def test_bad_channels_are_interpolated_and_many_refused(tmp_path):
    def loud(epochs):
        epochs._data[:, 2] = np.nan
        epochs.info["bads"] = ["Pz"]

    write(tmp_path, "sub-01_epo.fif", change=loud)
    epochs = load_epochs(tmp_path, "01", SETTINGS)
    assert epochs.info["bads"] == [] and epochs.get_data("Pz").std() < 2e-5
    assert overview.notes(tmp_path) == ["interpolated, marked bad in sub-01_epo.fif: Pz"]
    write(tmp_path, "sub-01_epo.fif", change=lambda e: e.info["bads"].extend(NAMES))
    with pytest.raises(ValueError, match=r"01_epo.fif: 5 of 5 EEG channels are .* leave the file"):
        load_epochs(tmp_path, "01", SETTINGS)
    write(tmp_path, "sub-01_epo.fif", change=lambda e: e.info["bads"].extend(["Pz", "C3"]))
    with pytest.raises(
        ValueError, match=r"01_epo.fif: 2 of 5 EEG channels are marked bad \(Pz, C3"
    ):
        load_epochs(tmp_path, "01", SETTINGS)
    dropped = Preprocessing(reference="recorded", drop_channels=("C3",))
    assert load_epochs(tmp_path, "01", dropped).ch_names == ["Fz", "Cz", "Pz", "C4"]


def test_a_projector_stays_as_the_file_has_it(tmp_path):
    def project(epochs):
        epochs.set_eeg_reference(projection=True, verbose="error")
        epochs.info["projs"][0]["active"] = False

    write(tmp_path, "sub-01_epo.fif", change=project)
    epochs = load_epochs(tmp_path, "01", SETTINGS)
    expected = [noise(channel, "sub-01_epo.fif", (12, 141)) for channel in NAMES]
    np.testing.assert_array_equal(epochs.get_data(), np.stack(expected, axis=1))
    assert overview.notes(tmp_path) == [
        "projectors that files hold but don't apply are not applied: "
        "sub-01_epo.fif (Average EEG reference)"
    ]
    write(tmp_path, "sub-01_epo.fif", change=lambda e: project(e) or e.apply_proj(verbose="error"))
    assert overview.notes(tmp_path) == []
    assert np.abs(load_epochs(tmp_path, "01", SETTINGS).get_data().mean(axis=1)).max() < 1e-12


def band(low, high):
    def change(epochs):
        with epochs.info._unlock():
            epochs.info.update(highpass=low, lowpass=high)

    return change


def test_bands_that_differ_in_the_end_are_told(tmp_path):
    write(tmp_path, "sub-01_ses-1_epo.fif", change=band(0.1, 40.0))
    write(tmp_path, "sub-01_ses-2_epo.fif", change=band(1.0, 20.0))
    assert overview.notes(tmp_path) == [
        "signals are of different bands, which makes people differ: "
        "0.1 to 40 Hz: sub-01_ses-1_epo.fif; 1 to 20 Hz: sub-01_ses-2_epo.fif"
    ]


def test_each_session_gets_the_filters_it_lacks(tmp_path):
    write(tmp_path, "sub-01_ses-1_epo.fif", n_times=2100, change=band(1.0, 20.0))
    write(tmp_path, "sub-01_ses-2_epo.fif", n_times=2100)
    assert overview.notes(tmp_path) == [], "both are of 1 to 20 Hz then"
    power = np.abs(np.fft.rfft(load_epochs(tmp_path, "01", SETTINGS).get_data(), axis=-1)) ** 2
    above = np.fft.rfftfreq(2100, 1 / 200) > 30
    lost = power[..., above].mean(axis=(1, 2))
    assert lost[12:].max() < 1e-3 * lost[:12].min()


def test_a_damaged_epochs_file_is_named(tmp_path):
    write(tmp_path, "sub-01_epo.fif")
    path = tmp_path / "sub-01_epo.fif"
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(ValueError, match=r"sub-01_epo\.fif cannot be read"):
        load_epochs(tmp_path, "01", SETTINGS)


@pytest.mark.parametrize("what", ["sub-02_epo.fif", "sub-02"])
def test_a_link_out_of_the_folder_is_told(tmp_path, what):
    (tmp_path / "mine").mkdir()
    (tmp_path / "theirs" / "sub-02").mkdir(parents=True)
    write(tmp_path / "mine", "sub-01_epo.fif")
    (tmp_path / "mine" / "sub-01_epo.fif").rename(tmp_path / "mine" / "stored.txt")
    (tmp_path / "mine" / "sub-01_epo.fif").symlink_to("stored.txt")
    assert overview.notes(tmp_path / "mine") == [], "a link within it"
    write(tmp_path / "theirs" / ("sub-02" if what == "sub-02" else ""), "sub-02_epo.fif")
    (tmp_path / "mine" / what).symlink_to(tmp_path / "theirs" / what)
    assert overview.notes(tmp_path / "mine") == [
        "links that lead out of the folder, followed: sub-02_epo.fif"
    ]


def test_all_that_is_found_is_told(tmp_path):
    names = {"hit": 1, "miss": 2, "rest": 3}
    write(tmp_path, "sub-01_ses-1_epo.fif", labels=(0, 1, 2, 0) * 5, events=names)
    write(
        tmp_path, "sub-02_epo.fif", (*NAMES, "EOG1"), change=lambda e: e.info["bads"].append("C3")
    )
    write(tmp_path, "sub-02_ses-x_epo.fif")
    (tmp_path / "eva_epo.fif").write_text("")
    lines = overview.describe(tmp_path).splitlines()
    assert lines[0] == f"EEG in {tmp_path}: 2 people, 3 sessions, 3 recordings"
    assert lines[2].split() == ("sub-01_ses-1_epo.fif 20 x 0.705 s 200 5 0 0 to 100 -".split())
    assert lines[3].split()[-1] == "C3" and lines[3].split()[7] == "1"
    start = next(i for i, line in enumerate(lines) if "--events names" in line) + 1
    table = [line.split() for line in lines[start : start + 6]]
    assert table == [
        ["01", "02"], ["correct", "0", "12"], ["error", "0", "12"], ["hit", "10", "0"],
        ["miss", "5", "0"], ["rest", "5", "0"],
    ]  # fmt: skip
    assert lines[start + 6] == "channels in all files: Fz Cz Pz C3 C4"
    assert lines[start + 7].startswith("ignored: eva_epo.fif: not named sub-XX")
