"""Continuous EEGLAB recordings; folders of one's own epochs, ``sub-XX[_ses-YY]_epo.fif`` of MNE."""

import re
from pathlib import Path

import mne
import numpy as np
import pandas as pd

from rlihf_lib.eeg.channels import refuse_unlocated, require_channels, set_positions

#: Of the channels that are read from a folder; EOG is decoded only to see what the eyes tell.
TYPES = ("eeg", "eog")
EVENT_ID = {"correct": 1, "error": 2}
_FILE = re.compile(r"sub-([^_]+)(?:_ses-([^_]+))?_epo\.fif")


def read_eeglab(path) -> mne.io.RawArray:
    """Read a continuous EEGLAB recording strictly, its data in the `.set` or a `.fdt` beside it.

    Channels are typed (names with EOG are ``eog``, all others ``eeg``) and have the 10-05 positions
    of their names; repeated EOG labels are numbered. Events are annotations, without those past
    the end of the data, of which MNE warns. Integers and digits, ``4``, are taken as the
    BrainVision marker they stand for, ``S  4``. A FileNotFoundError says if a file is missing, a
    ValueError if one is truncated, not EEGLAB's, epoched, holds NaN, or repeats an EEG channel.
    """
    path = Path(path)
    try:
        recorded = mne.io.read_raw_eeglab(path, verbose="warning")
    except FileNotFoundError:
        raise
    except Exception as problem:
        raise ValueError(
            f"{path} is not a readable continuous EEGLAB recording ({problem}); if it is truncated "
            "copy it anew, if it is epoched or in MATLAB v7.3 form save it in EEGLAB as continuous "
            "data with the option 'Save files in v6 format' (File > Preferences)"
        ) from problem
    names = _channel_names(recorded.ch_names, path)
    file, expected = Path(recorded.filenames[0]), len(names) * recorded.n_times * 4
    if file.suffix == ".fdt" and (size := file.stat().st_size) != expected:
        raise ValueError(
            f"{file} has {size} bytes, expected {expected} ({len(names)} channels x "
            f"{recorded.n_times} samples x 4 bytes); it is truncated or belongs to "
            "another .set, copy it anew"
        )
    data, sfreq = recorded.get_data(), recorded.info["sfreq"]
    if len(bad := np.argwhere(~np.isfinite(data))):
        channel, sample = bad[0]
        raise ValueError(
            f"{path}: {len(bad)} samples are NaN or infinite, the first in channel "
            f"{names[channel]} at {sample / sfreq:.3f} s; interpolate or cut them in EEGLAB"
        )
    types = ["eog" if "EOG" in name.upper() else "eeg" for name in names]
    raw = mne.io.RawArray(data, mne.create_info(names, sfreq, types), verbose="error")
    set_positions(raw)
    events = recorded.annotations
    raw.set_annotations(mne.Annotations(events.onset, 0, list(map(_marker, events.description))))
    return raw


def folder_subjects(folder) -> list[str]:
    """Subjects of a folder of epochs, the XX of its files, sorted."""
    return sorted({subject for subject, _, _ in _files(folder)})


def read_folder_epochs(folder, subject, events=("correct", "error"), drop=()) -> mne.EpochsArray:
    """Epochs of one subject of a folder, its sessions joined in the order of their names.

    `events` are the names of correct and error in the files, of which epochs of other events and
    the channels to drop are left out. EEG and EOG channels are in the order of the first session;
    the metadata hold subject, session, epoch and label. A FileNotFoundError says if there is no
    such folder; a ValueError if the subject is unknown, sessions differ in sampling rate, window or
    channels, a value is NaN, the subject has no epoch of one class, no file has a channel of a name
    to drop, or an EEG channel has no position.
    """
    check_subject(subject, folder_subjects(folder), folder)
    paths = {session: path for name, session, path in _files(folder) if name == subject}
    sessions = [_read_session(*file, events, drop) for file in paths.items()]
    first = sessions[0]
    data = [_values(*pair, first) for pair in zip(sessions, paths.values(), strict=True)]
    table = pd.concat([epochs.metadata for epochs in sessions], ignore_index=True)
    for label, event in enumerate(events):
        if not (table["label"] == label).any():
            files = [_read(mne.read_epochs, path) for path in paths.values()]
            found = {name for epochs in files for name in epochs.event_id}
            raise ValueError(
                f"{folder}: subject {subject} has no epoch of the event {event!r} (its events: "
                f"{', '.join(sorted(found)) or 'none'}); name the two with --events OK ERR"
            )
    table.insert(0, "subject", subject)
    table.insert(2, "epoch", np.arange(len(table)))
    set_positions(first)
    refuse_unlocated(first.info, next(iter(paths.values())))
    return labelled_epochs(np.concatenate(data), first.info, first.tmin, table)


