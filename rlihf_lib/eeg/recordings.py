"""The door to all sources of EEG: "simulated", "hri" (ErrP-HRI), or a folder of epochs."""

from pathlib import Path

import mne

from rlihf_lib.eeg import formats, hri, simulated
from rlihf_lib.eeg.channels import require_channels


def is_folder(eeg) -> bool:
    """Whether a source is a folder of epochs and not one of the continuous recordings."""
    return eeg not in ("simulated", "hri")


def source_subjects(eeg) -> list[str]:
    """Subjects of a source: ``s02`` to ``s13``, or those of `formats.folder_subjects`."""
    return formats.folder_subjects(eeg) if is_folder(eeg) else list(hri.SUBJECTS)


def recording_path(eeg, subject) -> Path:
    """The `.set` file of a simulated or ErrP-HRI subject, made or downloaded if it is missing.

    A ValueError says if the subject is unknown; `hri.recording` has its errors, too.
    """
    formats.check_subject(subject, hri.SUBJECTS, f"the {eeg} recordings")
    return _source(eeg).recording(subject)


def is_there(eeg, subject) -> bool:
    """Whether the recording of a known subject is made or downloaded already."""
    return _source(eeg).place(subject).is_file()


def _source(eeg):
    return simulated if eeg == "simulated" else hri


def read_recording(eeg, subject) -> mne.io.RawArray:
    """Continuous recording of a simulated or ErrP-HRI subject, its 27 EEG channels checked."""
    path = recording_path(eeg, subject)
    raw = formats.read_eeglab(path)
    require_channels(raw.ch_names, hri.EEG_CHANNELS, path)
    return raw
