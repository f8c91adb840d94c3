"""Recordings to epochs: band-pass, average reference, 2-s windows at feedback onset, labels."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

import mne
import numpy as np
import pandas as pd

from rlihf_lib.eeg import hri, own, quality, recordings
from rlihf_lib.eeg.formats import labelled_epochs
from rlihf_lib.eeg.streaming import ARTEFACT, CausalFilter
from rlihf_lib.files import atomic_path, cache_dir, canonical_json, sha256, write_csv
from rlihf_lib.parallel import in_processes
from rlihf_lib.progress import Progress

_VERSION = 1  # raise when the steps change in anything but their settings
COLUMNS = ["subject", "session", "epoch", "sample", "block", "label", "status"]


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
    reject: float = ARTEFACT  # V (200e-6), peak to peak on any EEG channel; more is an artefact
    #: Of a folder of one's own: names of the events, channels that are left out.
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

    @property
    def events(self) -> tuple[str, str]:
        """Names of the correct and the error event in a folder of one's own."""
        return self.correct_event, self.error_event


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

    def is_cut(cohort, subject):
        there = recordings.is_there(cohort.eeg, subject)
        return there and _cache(cohort.eeg, subject, cohort.settings).is_file()

    jobs = [(cohorts, s) for s in cohorts[0] if not all(is_cut(cohort, s) for cohort in cohorts)]
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
    cannot be had, read or labelled, or what a folder holds is no EEG (`quality`).

    Notes
    -----
    Epochs of recordings are cached in `files.cache_dir`, by the content of the recording and the
    settings. Epochs of a folder of epochs keep their windows, none is dropped, and they are never
    resampled upwards. They are filtered only if they are at least three times as long as the
    filter: a second filtering of short epochs smears their edges into the response.
    """
    if recordings.is_continuous(eeg):
        return mne.read_epochs(_cut_files(eeg, subject, settings)[0], verbose="error")
    if settings.phase != "zero":
        raise ValueError(f"{eeg} holds epochs; a causal filter needs a continuous recording")
    epochs = own.load_epochs(eeg, subject, settings)
    _resample(epochs, settings)
    return _reference(epochs, settings)


def load_events(eeg, subject, settings=Preprocessing()) -> pd.DataFrame:
    """All feedback events of a subject with continuous recordings, and what became of each.

    Columns are `COLUMNS`: sample is the onset in the preprocessed data; label 0 correct, 1 error,
    -1 neither; status one of kept, artefact, human error, no outcome, past the end.
    """
    table = _cut_files(eeg, subject, settings)[1]
    return pd.read_csv(table, dtype={"subject": str, "session": str}, keep_default_na=False)


def load_continuous(eeg, subject, settings=Preprocessing()) -> tuple[mne.io.RawArray, pd.DataFrame]:
    """Preprocessed continuous recording of a subject, to be replayed as a stream, and its events.

    EEG and EOG are in volts; for the events see `load_events`. The samples from that of a kept
    event on are, bit for bit, the epoch that `load_epochs` returns. Recordings of a folder follow
    one another. A ValueError says if the source is a folder of epochs, which has no continuous
    signal, or no feedback can be labelled.
    """
    recordings.require_continuous(eeg)
    # Recordings that are cut in several ways are read once.
    reading = replace(
        settings, sfreq=recordings.sfreq(eeg, settings.sfreq), reference="recorded", before=0.0
    )
    raws, tables, n_samples = [], [], 0
    content = recordings.content(eeg, subject, settings.drop_channels)
    for raw, found in _filtered(eeg, subject, reading, content):
        raw = _reference(raw.copy(), settings)
        # Single precision, far below the noise, so that what a file holds equals what memory holds.
        raw.apply_function(lambda values: values.astype(np.float32), picks="all", verbose="error")
        events = _find_artefacts(raw, found, settings)
        tables.append(events.assign(sample=events["sample"] + n_samples))
        n_samples += raw.n_times
        raws.append(raw)
    events = pd.concat(tables, ignore_index=True).assign(subject=subject)
    if recordings.is_folder(eeg):
        events["epoch"] = np.arange(len(events))
        kept = events["label"][events["status"] == "kept"]
        quality.require_classes(kept, settings.events, f"{eeg}: subject {subject}")
    whole = mne.concatenate_raws(raws, verbose="error") if len(raws) > 1 else raws[0]
    return whole, events[COLUMNS]


def cut(raw, events, settings) -> mne.EpochsArray:
    """Cut the kept events of a continuous recording, both as `load_continuous` gives them."""
    kept = events[events["status"] == "kept"].drop(columns="status").reset_index(drop=True)
    n_before = round(settings.before * raw.info["sfreq"])
    n_times = round(settings.duration * raw.info["sfreq"])
    data = raw.get_data()
    windows = [data[:, first - n_before : first + n_times] for first in kept["sample"]]
    return labelled_epochs(np.stack(windows), raw.info, -n_before / raw.info["sfreq"], kept)


@lru_cache(maxsize=1)
def _filtered(eeg, subject, settings, content):
    """Signal in the band, and events with their sample, of each recording of a subject."""
    own_files = recordings.is_folder(eeg)
    if own_files:
        found = own.subject_recordings(eeg, subject, settings.events, settings.drop_channels)
    else:
        raw = recordings.read_recording(eeg, subject)
        found = [(eeg, raw, hri.feedback_events(raw).assign(session=eeg))]
    filtered = []
    for path, raw, events in found:
        _filter(raw, settings)
        _resample(raw, settings)
        events["sample"] = np.round(events["onset"] * raw.info["sfreq"]).astype(int)
        if own_files:
            events = events.drop_duplicates("sample").reset_index(drop=True)
            whole = [w for w in _windows(raw, events, settings) if w.size and np.isfinite(w).all()]
            names = np.array(raw.ch_names)[mne.pick_types(raw.info, eeg=True, exclude=())]
            quality.require_eeg(whole, names, path, settings.reject)
        filtered.append((raw, events))
    return filtered


def _filter(raw, settings):
    band, rate = (settings.l_freq, settings.h_freq), raw.info["sfreq"]
    if settings.phase == "zero":
        raw.filter(*band, picks=["eeg", "eog"], verbose="error")
    else:
        raw.apply_function(lambda x: CausalFilter(band, rate)(x[None])[0], ["eeg", "eog"])


def _find_artefacts(raw, events, settings):
    """Events with their status."""
    n_before = round(settings.before * raw.info["sfreq"])
    status = []
    for known, first, window in zip(
        events["status"], events["sample"], _windows(raw, events, settings), strict=True
    ):
        if known == "kept" and (first < n_before or not window.size):
            known = "past the end"
        elif known == "kept" and not np.ptp(window, axis=1).max() <= settings.reject:
            known = "artefact"
        status.append(known)
    return events.assign(status=status)


def _windows(raw, events, settings):
    """EEG from each event on: NaN where it is annotated as bad, nothing if it is not all there."""
    n_times = round(settings.duration * raw.info["sfreq"])
    data = raw.get_data(picks="eeg", reject_by_annotation="NaN", verbose="error")
    for first in events["sample"]:
        window = data[:, max(first, 0) : first + n_times]
        yield window if window.shape[1] == n_times else window[:, :0]


def _resample(instance, settings):
    if instance.info["sfreq"] > settings.sfreq:
        instance.resample(settings.sfreq, verbose="error")


def _reference(instance, settings):
    if settings.reference == "average":
        instance.set_eeg_reference("average", verbose="error")
    return instance


def _cache(eeg, subject, settings):
    """The file of a subject's cached epochs."""
    used = asdict(settings)
    del used["drop_channels"]  # the content tells
    if settings.phase == "zero":
        del used["phase"]  # as it was before there were others
    content = recordings.content(eeg, subject, settings.drop_channels)
    key = sha256(canonical_json([_VERSION, str(eeg), subject, content, used]))[:16]
    return cache_dir() / "epochs" / f"{subject}-{key}-epo.fif"


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
