"""Files of one's own EEG, read by MNE whatever their format: what they hold, events, signals."""

from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

import mne
import numpy as np
import pandas as pd

from rlihf_lib.eeg.channels import refuse_unlocated, set_positions
from rlihf_lib.eeg.eeglab import require_whole, unpacked_size
from rlihf_lib.eeg.quality import interpolate, refuse_nan, refuse_vast

#: Of the channels that are read from a folder; EOG is decoded only to see what the eyes tell.
TYPES = ("eeg", "eog")
EVENT_ID = {"correct": 1, "error": 2}
MIN_SFREQ, MAX_SFREQ = 50.0, 50e3  # Hz; error potentials need a fifth of the least
#: MNE's type of each in channels.tsv of BIDS; all others are "misc".
_OF_BIDS = {"EEG": "eeg", "EOG": "eog", "VEOG": "eog", "HEOG": "eog", "ECG": "ecg", "EMG": "emg",
            "TRIG": "stim"}  # fmt: skip
_CUTS = ("bad", "edge", "boundary", "new segment")  # annotations that are no events


@dataclass(frozen=True)
class Header:
    """What a file says about itself."""

    sfreq: float  # Hz
    types: Mapping[str, str]  # of the channels, by name
    band: tuple[float, float]  # Hz, of the filters it went through
    bads: tuple
    unapplied: tuple  # names of projectors that are there but not applied
    n_epochs: int | None  # None of a continuous recording
    n_times: int  # of an epoch, or of all


def header(recording) -> Header:
    """Header of a file; a ValueError says if it has no EEG channel or its rate can't be."""
    stamps = tuple((file.stat().st_mtime_ns, file.stat().st_size) for file in recording.files)
    return _header(recording, stamps)


def open_recording(recording) -> mne.io.BaseRaw | mne.BaseEpochs:
    """Open a file, with types and bad channels of its channels.tsv; signals are read later.

    Projectors are not applied. A FileNotFoundError says if a part is missing, a ValueError if it
    cannot be read or is too large.
    """
    if recording.format == ".set":  # opening one reads it
        refuse_vast(unpacked_size(recording.path), recording.path)
    with _reading(recording):
        instance = _open(recording.path, recording.format, recording.has_epochs)
    if ".fif" not in recording.format:
        _set_types(instance, {n: "eog" for n in instance.ch_names if "EOG" in n.upper()})
    if table := recording.table("channels"):
        said = _read_table(table, ["name", "type"])
        # Of "EEG Fz" in EDF only "Fz" is left.
        named, rest = said["name"].isin(instance.ch_names), said["name"].str.partition(" ")[2]
        said["name"] = said["name"].where(named, rest)
        said = said.drop_duplicates("name").set_index("name").reindex(instance.ch_names)
        _set_types(instance, said["type"].dropna().map(lambda t: _OF_BIDS.get(t.upper(), "misc")))
        if "status" in said:
            bads = said.index[said["status"] == "bad"]
            instance.info["bads"] = list(dict.fromkeys([*instance.info["bads"], *bads]))
    return instance


def read_epochs(recording, channels) -> mne.BaseEpochs:
    """Epochs of a file on `channels`, in that order."""
    epochs = open_recording(recording)
    with _reading(recording), mne.use_log_level("error"):
        epochs.load_data().reorder_channels(channels)
    _complete(epochs, recording)
    return epochs


def read_raw(recording, channels) -> tuple[mne.io.RawArray, pd.DataFrame]:
    """Signal of a continuous recording on `channels`, and its `named_events`.

    Annotated in the signal are the stretches that must not be used.
    """
    opened = open_recording(recording)
    events = named_events(opened, recording)
    told = opened.annotations
    cut = [name.lower().startswith(_CUTS) for name in told.description]
    onset, duration = told.onset[cut] - opened.first_time, told.duration[cut]
    with _reading(recording):
        opened.pick(channels).load_data(verbose="error")
    info = opened.info
    for channel in info["chs"]:  # signals are in volts now; recordings of several gains are joined
        channel.update(cal=1.0, range=1.0)
    raw = mne.io.RawArray(opened.get_data(), info, verbose="error")
    # A cut has no length but the sample it lies at.
    raw.set_annotations(mne.Annotations(onset, np.maximum(duration, 1 / info["sfreq"]), "BAD"))
    _complete(raw, recording)
    return raw, events


def named_events(raw, recording) -> pd.DataFrame:
    """Events of a continuous recording: onset, s from its first sample, and name.

    Of its events.tsv (trial_type, else value), or else annotations and a trigger channel, whose
    values are the names.
    """
    if table := recording.table("events"):
        said = _read_table(table, ["onset"])
        column = next((c for c in ("trial_type", "value") if c in said and said[c].any()), None)
        if column is None:
            raise ValueError(f"{table} has neither a trial_type nor a value; name its events there")
        onset = pd.to_numeric(said["onset"], errors="coerce")
        found = pd.DataFrame({"onset": onset, "name": said[column]})
        found = found[onset.notna() & (found["name"] != "")]
        return found.sort_values("onset", kind="stable").reset_index(drop=True)
    told, sfreq = raw.annotations, raw.info["sfreq"]
    found = pd.DataFrame({"onset": told.onset - raw.first_time, "name": told.description})
    found = found[~found["name"].str.lower().str.startswith(_CUTS)]
    if "stim" in raw.get_channel_types():
        # As live (`lsl`), every change to a value is an event, however short, also a fall.
        how: dict = {"consecutive": True, "shortest_event": 1}
        if recording.format == ".bdf":  # above 16 bits BioSemi tells of its battery
            how |= {"mask": 2**16 - 1, "mask_type": "and"}
        with _reading(recording):
            pulses = mne.find_events(raw, verbose="error", **how)
        onset = (pulses[:, 0] - raw.first_samp) / sfreq
        more = pd.DataFrame({"onset": onset, "name": pulses[:, 2].astype(str)})
        found = pd.concat([found, more]).drop_duplicates().sort_values("onset", kind="stable")
    return found.reset_index(drop=True)


