"""EEG recordings: simulated ones, the ErrP-HRI data set, or a folder of your own epochs.

`simulated` and `hri` are EEGLAB files and share one reader, `read_raw`. A folder holds MNE epochs
``sub-XX[_ses-YY]_epo.fif`` and is read by `read_folder_epochs`.
"""

import re
import warnings
from pathlib import Path

import mne
import numpy as np
import scipy.io

from rlihf_lib.eeg import hri, simulated
from rlihf_lib.eeg.dataset import EEG_CHANNELS, SUBJECTS, check_subject
from rlihf_lib.eeg.leaks import is_located, refuse_unlocated

_FOLDER_FILE = re.compile(r"sub-(?P<subject>[^_]+)(?:_ses-(?P<session>[^_]+))?_epo\.fif")


def source_subjects(eeg):
    """Subjects of a source of EEG.

    Parameters
    ----------
    eeg : str or Path
        ``"simulated"``, ``"hri"``, or a folder of epochs.

    Returns
    -------
    list of str
        ``s02`` to ``s13``, or the XX of a folder's ``sub-XX[_ses-YY]_epo.fif``, sorted.

    Raises
    ------
    ValueError
        If the folder holds no such file.
    FileNotFoundError
        If there is no such folder.
    """
    if eeg in ("simulated", "hri"):
        return list(SUBJECTS)
    return sorted({match["subject"] for _, match in _folder_files(eeg)})


def recording_path(eeg, subject):
    """The `.set` file of a simulated or ErrP-HRI subject, made or downloaded if it is missing.

    Parameters
    ----------
    eeg : {"simulated", "hri"}
    subject : str
        ``s02`` to ``s13``.

    Returns
    -------
    Path

    Raises
    ------
    ValueError
        If the subject is unknown.
    OSError
        If a recording can neither be found nor downloaded; the message says what to place where.
    """
    check_subject(subject, SUBJECTS, f"the {eeg} recordings")
    return (simulated if eeg == "simulated" else hri).recording(subject)


def read_raw(path):
    """Read a continuous EEGLAB recording.

    Parameters
    ----------
    path : str or Path
        A `.set` file in MATLAB v5 to v7 form, with its data embedded or in a `.fdt` file (float32,
        little-endian, channels fastest) beside it.

    Returns
    -------
    mne.io.Raw
        In volts, channels typed (names with EOG are ``eog``, all others ``eeg``), with the
        10-05 positions of the names that have one, and the events as annotations at
        ``(latency - 1) / srate`` seconds.

    Raises
    ------
    FileNotFoundError
        If the `.set`, or the `.fdt` it refers to, is missing.
    ValueError
        If a file is truncated, not EEGLAB's, epoched, holds NaN, or repeats an EEG channel.

    Notes
    -----
    Events past the end of the data are left out, with a warning. Integers and digits, ``4``, are
    read as the BrainVision marker they stand for, ``S  4``. Repeated EOG labels are numbered.
    """
    path = Path(path)
    eeg = _load_set(path)
    sfreq = float(eeg["srate"])
    names = _channel_names([str(loc["labels"]) for loc in _as_list(eeg["chanlocs"])], path)
    data = _load_data(eeg, len(names), path)
    bad = np.argwhere(~np.isfinite(data))
    if len(bad):
        channel, sample = bad[0]
        raise ValueError(
            f"{path}: {len(bad)} samples are NaN or infinite, the first in channel "
            f"{names[channel]} at {sample / sfreq:.3f} s; interpolate or cut them in EEGLAB"
        )
    types = ["eog" if "EOG" in name.upper() else "eeg" for name in names]
    info = mne.create_info(names, sfreq, types)
    # EEGLAB's unit is the microvolt.
    raw = mne.io.RawArray(data.astype(np.float64) * 1e-6, info, verbose="error")
    set_positions(raw)
    raw.set_annotations(_annotations(eeg.get("event", []), sfreq, data.shape[1], path))
    return raw


def require_channels(names, required, path):
    """Refuse a recording that lacks one of the `required` channels.

    Raises
    ------
    ValueError
        Naming the file and the channels.
    """
    missing = [name for name in required if name not in names]
    if missing:
        raise ValueError(
            f"{path}: channel {', '.join(missing)} is missing (it has {', '.join(names)}); "
            "rename or interpolate it in the file"
        )


