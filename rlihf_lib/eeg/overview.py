"""What a folder of one's own EEG holds and what becomes of it, for `--list` and notebooks."""

from pathlib import Path

import pandas as pd

from rlihf_lib.eeg import channels, folders, formats, own, recordings
from rlihf_lib.eeg.folders import few
from rlihf_lib.eeg.preprocessing import Preprocessing


def notes(eeg, drop=()) -> list[str]:
    """Sentences on what of a folder is left out, repaired or differs; of a built-in source none.

    Errors are those of `folders.find` and `own.headers`.
    """
    if not recordings.is_folder(eeg):
        return []
    held, (_, ignored) = own.headers(eeg), folders.find(eeg)
    lines = [f"ignored: {reason}" for reason in folders.reasons(eeg, ignored)]
    inside = Path(eeg).resolve()
    out = [f.name for r in held for f in r.files if not f.resolve().is_relative_to(inside)]
    if out:
        lines.append(f"links that lead out of the folder, followed: {few(out)}")
    kept = own.common_channels(held, drop)
    lines += [f"left out: {' '.join(names)} ({why})" for why, names in _left_out(held, kept, drop)]
    bands: dict[str, list] = {}
    for recording, header in held.items():
        bands.setdefault(_band(header, Preprocessing()), []).append(recording.path.name)
        if bads := [name for name in header.bads if name in kept]:
            lines.append(f"interpolated, marked bad in {recording.path.name}: {' '.join(bads)}")
    unapplied = [
        f"{r.path.name} ({', '.join(h.unapplied)})" for r, h in held.items() if h.unapplied
    ]
    if unapplied:
        lines.append(
            f"projectors that files hold but don't apply are not applied: {few(unapplied)}"
        )
    if len(bands) > 1:
        told = "; ".join(f"{band} {few(names)}" for band, names in bands.items())
        lines.append(f"signals are of different bands, which makes people differ: {told}")
    return lines


def describe(eeg, drop=()) -> str:
    """Text of `--list` on a folder: files, counts of every event, channels, and `notes`."""
    held = own.headers(eeg)
    kept = own.common_channels(held, drop)
    files, counts, lost = [], dict[str, pd.Series](), dict[str, None]()
    for recording, header in held.items():
        length = f"{header.n_times / header.sfreq:.4g} s"
        if header.n_epochs is not None:
            length = f"{header.n_epochs} x {length}"
        kinds = list(header.types.values())
        files.append({
            "file": recording.path.name, "length": length, "Hz": f"{header.sfreq:g}",
            "EEG": kinds.count("eeg"), "EOG": kinds.count("eog"),
            "band (Hz)": "{:g} to {:g}".format(*header.band), "bad": " ".join(header.bads) or "-",
        })  # fmt: skip
        opened = formats.open_recording(recording)
        if header.n_epochs is None:
            names = formats.named_events(opened, recording)["name"]
        else:
            codes = {code: name for name, code in opened.event_id.items()}
            names = pd.Series(opened.events[:, 2]).map(codes)
        known = counts.get(recording.subject, 0)
        counts[recording.subject] = names.value_counts().add(known, fill_value=0)
        channels.set_positions(opened)
        lost |= dict.fromkeys(n for n in channels.unlocated(opened.info) if n in kept)
    sessions = {(recording.subject, recording.session) for recording in held}
    lines = [
        f"EEG in {eeg}: {len(counts)} people, {len(sessions)} sessions, {len(held)} recordings",
        pd.DataFrame(files).to_string(index=False),
        "events of each person, of which --events names the correct one and the error:",
        pd.DataFrame(counts).fillna(0).astype(int).rename_axis(index=None).to_string(),
        f"channels in all files: {' '.join(kept)}",
        *notes(eeg, drop),
    ]
    if lost:
        lines.append(f"no place on the scalp, so --drop-channels them: {' '.join(lost)}")
    return "\n".join(lines)


def _left_out(held, kept, drop):
    """Reasons, and the channels that are not used for each."""
    reasons: dict[str, list] = {}
    for name in dict.fromkeys(n for header in held.values() for n in header.types if n not in kept):
        kinds = {header.types[name] for header in held.values() if name in header.types}
        lacking = [recording.path.name for recording, h in held.items() if name not in h.types]
        if name in drop:
            why = "--drop-channels"
        elif kinds.isdisjoint(formats.TYPES):
            why = f"of type {', '.join(sorted(kinds))}"
        elif lacking:
            why = f"not in {few(lacking)}"
        else:
            why = f"of different types, {', '.join(sorted(kinds))}"
        reasons.setdefault(why, []).append(name)
    return reasons.items()


def _band(header, settings):
    """Words for the band that a file's signals have after preprocessing."""
    edges = [(settings.l_freq, settings.h_freq)]
    if header.n_epochs is not None:
        edges = own.filters(header, settings)
    low = max([header.band[0], *(low for low, _ in edges if low)])
    high = min([header.band[1], *(high for _, high in edges if high)])
    return f"{low:g} to {high:g} Hz:"