def labelled_epochs(data, info, tmin, metadata) -> mne.EpochsArray:
    """Epochs with events ``correct`` and ``error`` from data in volts that start `tmin` s after it.

    The metadata hold label (0 correct, 1 error) and epoch or, of a recording, sample.
    """
    # Distinct first samples, which MNE demands; folders of epochs have no continuous time.
    first = metadata["sample"] if "sample" in metadata else metadata["epoch"]
    events = np.column_stack([first, np.zeros(len(data), int), metadata["label"] + 1]).astype(int)
    return mne.EpochsArray(
        data, info, events, tmin=tmin, event_id=EVENT_ID, metadata=metadata, proj=False,
        verbose="error",
    )  # fmt: skip


def check_subject(subject, subjects, source) -> None:
    """Refuse a subject that is not one of `subjects`, and say which there are."""
    if subject not in subjects:
        known = ", ".join(subjects)
        raise ValueError(f"unknown subject {subject!r} in {source}; choose one of {known}")


@cache  # of files that stay as they are
def _header(recording, stamps):
    opened = open_recording(recording)
    info, path = opened.info, recording.path
    types = dict(zip(opened.ch_names, opened.get_channel_types(), strict=True))
    if "eeg" not in types.values():
        there = ", ".join(f"{name} ({kind})" for name, kind in types.items())
        raise ValueError(
            f"{path} has no EEG channel, it has {there}; set the channels' types in the file"
        )
    if not MIN_SFREQ <= info["sfreq"] <= MAX_SFREQ:
        raise ValueError(
            f"{path} is sampled at {info['sfreq']:g} Hz; at least {MIN_SFREQ:g} Hz are needed, at "
            f"most {MAX_SFREQ:g} believed, so export it at another rate"
        )
    n_epochs = len(opened.events) if isinstance(opened, mne.BaseEpochs) else None
    n_values = len(types) * len(opened.times) * (n_epochs or 1)
    refuse_vast(n_values * np.dtype(float).itemsize, path)
    return Header(
        sfreq=info["sfreq"],
        types=types,
        band=(info["highpass"], info["lowpass"]),
        bads=tuple(info["bads"]),
        unapplied=tuple(proj["desc"] for proj in info["projs"] if not proj["active"]),
        n_epochs=n_epochs,
        n_times=len(opened.times),
    )


def _open(path, ending, has_epochs):
    if ".fif" in ending and has_epochs:
        return mne.read_epochs(path, proj=False, preload=False, verbose="error")
    names_tell = {"infer_types": True} if ending in (".edf", ".bdf") else {}
    try:
        raw = mne.io.read_raw(path, verbose="error", **names_tell)
    except TypeError:  # it has more than one trial
        if ending != ".set":
            raise
        return mne.read_epochs_eeglab(path, verbose="error")
    if ending == ".set":
        require_whole(raw)
    return raw


@contextmanager
def _reading(recording):
    """Say which file cannot be read."""
    path = recording.path
    try:
        yield
    except FileNotFoundError as problem:
        raise FileNotFoundError(
            f"{path} is not complete ({problem}); copy all its parts, and rename none"
        ) from problem
    except Exception as problem:
        raise ValueError(
            f"{path} cannot be read as {recording.format} ({problem}); copy or export it anew"
        ) from problem


def _set_types(instance, types):
    """Set channel types, but those of trigger channels, which MNE knows."""
    known = dict(zip(instance.ch_names, instance.get_channel_types(), strict=True))
    new = {name: kind for name, kind in types.items() if known[name] not in ("stim", kind)}
    instance.set_channel_types(new, on_unit_change="ignore", verbose="error")


def _read_table(path, needed):
    """A table of BIDS as text, n/a as ""; a ValueError says if a column is missing."""
    try:
        table = pd.read_csv(path, sep="\t", dtype=str, keep_default_na=False, na_values=["n/a"])
    except ValueError as problem:
        raise ValueError(f"{path} is not a table ({problem}); write it anew") from problem
    if missing := [column for column in needed if column not in table]:
        raise ValueError(f"{path} has no column {', '.join(missing)}; add it, as BIDS demands")
    return table.fillna("")


def _complete(instance, recording):
    """Check values and places of the electrodes; interpolate bad channels."""
    info, path = instance.info, recording.path
    instance.del_proj([i for i, proj in enumerate(info["projs"]) if not proj["active"]])
    set_positions(instance)
    refuse_unlocated(info, path)
    kinds = dict(zip(instance.ch_names, instance.get_channel_types(), strict=True))
    info["bads"] = [name for name in info["bads"] if kinds[name] == "eeg"]
    good = [name for name in kinds if name not in info["bads"]]
    interpolate(instance, path)
    refuse_nan(instance.get_data(picks=good), good, info["sfreq"], path)