def read_recording(eeg, subject):
    """Continuous recording of a simulated or ErrP-HRI subject, its 27 EEG channels checked.

    Parameters
    ----------
    eeg : {"simulated", "hri"}
    subject : str

    Returns
    -------
    mne.io.Raw
        See `read_raw`.

    Raises
    ------
    ValueError, OSError
        See `recording_path`, `read_raw` and `require_channels`.
    """
    path = recording_path(eeg, subject)
    raw = read_raw(path)
    require_channels(raw.ch_names, EEG_CHANNELS, path)
    return raw


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
    files = sorted(
        (match["session"] or "", path)
        for path, match in _folder_files(folder)
        if match["subject"] == check_subject(subject, source_subjects(folder), folder)
    )
    data, labels, sessions, found, first = [], [], [], set(), None
    for session, path in files:
        epochs = _read(mne.read_epochs, path)
        found |= set(epochs.event_id)
        codes = {epochs.event_id[name]: i for i, name in enumerate((correct, error))
                 if name in epochs.event_id}  # fmt: skip
        epochs = epochs.drop_channels(_to_drop(epochs.ch_names, drop, folder))
        epochs = epochs.pick(["eeg", "eog"], exclude=())[np.isin(epochs.events[:, 2], list(codes))]
        first = first or epochs
        require_channels(epochs.ch_names, first.ch_names, path)
        same = (epochs.info["sfreq"], epochs.tmin, len(epochs.times))
        if same != (first.info["sfreq"], first.tmin, len(first.times)):
            raise ValueError(
                f"{path}: sampling rate, window start and samples {same} differ from those of "
                f"{files[0][1].name}; export all sessions of a subject alike"
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
    refuse_unlocated(first.info, files[0][1])
    return np.concatenate(data), first.info, first.tmin, labels, np.array(sessions)


def other_channels(folder, drop=()):
    """Channels of a folder that are neither EEG nor EOG, nor dropped: never decoded.

    Returns
    -------
    dict of str to str
        Type by name, such as {"STI 014": "stim"}.
    """
    types = _channel_types(folder).items()
    return {n: kind for n, kind in types if kind not in ("eeg", "eog") and n not in drop}


def _channel_types(folder):
    """Type by name of the channels of all files; of those of several types, the first."""
    types = {}
    for path, _ in _folder_files(folder):
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


def _to_drop(names, drop, folder):
    """Names to drop from a file; not every file needs to have what another one has too much."""
    if not set(drop) <= set(names):
        known = _channel_types(folder)
        unknown = [name for name in drop if name not in known]
        if unknown:
            raise ValueError(
                f"{folder} has no channel {', '.join(unknown)} to drop; it has {', '.join(known)}"
            )
    return [name for name in drop if name in names]


def set_positions(instance):
    """Give EEG channels without a position the one of the 10-05 system, by their name.

    Channels with a position of their own keep it.
    """
    eeg = [
        instance.info["chs"][pick] for pick in mne.pick_types(instance.info, eeg=True, exclude=())
    ]
    own = {channel["ch_name"]: channel["loc"][:3].copy() for channel in eeg if is_located(channel)}
    if len(own) == len(eeg):
        return
    head = [
        mne.channels.transform_to_head(mne.channels.make_standard_montage(name)).get_positions()
        for name in ("standard_1020", "standard_1005")
    ]
    # The 10-20 system has O9 and O10 beside those of the 10-05; what both have is equal.
    named = {n.lower(): place for system in head for n, place in system.pop("ch_pos").items()}
    lost = [channel["ch_name"] for channel in eeg if channel["ch_name"] not in own]
    found = {name: named[name.lower()] for name in lost if name.lower() in named}
    landmarks = {name: head[1][name] for name in ("nasion", "lpa", "rpa", "coord_frame")}
    # One montage for all: a second one would take from the others what they have.
    montage = mne.channels.make_dig_montage(own | found, **landmarks)
    instance.set_montage(montage, on_missing="ignore", verbose="error")


def _folder_files(folder):
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{folder} is not a folder; eeg takes 'simulated', 'hri', or a folder of epochs "
            "named sub-XX[_ses-YY]_epo.fif"
        )
    files = [(path, _FOLDER_FILE.fullmatch(path.name)) for path in sorted(folder.iterdir())]
    files = [(path, match) for path, match in files if match]
    if not files:
        raise ValueError(f"{folder} holds no file named sub-XX[_ses-YY]_epo.fif")
    return files


