"""Recordings to epochs: band-pass, average reference, 2-s windows at feedback onset, labels."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import mne
import numpy as np
import pandas as pd

from rlihf_lib.eeg import hri, recordings
from rlihf_lib.eeg.formats import labelled_epochs, read_folder_epochs
from rlihf_lib.eeg.hri import CORRECT, FEEDBACKS, HUMAN_ERROR, MACHINE_ERROR
from rlihf_lib.eeg.streaming import CausalFilter
from rlihf_lib.files import atomic_path, canonical_json, sha256, write_csv
from rlihf_lib.parallel import in_processes
from rlihf_lib.progress import Progress

_VERSION = 1  # raise when the steps change in anything but their settings
COLUMNS = ["subject", "session", "epoch", "sample", "block", "label", "status"]
OUTCOMES = {CORRECT: (0, "kept"), MACHINE_ERROR: (1, "kept"), HUMAN_ERROR: (-1, "human error")}


@dataclass(frozen=True)
class Preprocessing:
    """Settings of the preprocessing."""

    #: Band of the paper, Hz. Zero-phase FIR (MNE's `firwin` design, Hamming window, 3.3 s long).
    l_freq: float = 1.0
    h_freq: float = 20.0
    phase: str = "zero"  # or "minimum", as a live stream is filtered (`streaming.CausalFilter`)
    reference: str = "average"  # of the EEG channels; "recorded" keeps the recording's
    sfreq: float = 256.0  # Hz; recordings above it are resampled, those below stay as they are
    #: Window from the feedback onset on, s. There is no baseline correction: the 1-Hz high-pass has
    #: taken the offset away, and a window that starts at the onset is what a stream can cut.
    duration: float = 2.0
    before: float = 0.0  # s before the onset that are cut, too, but not looked at for artefacts
    reject: float = 200e-6  # V, peak to peak on any EEG channel, above which is an artefact
    #: Of a folder of epochs: names of the events, channels that are left out.
    correct_event: str = "correct"
    error_event: str = "error"
    drop_channels: tuple = ()

    def __post_init__(self):
        if self.reference not in ("average", "recorded"):
            raise ValueError(
                f"reference {self.reference!r} is unknown; choose 'average' or 'recorded'"
            )
        if self.phase not in ("zero", "minimum"):
            raise ValueError(f"phase {self.phase!r} is unknown; choose 'zero' or 'minimum'")


@dataclass(frozen=True)
class Cohort(Mapping):
    """Subject -> `load_epochs`, loaded whenever it is asked for."""

    eeg: str | Path
    subjects: Sequence[str]
    settings: Preprocessing = Preprocessing()

    def __getitem__(self, subject: str) -> mne.BaseEpochs:
        return load_epochs(self.eeg, subject, self.settings)

    def __iter__(self) -> Iterator[str]:
        return iter(self.subjects)

    def __len__(self) -> int:
        return len(self.subjects)


def prepare(cohorts: Sequence[Cohort], workers: int = 0) -> None:
    """Cut and cache the epochs of cohorts of the same recorded people, as `load_epochs` would.

    People side by side on `workers` processes, 0 = one per core.
    """
    missing = [
        subject
        for subject in cohorts[0]
        if not all(
            recordings.is_there(cohort.eeg, subject)
            and _cache(cohort.eeg, subject, cohort.settings).is_file()
            for cohort in cohorts
        )
    ]
    jobs = [(cohorts, subject) for subject in missing]
    n_processes = min(workers or os.cpu_count() or 1, len(jobs))
    with Progress(len(cohorts[0]), len(cohorts[0]) - len(jobs), "recordings") as progress:
        for subject in in_processes(_cut_for, jobs, n_processes):
            progress.finished(subject)


def _cut_for(cohorts, subject):
    for cohort in cohorts:
        _cut_files(cohort.eeg, subject, cohort.settings)
    return subject


def load_epochs(eeg, subject, settings=Preprocessing()) -> mne.BaseEpochs:
    """Preprocessed epochs of one subject (`recordings.source_subjects`) of a source of EEG.

    EEG and EOG channels are in volts, events are ``correct`` and ``error``. The metadata hold
    subject, session, epoch (index of the feedback within the subject's recording, counting the
    dropped ones, so that it stays the same whatever is dropped), label (0 correct, 1 error) and,
    for recordings, sample (of the onset) and block. A ValueError or OSError says if the recording
    cannot be had, read or labelled.

    Notes
    -----
    Epochs of recordings are cached in `hri.cache_dir`, by the content of the recording and the
    settings. Epochs of a folder keep their windows, are never resampled upwards, and are filtered
    only if they are at least three times as long as the filter: a second filtering of short epochs
    smears their edges into the response.
    """
    if recordings.is_folder(eeg):
        return _folder_epochs(eeg, subject, settings)
    return _cached(eeg, subject, settings)[0]


def load_events(eeg, subject, settings=Preprocessing()) -> pd.DataFrame:
    """All feedback events of a simulated or ErrP-HRI subject, and what became of each.

    Columns are `COLUMNS`: sample is the onset in the preprocessed data; label 0 correct, 1 error,
    -1 neither; status one of kept, artefact, human error, no outcome, past the end.
    """
    return _cached(eeg, subject, settings)[1]


def load_continuous(eeg, subject, settings=Preprocessing()) -> tuple[mne.io.RawArray, pd.DataFrame]:
    """Preprocessed continuous recording of a subject, to be replayed as a stream, and its events.

    EEG and EOG are in volts; for the events see `load_events`. The samples from that of a kept
    event on are, bit for bit, the epoch that `load_epochs` returns. A ValueError says if the source
    is a folder of epochs, which has no continuous signal, or no feedback can be labelled.
    """
    if recordings.is_folder(eeg):
        raise ValueError(f"{eeg} holds epochs, not continuous data; choose 'simulated' or 'hri'")
    band = settings.l_freq, settings.h_freq
    raw = _filtered(eeg, subject, band, settings.phase, _content(eeg, subject)).copy()
    events = _feedback_events(raw).assign(subject=subject, session=eeg)
    _resample_and_reference(raw, settings)
    # Single precision, far below the noise, so that what a file holds equals what memory holds.
    raw.apply_function(lambda values: values.astype(np.float32), picks="all", verbose="error")
    n_times = round(settings.duration * raw.info["sfreq"])
    events["sample"] = np.round(events["onset"] * raw.info["sfreq"]).astype(int)
    data = raw.get_data(picks="eeg")
    for row, first in events.loc[events["status"] == "kept", "sample"].items():
        window = data[:, first : first + n_times]
        if window.shape[1] < n_times:
            events.at[row, "status"] = "past the end"
        elif np.ptp(window, axis=1).max() > settings.reject:
            events.at[row, "status"] = "artefact"
    return raw, events[COLUMNS]


@lru_cache(maxsize=1)  # the same recording is cut in several ways, one after the other
def _filtered(eeg, subject, band, phase, content):
    raw = recordings.read_recording(eeg, subject)
    if phase == "zero":
        return raw.filter(*band, picks=["eeg", "eog"], verbose="error")
    rate = raw.info["sfreq"]
    return raw.apply_function(lambda x: CausalFilter(band, rate)(x[None])[0], ["eeg", "eog"])


def _content(eeg, subject):
    path = recordings.recording_path(eeg, subject)
    files = [file for file in (path, path.with_suffix(".fdt")) if file.is_file()]
    return tuple(_hash(file, file.stat().st_mtime_ns, file.stat().st_size) for file in files)


@lru_cache  # of a file that stays as it is
def _hash(file, changed, size):
    return sha256(file)


def cut(raw, events, settings) -> mne.EpochsArray:
    """Cut the kept events of a continuous recording, both as `load_continuous` gives them."""
    kept = events[events["status"] == "kept"].drop(columns="status").reset_index(drop=True)
    n_before = round(settings.before * raw.info["sfreq"])
    n_times = round(settings.duration * raw.info["sfreq"])
    data = raw.get_data()
    windows = [data[:, first - n_before : first + n_times] for first in kept["sample"]]
    return labelled_epochs(np.stack(windows), raw.info, -n_before / raw.info["sfreq"], kept)


def _feedback_events(raw):
    """Feedback events in the order of time, labelled by the outcome marker of their trial."""
    onset, name = raw.annotations.onset, raw.annotations.description
    trial = np.searchsorted(onset[np.isin(name, hri.STIMULI)], onset, side="right")
    rows = []
    for epoch, index in enumerate(np.flatnonzero(np.isin(name, FEEDBACKS))):
        outcomes = set(name[trial == trial[index]]) & OUTCOMES.keys()
        label, status = OUTCOMES[outcomes.pop()] if len(outcomes) == 1 else (-1, "no outcome")
        rows.append((onset[index], epoch, epoch // hri.N_TRIALS_PER_BLOCK, label, status))
    events = pd.DataFrame(rows, columns=["onset", "epoch", "block", "label", "status"])
    if not (events["label"] >= 0).any():
        raise ValueError(
            f"no feedback ({', '.join(FEEDBACKS)}) with an outcome ({CORRECT}, {MACHINE_ERROR}) "
            f"among the events of the recording, which are {', '.join(sorted(set(name))) or 'none'}"
        )
    return events


def _resample_and_reference(instance, settings):
    if instance.info["sfreq"] > settings.sfreq:
        instance.resample(settings.sfreq, verbose="error")
    if settings.reference == "average":
        instance.set_eeg_reference("average", verbose="error")


def _cache(eeg, subject, settings):
    """The file of a subject's cached epochs."""
    used = asdict(settings)
    del used["drop_channels"]  # says nothing of recordings, whose cached epochs stay good
    if settings.phase == "zero":
        del used["phase"]  # as it was before there were others
    key = sha256(canonical_json([_VERSION, eeg, subject, _content(eeg, subject), used]))[:16]
    return hri.cache_dir() / "epochs" / f"{subject}-{key}-epo.fif"


