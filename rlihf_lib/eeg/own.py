"""One's own EEG, a folder of recordings or epochs: whose, on which channels, with which labels."""

from collections.abc import Iterable
from pathlib import Path

import mne
import numpy as np
import pandas as pd

from rlihf_lib.eeg import folders, formats, quality


def headers(folder) -> dict[folders.Recording, formats.Header]:
    """Headers of a folder's recordings, in the order of `folders.find`, whose errors it has.

    A ValueError says if a file cannot be read, is sampled too slowly, has no EEG channel, or if
    some files hold epochs and others don't.
    """
    found = {recording: formats.header(recording) for recording in folders.find(folder)[0]}
    continuous = [r.path for r, header in found.items() if header.n_epochs is None]
    if continuous and len(continuous) < len(found):
        other = next(r.path for r in found if r.path not in continuous)
        raise ValueError(
            f"{continuous[0]} is a continuous recording, {other} holds epochs; keep files of one "
            "kind"
        )
    return found


def common_channels(headers, drop=()) -> list[str]:
    """EEG and EOG channels that all files have, in the order of the first, less those to drop.

    A ValueError says if no EEG channel is left, or there is none of a name to drop.
    """
    types = [header.types for header in headers.values()]
    known = {name for each in types for name in each}
    if unknown := [name for name in drop if name not in known]:
        first = next(iter(headers)).path
        raise ValueError(
            f"{first.parent} has no channel {', '.join(unknown)} to drop; it has "
            f"{', '.join(sorted(known))}"
        )
    usable = {n: kind for n, kind in types[0].items() if kind in formats.TYPES and n not in drop}
    common = [n for n, kind in usable.items() if all(each.get(n) == kind for each in types)]
    if "eeg" not in {usable[name] for name in common}:
        each = "; ".join(f"{r.path.name}: {', '.join(h.types)}" for r, h in headers.items())
        raise ValueError(
            f"no EEG channel is in all files and not dropped ({each}); drop fewer, name channels "
            "alike in all files, or leave one out"
        )
    return common


def load_epochs(folder, subject, settings) -> mne.EpochsArray:
    """Epochs of a subject of a folder of epochs, in the band of the settings if they are long.

    A ValueError says if they are no EEG (`quality`), not alike, or cannot be had: `subject_epochs`.
    """
    parts = subject_epochs(folder, subject, settings.events, settings.drop_channels)
    first, layouts = parts[0][1], []
    for recording, epochs in parts:
        path, header = recording.path, formats.header(recording)
        for edges in filters(header, settings):
            epochs.filter(*edges, picks=["eeg", "eog"], verbose="error")
        quality.remove_offset(epochs, path)
        names = np.array(epochs.ch_names)[mne.pick_types(epochs.info, eeg=True, exclude=())]
        quality.require_eeg(epochs.get_data(names, copy=False), names, path, settings.reject)
        layouts.append((epochs.info["sfreq"], epochs.tmin, len(epochs.times)))
        if layouts[-1] != layouts[0]:
            raise ValueError(
                f"{path}: sampling rate, window start and samples {layouts[-1]} differ from the "
                f"first session's, {layouts[0]}; export all sessions of a subject alike"
            )
    table = pd.concat([epochs.metadata for _, epochs in parts], ignore_index=True)
    quality.require_classes(table["label"], settings.events, f"{folder}: subject {subject}")
    table.insert(0, "subject", subject)
    table.insert(2, "epoch", np.arange(len(table)))
    data = np.concatenate([epochs.get_data(copy=False) for _, epochs in parts])
    return formats.labelled_epochs(data, first.info, first.tmin, table)


