"""Files of every format that MNE reads for us: signals in volts, events by name, bad channels."""

import os
import re
import zlib

import mne
import numpy as np
import pytest

from rlihf_lib.eeg import formats, overview
from rlihf_lib.eeg.eeglab import read_eeglab
from rlihf_lib.eeg.folders import find
from rlihf_lib.eeg.preprocessing import Preprocessing, load_continuous, load_epochs, load_events
from tests.eeg import writers

NUMBERS = {"correct": "4", "error": "6"}
NAMED = Preprocessing(reference="recorded")
NUMBERED = Preprocessing(reference="recorded", correct_event="4", error_event="6")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine").mkdir()
    return tmp_path / "mine"


@pytest.fixture(scope="module")
def planted():
    return writers.planted(0)


def numbered(events):
    return [(at, NUMBERS[name]) for at, name in events]


FORMATS = {
    "sub-01_eeg.fif": (writers.fif, False),
    "sub-01_raw.fif.gz": (writers.fif, False),
    "sub-01_eeg.set": (writers.eeglab, False),
    "sub-01_eeg.vhdr": (writers.brainvision, False),
    "sub-01_eeg.edf": (writers.edf, True),
    "sub-01_eeg.bdf": (writers.edf, True),
    "sub-01_eeg.gdf": (writers.gdf, True),
}


@pytest.mark.parametrize("name", FORMATS)
def test_a_continuous_recording_of_any_format_becomes_the_same_epochs(folder, planted, name):
    signal, events = planted
    write, digits = FORMATS[name]
    write(folder / name, signal, numbered(events) if digits else events)
    epochs = load_epochs(folder, "01", NUMBERED if digits else NAMED)
    filtered = writers.raw_of(signal).filter(1, 20, verbose="error").get_data()
    expected = [filtered[:, at : at + 2 * writers.SFREQ] for at, _ in events]
    assert epochs.ch_names == list(writers.NAMES) and epochs.event_id == {"correct": 1, "error": 2}
    # EDF and GDF have 16 bits.
    np.testing.assert_allclose(epochs.get_data(), expected, atol=2e-9)
    assert epochs.metadata["label"].tolist() == [int(kind == "error") for _, kind in events]


@pytest.mark.parametrize("trigger", ["Status", "trigger"])
@pytest.mark.parametrize("ending", ["edf", "bdf"])
def test_a_trigger_channel_is_never_decoded(folder, planted, ending, trigger):
    signal, events = planted
    writers.edf(folder / f"sub-01_eeg.{ending}", signal, numbered(events), trigger=trigger)
    assert load_epochs(folder, "01", NUMBERED).ch_names == list(writers.NAMES)
    assert overview.notes(folder) == [f"left out: {trigger} (of type stim)"]


@pytest.mark.parametrize("ending", ["edf", "bdf"])
def test_a_trigger_channel_that_holds_its_value_tells_rises_and_falls(folder, planted, ending):
    signal, events = planted
    path = folder / f"sub-01_eeg.{ending}"
    writers.edf(path, signal, [(0, "9"), *numbered(events)], hold=True)
    alternate = [name for i, (_, name) in enumerate(events) if not i or name != events[i - 1][1]]
    labels = load_events(folder, "01", NUMBERED)["label"].tolist()
    assert labels == [int(name == "error") for name in alternate]


@pytest.mark.parametrize("name", ["sub-01_eeg.fif", "sub-01_eeg.set", "sub-01_eeg.vhdr"])
def test_a_trigger_among_the_electrodes_is_refused_by_name(folder, planted, name):
    signal, events = planted
    pulses = np.zeros((1, signal.shape[1]))
    for at, kind in events:
        pulses[0, at : at + 9] = 50 * (kind == "error")
    names = (*writers.NAMES, "Status")
    FORMATS[name][0](folder / name, np.vstack([signal, pulses]), events, names)
    with pytest.raises(ValueError, match=rf"{name}: EEG channel Status has no position"):
        load_epochs(folder, "01", NAMED)
    assert "no place on the scalp, so --drop-channels them: Status" in overview.describe(folder)


@pytest.mark.parametrize("tmin", [0.0, -0.25])
def test_epochs_of_eeglab_keep_their_window(folder, tmin):
    rng = np.random.default_rng(0)
    values, names = rng.normal(0, 5, (20, 5, 100)), ["error", "correct"] * 10
    writers.eeglab_epochs(folder / "sub-01_eeg.set", values, names, tmin)
    epochs = load_epochs(folder, "01", NAMED)
    np.testing.assert_allclose(epochs.get_data(), 1e-6 * values, atol=1e-11)
    assert epochs.tmin == tmin and epochs.metadata["label"].tolist() == [1, 0] * 10