def _cut_files(eeg, subject, settings):
    """Cached epochs and table of events of a subject, written if missing."""
    file = _cache(eeg, subject, settings)
    table = file.with_name(file.name.replace("-epo.fif", ".csv"))
    if not (file.is_file() and table.is_file()):
        raw, events = load_continuous(eeg, subject, settings)
        with atomic_path(file) as temporary:
            cut(raw, events, settings).save(temporary, overwrite=True, verbose="error")
        write_csv(table, events)
    return file, table


def _cached(eeg, subject, settings):
    file, table = _cut_files(eeg, subject, settings)
    events = pd.read_csv(table, dtype={"subject": str, "session": str})
    return mne.read_epochs(file, verbose="error"), events


def _folder_epochs(eeg, subject, settings):
    if settings.phase != "zero":
        raise ValueError(f"{eeg} holds epochs; a causal filter needs a continuous recording")
    names = (settings.correct_event, settings.error_event)
    epochs = read_folder_epochs(eeg, subject, names, settings.drop_channels)
    info, band = epochs.info, []
    if info["highpass"] < settings.l_freq:
        band.append((settings.l_freq, None))
    if info["lowpass"] > settings.h_freq:
        band.append((None, settings.h_freq))
    for edges in band:
        length = len(mne.filter.create_filter(None, info["sfreq"], *edges, verbose="error"))
        if len(epochs.times) >= 3 * length:
            epochs.filter(*edges, picks=["eeg", "eog"], verbose="error")
    _resample_and_reference(epochs, settings)
    return epochs