def labelled_epochs(data, info, tmin, metadata) -> mne.EpochsArray:
    """Epochs with events ``correct`` and ``error`` from data in volts that start `tmin` s after it.

    The metadata hold label (0 correct, 1 error) and epoch or, of a recording, sample.
    """
    # Distinct first samples, which MNE demands; folders have no continuous time.
    first = metadata["sample"] if "sample" in metadata else metadata["epoch"]
    events = np.column_stack([first, np.zeros(len(data), int), metadata["label"] + 1]).astype(int)
    return mne.EpochsArray(
        data, info, events, tmin=tmin, event_id=EVENT_ID, metadata=metadata, proj=False,
        verbose="error",
    )  # fmt: skip


def other_channels(folder, drop=()) -> dict[str, str]:
    """Type by name of a folder's channels that are neither EEG nor EOG, nor dropped."""
    types = _channel_types(*(path for *_, path in _files(folder)))
    return {n: kind for n, kind in types.items() if kind not in TYPES and n not in drop}


def check_subject(subject, subjects, source) -> None:
    """Refuse a subject that is not one of `subjects`, and say which there are."""
    if subject not in subjects:
        known = ", ".join(subjects)
        raise ValueError(f"unknown subject {subject!r} in {source}; choose one of {known}")


def _channel_names(names, path):
    """Labels as in the file, where MNE has numbered those that it repeats: EOG-0, EOG-1."""
    labels = [re.sub(r"-\d+$", "", name) for name in names]
    repeated = {label for label in labels if labels.count(label) > 1}
    refused = sorted(label for label in repeated if "EOG" not in label.upper())
    if refused:
        raise ValueError(f"{path}: channel {', '.join(refused)} occurs twice; rename one of them")
    numbers = iter(range(1, len(names) + 1))
    return [f"EOG{next(numbers)}" if repeated and "EOG" in name.upper() else name for name in names]


def _marker(kind):
    """Name of an event in BrainVision's form: S6, 6 and 6.0 are "S  6"."""
    marker = re.fullmatch(r"([SR]?)\s*(\d+)(?:\.0)?", kind.strip())
    return f"{marker[1] or 'S'}{int(marker[2]):3d}" if marker else kind.strip()


def _read_session(session, path, events, drop):
    """Epochs of the two events on the channels that are kept, session and label in the metadata."""
    epochs = _read(mne.read_epochs, path)
    codes = {epochs.event_id.get(event): label for label, event in enumerate(events)}
    labels = pd.Series(epochs.events[:, 2]).map(codes)
    epochs = epochs.pick(_kept(path, drop))[labels.notna().to_numpy()]
    epochs.metadata = pd.DataFrame({"session": session, "label": labels.dropna().to_numpy(int)})
    return epochs


def _values(epochs, path, first):
    """Data of a session in the channel order of the first, whose layout it must have."""
    require_channels(epochs.ch_names, first.ch_names, path)
    layout, expected = ((e.info["sfreq"], e.tmin, len(e.times)) for e in (epochs, first))
    if layout != expected:
        raise ValueError(
            f"{path}: sampling rate, window start and samples {layout} differ from those of the "
            f"first session, {expected}; export all sessions of a subject alike"
        )
    values = epochs.get_data(picks=first.ch_names)
    if not np.isfinite(values).all():
        raise ValueError(f"{path} holds NaN or infinite values; drop or repair those epochs")
    return values


def _channel_types(*paths):
    """Type by name of the channels of files; of those of several types, the first."""
    types: dict[str, str] = {}
    for path in paths:
        info = _read(mne.io.read_info, path)
        types = dict(zip(info.ch_names, info.get_channel_types(), strict=True)) | types
    return types


def _read(reader, path):
    try:
        return reader(path, verbose="error")
    except Exception as problem:
        message = f"{path} cannot be read as MNE epochs ({problem}); copy it anew"
        raise ValueError(message) from problem


def _kept(path, drop):
    """Names of the EEG and EOG channels of a file without those to drop."""
    types = _channel_types(path)
    # Not every file needs to have what another one has too much.
    if not set(drop) <= set(types):
        known = _channel_types(*(path for *_, path in _files(path.parent)))
        if unknown := ", ".join(name for name in drop if name not in known):
            raise ValueError(
                f"{path.parent} has no channel {unknown} to drop; it has {', '.join(known)}"
            )
    kept = [name for name, kind in types.items() if kind in TYPES and name not in drop]
    if "eeg" not in {types[name] for name in kept}:
        there = ", ".join(f"{name} ({kind})" for name, kind in types.items())
        raise ValueError(
            f"{path} has no EEG channel left; it has {there}, to drop are "
            f"{', '.join(drop) or 'none'}; drop fewer, or set the channels' types in the file"
        )
    return kept


def _files(folder):
    """Subject, session ("" if it has none) and path of the epochs of a folder, sorted."""
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{folder} is not a folder; eeg takes 'simulated', 'hri', or a folder of epochs "
            "named sub-XX[_ses-YY]_epo.fif"
        )
    matches = [(_FILE.fullmatch(path.name), path) for path in folder.iterdir()]
    found = [(match[1], match[2] or "", path) for match, path in matches if match]
    if not found:
        raise ValueError(f"{folder} holds no file named sub-XX[_ses-YY]_epo.fif")
    return sorted(found)