def test_bids_tables_name_events_types_and_bad_channels(tmp_path, folder, planted):
    signal, events = planted
    broken = np.vstack([signal, 500 * signal[:1], signal[:1]])
    names = [*writers.NAMES, "Oz", "X1"]
    inside = folder / "sub-01" / "eeg"
    inside.mkdir(parents=True)
    stem = inside / "sub-01_task-errp"
    writers.brainvision(stem.with_name(f"{stem.name}_eeg.vhdr"), broken, [(9, "S  9")], names)
    rows = [f"{at / writers.SFREQ}\t0\t{name}\t1" for at, name in events]
    text = "onset\tduration\ttrial_type\tvalue\n" + "\n".join(rows) + "\nn/a\t0\terror\t1\n"
    stem.with_name(f"{stem.name}_events.tsv").write_text(text)
    rows = [f"{name}\tEEG\tµV\tgood" for name in writers.NAMES]
    rows += ["Oz\tEEG\tµV\tbad", "X1\tVEOG\tµV\tgood"]
    text = "name\ttype\tunits\tstatus\n" + "\n".join(rows) + "\n"
    stem.with_name(f"{stem.name}_channels.tsv").write_text(text, encoding="utf-8")
    epochs = load_epochs(folder, "01", NAMED)
    assert epochs.get_channel_types() == ["eeg"] * 6 + ["eog"]
    assert epochs.metadata["label"].sum() == 10 and epochs.info["bads"] == []
    assert np.ptp(epochs.get_data("Oz")) < 100e-6, "interpolated"
    assert overview.notes(folder) == ["interpolated, marked bad in sub-01_task-errp_eeg.vhdr: Oz"]
    stem.with_name(f"{stem.name}_events.tsv").write_text("onset\tvalue\n1.0\tn/a\n")
    with pytest.raises(ValueError, match=r"_events\.tsv has neither a trial_type nor a value"):
        load_epochs(folder, "01", NAMED)
    stem.with_name(f"{stem.name}_events.tsv").write_text("time\n1.0\n")
    with pytest.raises(ValueError, match=r"_events\.tsv has no column onset"):
        load_epochs(folder, "01", NAMED)


def test_a_value_names_events_where_no_trial_type_does(folder, planted):
    signal, events = planted
    writers.fif(folder / "sub-01_eeg.fif", signal, [])
    rows = [f"{at / writers.SFREQ}\tn/a\t{NUMBERS[name]}" for at, name in events]
    table = "onset\ttrial_type\tvalue\n" + "\n".join(rows) + "\n"
    (folder / "sub-01_events.tsv").write_text(table)
    assert load_epochs(folder, "01", NUMBERED).metadata["label"].sum() == 10


def test_events_are_listed_as_they_are_to_be_named(folder, planted):
    signal, events = planted
    marked = [(at, {"correct": "S  4", "error": "S  6"}[name]) for at, name in events]
    writers.brainvision(folder / "sub-01_eeg.vhdr", signal, marked)
    text = overview.describe(folder)
    assert "Stimulus/S  4  20" in text and "Stimulus/S  6  10" in text
    for names in (("Stimulus/S  4", "Stimulus/S  6"), ("S  4", "S  6")):
        settings = Preprocessing(correct_event=names[0], error_event=names[1])
        assert load_epochs(folder, "01", settings).metadata["label"].sum() == 10
    with pytest.raises(ValueError, match=r"'S  5' .*Stimulus/S  4, Stimulus/S  6.*--events OK ERR"):
        load_epochs(folder, "01", Preprocessing(correct_event="S  4", error_event="S  5"))
    with pytest.raises(ValueError, match=r"event 'Stimulus/S  4' is both, 'Stimulus' and 'S  4'"):
        load_epochs(folder, "01", Preprocessing(correct_event="Stimulus", error_event="S  4"))


def test_stretches_marked_bad_and_cuts_are_no_epochs(folder, planted):
    signal, events = planted
    second, third = (events[i][0] / writers.SFREQ for i in (1, 2))
    raw = writers.raw_of(signal, events)
    raw.annotations.append([second + 1, third + 1], [0.1, 0], ["BAD blink", "boundary"])
    raw.save(folder / "sub-01_raw.fif", verbose="error")
    table = load_events(folder, "01", NAMED)
    assert table["status"].tolist() == ["kept", "artefact", "artefact"] + ["kept"] * 27
    assert load_epochs(folder, "01", NAMED).metadata["epoch"].tolist() == [0, *range(3, 30)]


