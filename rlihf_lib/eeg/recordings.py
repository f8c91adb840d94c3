"""EEG recordings: simulated ones or the ErrP-HRI data set.

Both are EEGLAB files and share one reader, `read_raw`. Your own epochs are read by `folder`.
"""

import re
import warnings
from pathlib import Path

import mne
import numpy as np
import scipy.io

from rlihf_lib.eeg import folder, hri, simulated
from rlihf_lib.eeg.channels import require_channels, set_positions
from rlihf_lib.eeg.dataset import EEG_CHANNELS, SUBJECTS, check_subject


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
    return folder.subjects(eeg)


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