def filters(header, settings) -> list[tuple]:
    """Edges (l_freq, h_freq), Hz, that epochs of a file lack and are long enough to get."""
    edges: list[tuple] = []
    if header.band[0] < settings.l_freq:
        edges.append((settings.l_freq, None))
    if header.band[1] > settings.h_freq:
        edges.append((None, settings.h_freq))
    taps = [
        len(mne.filter.create_filter(None, header.sfreq, *pair, verbose="error")) for pair in edges
    ]
    return [pair for pair, n in zip(edges, taps, strict=True) if header.n_times >= 3 * n]


def subject_recordings(
    folder, subject, events, drop=()
) -> list[tuple[Path, mne.io.RawArray, pd.DataFrame]]:
    """Of a subject's continuous recordings with one of the two `events`: path, signal, events.

    Columns of the events are onset (s), label (0 correct, 1 error), session, block (number of the
    recording) and status. A ValueError says if there is no such subject, or none of its events.
    """
    found: list[tuple] = []
    names: list[str] = []
    channels, files = _of_subject(folder, subject, drop)
    for recording in files:
        raw, told = formats.read_raw(recording, channels)
        names += list(told["name"].unique())
        codes = label_codes(told["name"].unique(), events, recording.path)
        told["label"] = told["name"].map(codes)
        told = told.dropna(subset="label").astype({"label": int})
        if len(told):
            table = told[["onset", "label"]].assign(
                session=recording.session, block=len(found), status="kept"
            )
            found.append((recording.path, raw, table.reset_index(drop=True)))
    _require_events(folder, subject, events, names, [table["label"] for *_, table in found])
    return found


def subject_epochs(
    folder, subject, events, drop=()
) -> list[tuple[folders.Recording, mne.BaseEpochs]]:
    """Files of a subject with one of the two `events`, and those epochs.

    Session and label are in the metadata; errors as of `subject_recordings`.
    """
    found, names = [], []
    channels, files = _of_subject(folder, subject, drop)
    for recording in files:
        epochs = formats.read_epochs(recording, channels)
        names += [name for name, code in epochs.event_id.items() if code in epochs.events[:, 2]]
        labels = label_codes(epochs.event_id, events, recording.path)
        codes = {epochs.event_id[name]: label for name, label in labels.items()}
        label = pd.Series(epochs.events[:, 2]).map(codes)
        if label.notna().any():
            epochs = epochs[label.notna().to_numpy()]
            table = {"session": recording.session, "label": label.dropna().to_numpy(int)}
            with mne.use_log_level("error"):
                epochs.metadata = pd.DataFrame(table)
            found.append((recording, epochs))
    _require_events(folder, subject, events, names, [e.metadata["label"] for _, e in found])
    return found


def label_codes(names: Iterable[str], events, path) -> dict[str, int]:
    """Label, 0 correct and 1 error, of the names that mean one of the two `events`.

    A name is meant by itself, or as MNE does by its parts: ``Stimulus/S  4`` by ``S  4``. A
    ValueError says if both are meant.
    """
    codes = {}
    for name in names:
        parts = set(name.split("/"))
        meant = [label for label, event in enumerate(events) if event == name]
        meant = meant or [n for n, event in enumerate(events) if set(event.split("/")) <= parts]
        if len(meant) > 1:
            raise ValueError(
                f"{path}: its event {name!r} is both, {' and '.join(map(repr, events))}; give the "
                "whole names with --events OK ERR"
            )
        if meant:
            codes[name] = meant[0]
    return codes


def _of_subject(folder, subject, drop):
    """The channels of the folder that are used, and a subject's files."""
    held = headers(folder)
    subjects = dict.fromkeys(recording.subject for recording in held)
    formats.check_subject(subject, subjects, folder)
    return common_channels(held, drop), [r for r in held if r.subject == subject]


def _require_events(folder, subject, events, names, labels):
    there = {label for each in labels for label in each}
    for label, event in enumerate(events):
        if label not in there:
            known = ", ".join(sorted(set(names))) or "none"
            raise ValueError(
                f"{folder}: subject {subject} has no epoch of the event {event!r} (its events: "
                f"{known}); name the two with --events OK ERR"
            )
