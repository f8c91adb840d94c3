"""A folder of your own epochs, MNE files ``sub-XX[_ses-YY]_epo.fif``."""

import re
from pathlib import Path

import mne
import numpy as np

from rlihf_lib.eeg.channels import refuse_unlocated, require_channels, set_positions
from rlihf_lib.eeg.dataset import check_subject

#: Of the channels that are read; EOG is decoded only to see what the eyes tell.
TYPES = ("eeg", "eog")
_FILE = re.compile(r"sub-(?P<subject>[^_]+)(?:_ses-(?P<session>[^_]+))?_epo\.fif")


def subjects(folder):
    """Subjects of a folder, sorted."""
    return sorted({match["subject"] for _, match in _files(folder)})


def read_folder_epochs(folder, subject, correct="correct", error="error", drop=()):
    """Epochs of one subject of a folder, its sessions joined in the order of their names.

    Parameters
    ----------
    folder : str or Path
        Holds ``sub-XX_epo.fif`` or ``sub-XX_ses-YY_epo.fif``.
    subject : str
        The XX.
    correct, error : str
        Names of the two events in the files; epochs of other events are left out.
    drop : sequence of str
        Channels left out, in the sessions that have them.

    Returns
    -------
    data : ndarray, shape (n_epochs, n_channels, n_times)
        Volts, EEG and EOG channels in the order of the first session.
    info : mne.Info
    tmin : float
        Time of the first sample relative to the event, s.
    labels : ndarray of int, shape (n_epochs,)
        0 correct, 1 error.
    sessions : ndarray of str, shape (n_epochs,)

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    ValueError
        If the subject is unknown, sessions differ in sampling rate, window or channels, a value is
        NaN, the subject has no epoch of one class, no file has a channel of a name to drop, or an
        EEG channel has no position.

    Notes
    -----
    Channels of other types than EEG and EOG are left out.
    """
    sources = sorted(
        (match["session"] or "", path)
        for path, match in _files(folder)
        if match["subject"] == check_subject(subject, subjects(folder), folder)
    )
    data, labels, sessions, found, first = [], [], [], set(), None
    for session, path in sources:
        epochs = _read(mne.read_epochs, path)
        found |= set(epochs.event_id)
        codes = {epochs.event_id[name]: i for i, name in enumerate((correct, error))
                 if name in epochs.event_id}  # fmt: skip
        kept = _kept(epochs.info, drop, path)
        epochs = epochs.pick(kept)[np.isin(epochs.events[:, 2], list(codes))]
        first = first or epochs
        require_channels(epochs.ch_names, first.ch_names, path)
        same = (epochs.info["sfreq"], epochs.tmin, len(epochs.times))
        if same != (first.info["sfreq"], first.tmin, len(first.times)):
            raise ValueError(
                f"{path}: sampling rate, window start and samples {same} differ from those of "
                f"{sources[0][1].name}; export all sessions of a subject alike"
            )
        order = [epochs.ch_names.index(name) for name in first.ch_names]
        values = epochs.get_data(copy=False)[:, order]
        if not np.isfinite(values).all():
            raise ValueError(f"{path} holds NaN or infinite values; drop or repair those epochs")
        data.append(values)
        labels += [codes[code] for code in epochs.events[:, 2]]
        sessions += [session] * len(epochs)
    labels = np.array(labels, dtype=int)
    for label, name in enumerate((correct, error)):
        if not (labels == label).any():
            raise ValueError(
                f"{folder}: subject {subject} has no epoch of the event {name!r} (its events: "
                f"{', '.join(sorted(found)) or 'none'}); name the two with --events OK ERR"
            )
    set_positions(first)
    refuse_unlocated(first.info, sources[0][1])
    return np.concatenate(data), first.info, first.tmin, labels, np.array(sessions)


def other_channels(folder, drop=()):
    """Channels of a folder that are neither EEG nor EOG, nor dropped: never decoded.

    Returns
    -------
    dict of str to str
        Type by name, such as {"STI 014": "stim"}.
    """
    types = _channel_types(folder).items()
    return {n: kind for n, kind in types if kind not in TYPES and n not in drop}


def _channel_types(folder):
    """Type by name of the channels of all files; of those of several types, the first."""
    types = {}
    for path, _ in _files(folder):
        info = _read(mne.io.read_info, path)
        types = dict(zip(info.ch_names, info.get_channel_types(), strict=True)) | types
    return types


def _read(reader, path):
    try:
        return reader(path, verbose="error")
    except Exception as problem:
        raise ValueError(
            f"{path} cannot be read as MNE epochs ({problem}); copy it anew"
        ) from problem


def _kept(info, drop, path):
    """Names of the EEG and EOG channels of a file without those to drop."""
    # Not every file needs to have what another one has too much.
    if not set(drop) <= set(info.ch_names):
        known = _channel_types(path.parent)
        unknown = [name for name in drop if name not in known]
        if unknown:
            raise ValueError(
                f"{path.parent} has no channel {', '.join(unknown)} to drop; it has "
                f"{', '.join(known)}"
            )
    types = dict(zip(info.ch_names, info.get_channel_types(), strict=True))
    kept = [name for name, kind in types.items() if kind in TYPES and name not in drop]
    if "eeg" not in {types[name] for name in kept}:
        there = ", ".join(f"{name} ({kind})" for name, kind in types.items())
        raise ValueError(
            f"{path} has no EEG channel left; it has {there}, to drop are "
            f"{', '.join(drop) or 'none'}; drop fewer, or set the channels' types in the file"
        )
    return kept


def _files(folder):
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{folder} is not a folder; eeg takes 'simulated', 'hri', or a folder of epochs "
            "named sub-XX[_ses-YY]_epo.fif"
        )
    found = [(path, _FILE.fullmatch(path.name)) for path in sorted(folder.iterdir())]
    found = [(path, match) for path, match in found if match]
    if not found:
        raise ValueError(f"{folder} holds no file named sub-XX[_ses-YY]_epo.fif")
    return found