def test_recordings_of_one_person_follow_one_another_in_the_stream(folder):
    for run, n, sfreq in ((1, 12, 128), (2, 15, 128), (10, 9, 256)):
        signal, events = writers.planted(run, n)
        fine = np.repeat(signal, sfreq // 128, axis=1)
        at = [(sample * sfreq // 128, name) for sample, name in events]
        path = folder / f"sub-01_ses-{run % 2}_run-{run}_eeg.fif"
        writers.fif(path, fine, at, sfreq=sfreq)
    rest, _ = writers.planted(11)
    writers.fif(folder / "sub-01_task-rest_eeg.fif", rest, [(99, "eyes closed")])
    epochs, (raw, events) = (load(folder, "01", NAMED) for load in (load_epochs, load_continuous))
    assert raw.info["sfreq"] == epochs.info["sfreq"] == 128, "what all can be brought to"
    assert events["epoch"].tolist() == list(range(36))
    # Natural order of names: run 2 before run 10, both of session 0; then run 1.
    assert epochs.metadata["session"].tolist() == ["0"] * 24 + ["1"] * 12
    for epoch, first in zip(epochs.get_data(), epochs.metadata["sample"], strict=True):
        np.testing.assert_array_equal(epoch, raw.get_data()[:, first : first + 256])


def test_events_near_the_ends_are_no_epochs(folder, planted):
    signal, events = planted
    n = signal.shape[1]
    writers.fif(folder / "sub-01_eeg.fif", signal, [(10, "error"), *events, (n - 200, "correct")])
    before = Preprocessing(reference="recorded", before=0.2)
    status = load_events(folder, "01", before)["status"].tolist()
    assert status == ["past the end"] + ["kept"] * 30 + ["past the end"]
    assert load_epochs(folder, "01", before).tmin == pytest.approx(-0.2, abs=0.01)


def test_an_offset_is_filtered_where_that_can_be_done(folder, planted):
    signal, events = planted
    writers.fif(folder / "sub-01_eeg.fif", signal, events)
    clean = load_epochs(folder, "01", NAMED).get_data()
    writers.fif(folder / "sub-01_eeg.fif", signal + 5000, events)
    np.testing.assert_allclose(load_epochs(folder, "01", NAMED).get_data(), clean, atol=1e-7)


def test_a_later_change_is_not_served_from_the_cache(folder, planted):
    signal, events = planted
    writers.fif(folder / "sub-01_eeg.fif", signal, events)
    first = load_epochs(folder, "01", NAMED)
    other = signal[:4]
    writers.fif(folder / "sub-02_eeg.fif", other, events, writers.NAMES[:4])
    assert load_epochs(folder, "01", NAMED).ch_names == first.ch_names[:4], "others decide, too"


def test_a_full_cache_is_named_and_what_was_half_written_is_not_believed(
    full_disk, folder, planted, monkeypatch
):
    disk, resize = full_disk
    monkeypatch.setenv("RLIHF_CACHE", str(disk))
    writers.fif(folder / "sub-01_eeg.fif", *planted)
    for pages in (1, 8, 30):
        resize(pages)
        with pytest.raises(OSError, match=rf"cannot write {disk}/.* full .*, or .* RLIHF_CACHE"):
            load_epochs(folder, "01", NAMED)
        assert not [path for path in disk.rglob("*") if path.is_file()]
    resize(10_000)
    values = load_epochs(folder, "01", NAMED).get_data()
    monkeypatch.setenv("RLIHF_CACHE", str(folder.parent / "other"))
    np.testing.assert_array_equal(load_epochs(folder, "01", NAMED).get_data(), values)


@pytest.mark.parametrize("name", ["sub-01_eeg.set", "sub-01_eeg.vhdr"])
def test_a_missing_companion_is_named(folder, planted, name):
    FORMATS[name][0](folder / name, *planted)
    other = {"set": ".fdt", "vhdr": ".eeg"}[name.split(".")[1]]
    (folder / name).with_suffix(other).unlink()
    with pytest.raises(FileNotFoundError, match=rf"{name} is not complete \(.*{other}"):
        load_epochs(folder, "01", NAMED)


def epochs_of(n):
    return mne.EpochsArray(
        np.random.default_rng(0).normal(0, 1e-5, (n, 5, 500)),
        mne.create_info(list(writers.NAMES), 100.0, "eeg"),
        np.column_stack([np.arange(n), np.zeros(n, int), np.arange(n) % 2 + 1]),
        event_id={"correct": 1, "error": 2},
        verbose="error",
    )


def test_a_recording_that_was_split_as_in_bids_is_read_whole(folder):
    signal, events = writers.planted(0, n=200, spacing=2.5)
    names = mne.channels.make_standard_montage("standard_1020").ch_names[:20]
    raw = writers.raw_of(np.tile(signal, (4, 1)), events, names)
    name = folder / "sub-01_task-errp_eeg.fif"
    raw.save(name, split_size="2MB", split_naming="bids", verbose="error")
    (recording,), ignored = find(folder)
    assert len(recording.files) > 1 and not ignored
    assert len(load_epochs(folder, "01", NAMED)) == 200
    recording.files[-1].unlink()
    with pytest.raises(ValueError, match=r"split-01_eeg\.fif cannot be read .*next file .*split-"):
        load_epochs(folder, "01", NAMED)


def test_compressed_epochs_are_those_that_were_saved(folder):
    for ending in ("02_epo.fif", "01_epo.fif.gz"):
        epochs_of(20).save(folder / f"sub-{ending}", verbose="error")
    plain, packed = (load_epochs(folder, who, NAMED) for who in ("02", "01"))
    assert packed.metadata["label"].tolist() == [0, 1] * 10
    np.testing.assert_array_equal(packed.get_data(), plain.get_data())


def test_a_missing_part_of_a_split_file_is_named(folder):
    epochs = epochs_of(300)
    epochs.save(folder / "sub-01_epo.fif", split_size="2MB", verbose="error")
    (recording,), _ = find(folder)
    assert len(recording.files) > 2 and len(load_epochs(folder, "01", NAMED)) == 300
    recording.files[-1].unlink()
    with pytest.raises(FileNotFoundError, match=r"sub-01_epo\.fif is not complete"):
        load_epochs(folder, "01", NAMED)


@pytest.mark.parametrize("ending", ["fif", "fif.gz", "set", "vhdr", "edf", "bdf", "gdf"])
def test_a_damaged_file_is_named(folder, ending):
    (folder / f"sub-01_eeg.{ending}").write_bytes(b"<html>")
    with pytest.raises(ValueError, match=rf"sub-01_eeg\.{ending} cannot be read as \.{ending}"):
        load_epochs(folder, "01", NAMED)


@pytest.mark.parametrize("name", FORMATS)
def test_flipped_bits_are_refused_by_name_or_leave_the_layout(folder, planted, name):
    """None of these formats has a checksum: what reads like EEG is EEG, anything else is named."""
    signal, events = planted
    write, digits = FORMATS[name]
    write(folder / name, signal, numbered(events) if digits else events)
    whole, rng = (folder / name).read_bytes(), np.random.default_rng(0)
    settings = NUMBERED if digits else NAMED
    refused = 0
    for _ in range(12):
        flipped = bytearray(whole)
        flipped[rng.integers(min(len(whole), 2000))] ^= 1 << rng.integers(8)
        (folder / name).write_bytes(flipped)
        try:
            epochs = load_epochs(folder, "01", settings)
        except (ValueError, OSError) as error:
            assert "01" in str(error), error
            refused += 1
        else:
            assert len(epochs.ch_names) <= 5 and len(epochs) <= 30
    assert refused


def test_nan_is_refused_with_its_channel_and_time(folder, planted):
    signal, events = planted
    signal = signal.copy()
    signal[1, 64] = np.nan
    writers.brainvision(folder / "sub-01_eeg.vhdr", signal, events)
    with pytest.raises(ValueError, match=r"vhdr: 1 samples .* channel Cz at 0\.500 s"):
        load_epochs(folder, "01", NAMED)


@pytest.mark.parametrize("kind, said", [("misc", "Fz \\(misc\\)"), ("ecog", "Fz \\(ecog\\)")])
def test_a_file_without_eeg_is_named_with_what_it_has(folder, planted, kind, said):
    signal, events = planted
    writers.fif(folder / "sub-01_eeg.fif", signal, events, types=kind)
    with pytest.raises(ValueError, match=rf"sub-01_eeg\.fif has no EEG channel, it has {said}"):
        load_epochs(folder, "01", NAMED)


@pytest.mark.parametrize("sfreq", ["20", "1e+09"])
def test_a_rate_too_low_or_past_belief_is_refused(folder, planted, sfreq):
    signal, events = planted
    writers.fif(folder / "sub-01_eeg.fif", signal, events, sfreq=float(sfreq))
    with pytest.raises(ValueError, match=rf"{re.escape(sfreq)} Hz; at least 50 Hz are needed, at"):
        load_epochs(folder, "01", NAMED)


def test_epochs_and_recordings_do_not_mix(folder, planted):
    writers.fif(folder / "sub-01_eeg.fif", *planted)
    values = np.random.default_rng(0).normal(0, 5, (20, 5, 100))
    writers.eeglab_epochs(folder / "sub-02_eeg.set", values, ["error", "correct"] * 10)
    with pytest.raises(ValueError, match=r"sub-01_eeg.fif is a .*, .*sub-02_eeg.set holds epochs"):
        load_epochs(folder, "01", NAMED)


def test_a_file_is_opened_with_its_projectors_unapplied(folder, planted):
    signal, events = planted
    raw = writers.raw_of(signal, events).set_eeg_reference(projection=True, verbose="error")
    raw.save(folder / "sub-01_eeg.fif", verbose="error")
    common = load_epochs(folder, "01", NAMED).get_data().mean(axis=1)
    assert np.abs(common).max() > 1e-6
    (note,) = overview.notes(folder)
    assert note.startswith("projectors that files hold but don't apply are not applied: sub-01")
    assert formats.header(find(folder)[0][0]).unapplied == ("Average EEG reference",)


def test_names_of_edf_may_begin_with_their_type(folder, planted):
    signal, events = planted
    names = [f"EEG {name}" for name in writers.NAMES]
    writers.edf(folder / "sub-01_eeg.edf", signal, numbered(events), names)
    assert load_epochs(folder, "01", NUMBERED).ch_names == list(writers.NAMES)


@pytest.mark.parametrize("in_table", ["EEG {}", "{}"])
def test_names_of_edf_that_begin_with_their_type_are_found_in_bids_tables(
    folder, planted, in_table
):
    signal, events = planted
    names = [f"EEG {name}" for name in (*writers.NAMES, "Oz", "X1")]
    broken = np.vstack([signal, 500 * signal[:1], signal[:1]])
    writers.edf(folder / "sub-01_eeg.edf", broken, numbered(events), names)
    said = dict.fromkeys(writers.NAMES, "EEG\tgood") | {"Oz": "EEG\tbad", "X1": "VEOG\tgood"}
    rows = [f"{in_table.format(name)}\t{rest}" for name, rest in said.items()]
    (folder / "sub-01_channels.tsv").write_text("\n".join(["name\ttype\tstatus", *rows]))
    (recording,), _ = find(folder)
    told = formats.header(recording)
    assert told.bads == ("Oz",) and told.types["X1"] == "eog" and told.types["Fz"] == "eeg"


def pack(path, n_bytes, kind=b"IM"):
    """A MATLAB file of a few bytes, one part of which says that it unpacks to so many."""
    order = "little" if kind == b"IM" else "big"
    packed = zlib.compress((14).to_bytes(4, order) + n_bytes.to_bytes(4, order) + bytes(1000))
    tag = (15).to_bytes(4, order) + len(packed).to_bytes(4, order)
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1" + kind + 20 * (tag + packed))


@pytest.mark.parametrize("kind", [b"IM", b"MI"])
def test_a_file_that_unpacks_to_more_than_memory_is_refused_unread(kind, folder, monkeypatch):
    pack(folder / "sub-01_eeg.set", 2**32 - 1, kind)
    monkeypatch.setattr(os, "sysconf", lambda name: 2**15)  # 1 GiB
    monkeypatch.setattr(mne.io, "read_raw", lambda *_, **__: pytest.fail("it was read"))
    monkeypatch.setattr(mne.io, "read_raw_eeglab", lambda *_, **__: pytest.fail("it was read"))
    with pytest.raises(ValueError, match=r"sub-01_eeg\.set says that it holds 80\.0 GiB"):
        load_epochs(folder, "01", NAMED)
    with pytest.raises(ValueError, match=r"sub-01_eeg\.set says that it holds 80\.0 GiB"):
        read_eeglab(folder / "sub-01_eeg.set")


@pytest.mark.parametrize("name", FORMATS)
def test_signals_that_memory_cannot_hold_are_refused(name, folder, planted, monkeypatch):
    signal, events = planted
    write, digits = FORMATS[name]
    write(folder / name, signal, numbered(events) if digits else events)
    monkeypatch.setattr(os, "sysconf", lambda name: 2**9)
    with pytest.raises(ValueError, match=rf"{name} says that it holds 0.0 GiB, more than half"):
        load_epochs(folder, "01", NAMED)
