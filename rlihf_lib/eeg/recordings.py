"""The door to all sources of EEG: "simulated", "hri" (ErrP-HRI), or a folder of one's own."""

from functools import lru_cache
from pathlib import Path

import mne
import numpy as np

from rlihf_lib.eeg import folders, formats, hri, own, simulated
from rlihf_lib.eeg.eeglab import read_eeglab
from rlihf_lib.files import sha256


def is_folder(eeg) -> bool:
    """Whether a source is a folder of one's own and not built in."""
    return eeg not in ("simulated", "hri")


def is_continuous(eeg) -> bool:
    """Whether a source holds continuous recordings and not epochs; errors of `own.headers`."""
    return not is_folder(eeg) or None in {h.n_epochs for h in own.headers(eeg).values()}


def require_continuous(eeg) -> None:
    """Refuse a folder of epochs, where a continuous signal is needed."""
    if not is_continuous(eeg):
        raise ValueError(
            f"{eeg} holds epochs, not continuous data; choose 'simulated', 'hri', or a folder of "
            "continuous recordings"
        )


def sfreq(eeg, highest) -> float:
    """Sampling rate, Hz, that all recordings of a source can be brought to, `highest` at most."""
    if not is_folder(eeg):
        return highest
    return min(highest, *(header.sfreq for header in own.headers(eeg).values()))


def source_subjects(eeg) -> list[str]:
    """Subjects of a source: ``s02`` to ``s13``, or those of `folders.find`."""
    if is_folder(eeg):
        return list(dict.fromkeys(recording.subject for recording in folders.find(eeg)[0]))
    return list(hri.SUBJECTS)


def recording_path(eeg, subject) -> Path:
    """The `.set` file of a simulated or ErrP-HRI subject, made or downloaded if it is missing.

    A ValueError says if the subject is unknown; `hri.recording` has its errors, too.
    """
    formats.check_subject(subject, hri.SUBJECTS, f"the {eeg} recordings")
    return _source(eeg).recording(subject)


def is_there(eeg, subject) -> bool:
    """Whether the recording of a known subject is made or downloaded already."""
    return is_folder(eeg) or _source(eeg).place(subject).is_file()


def _source(eeg):
    return simulated if eeg == "simulated" else hri


def read_recording(eeg, subject, drop=()) -> mne.io.RawArray:
    """Continuous recording of a subject, the first if a folder holds several.

    Of the built-in sources the 27 EEG channels are checked; of a folder `drop` is left out.
    """
    if is_folder(eeg):
        held = own.headers(eeg)
        first = next(recording for recording in held if recording.subject == subject)
        return formats.read_raw(first, own.common_channels(held, drop))[0]
    path = recording_path(eeg, subject)
    raw = read_eeglab(path)
    if missing := [name for name in hri.EEG_CHANNELS if name not in raw.ch_names]:
        raise ValueError(
            f"{path}: channel {', '.join(missing)} is missing (it has {', '.join(raw.ch_names)}); "
            "rename or interpolate it in the file"
        )
    return raw


def content(eeg, subject, drop=()) -> tuple[str, ...]:
    """What a subject's signals follow from: hashes of files; of a folder what others decide, too.

    That is, which channels all have that aren't to `drop`, and their rate.
    """
    if is_folder(eeg):
        held = own.headers(eeg)
        files = [file for r in held if r.subject == subject for file in r.files]
        shared = [str(sfreq(eeg, np.inf)), *own.common_channels(held, drop)]
    else:
        path, shared = recording_path(eeg, subject), []
        files = [file for file in (path, path.with_suffix(".fdt")) if file.is_file()]
    hashes = [_hash(file, file.stat().st_mtime_ns, file.stat().st_size) for file in files]
    return (*hashes, *shared)


@lru_cache  # of a file that stays as it is
def _hash(file, changed, size):
    return sha256(file)