def _load_set(path):
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist")
    try:
        contents = scipy.io.loadmat(path, simplify_cells=True, appendmat=False)
    except NotImplementedError as problem:
        raise ValueError(
            f"{path} is in MATLAB v7.3 form; save it in EEGLAB with the option "
            "'Save files in v6 format' (File > Preferences)"
        ) from problem
    except Exception as problem:
        raise ValueError(
            f"{path} is not a readable EEGLAB file ({problem}); it may be truncated, copy it anew"
        ) from problem
    eeg = contents.get("EEG", contents)
    missing = [key for key in ("data", "srate", "pnts", "chanlocs") if key not in eeg]
    if missing:
        raise ValueError(f"{path} is not an EEGLAB data set: it has no {', '.join(missing)}")
    if eeg.get("trials", 1) > 1:
        raise ValueError(f"{path} is cut into epochs; save the continuous data set")
    return eeg


def _load_data(eeg, n_channels, path):
    """Data in microvolts, shape (channels, samples)."""
    n_samples = int(eeg["pnts"])
    if not isinstance(eeg["data"], str):
        data = np.atleast_2d(eeg["data"])
        if data.shape != (n_channels, n_samples):
            raise ValueError(
                f"{path}: embedded data of shape {data.shape}, expected {(n_channels, n_samples)}"
            )
        return data
    named = path.parent / Path(eeg["data"].replace("\\", "/")).name
    # A .set that was renamed still names its old .fdt.
    fdt = named if named.is_file() else path.with_suffix(".fdt")
    if not fdt.is_file():
        raise FileNotFoundError(
            f"{path} keeps its data in {named}, which is missing; place it there"
        )
    expected, size = n_channels * n_samples * 4, fdt.stat().st_size
    if size != expected:
        raise ValueError(
            f"{fdt} has {size} bytes, expected {expected} ({n_channels} channels x {n_samples} "
            "samples x 4 bytes); it is truncated or belongs to another .set, copy it anew"
        )
    return np.fromfile(fdt, "<f4").reshape((n_channels, n_samples), order="F")


def _channel_names(labels, path):
    eog = [label for label in labels if "EOG" in label.upper()]
    if len(set(eog)) < len(eog):
        numbers = iter(range(1, len(eog) + 1))
        labels = [f"EOG{next(numbers)}" if label in eog else label for label in labels]
    repeated = sorted({label for label in labels if labels.count(label) > 1})
    if repeated:
        raise ValueError(f"{path}: channel {', '.join(repeated)} occurs twice; rename one of them")
    return labels


def _annotations(events, sfreq, n_samples, path):
    onsets, names = [], []
    for event in _as_list(events):
        onset, name = float(event["latency"]) - 1, _event_name(event["type"])
        # Also true of NaN, which EEGLAB writes for events it has lost the place of.
        if not 0 <= round(onset, 6) <= n_samples - 1 if np.isfinite(onset) else True:
            warnings.warn(
                f"{path}: event {name!r} at sample {onset + 1:g} lies outside the data "
                f"({n_samples} samples) and is left out",
                stacklevel=3,
            )
            continue
        onsets.append(onset / sfreq)
        names.append(name)
    return mne.Annotations(onsets, 0, names)


def _event_name(kind):
    if isinstance(kind, (int, float, np.number)):
        kind = f"S{int(kind)}"
    marker = re.fullmatch(r"([SR]?)\s*(\d+)", kind.strip())
    return f"{marker[1] or 'S'}{int(marker[2]):3d}" if marker else kind.strip()


def _as_list(value):
    """MATLAB's structure array as a list; one structure alone arrives without its array."""
    return [value] if isinstance(value, dict) else list(value)
