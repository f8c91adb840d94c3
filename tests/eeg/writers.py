"""Small EEG files in the formats of others; signals (n_channels, n_times) in µV.

`events` are pairs of onset, a sample, and name.
"""

import mne
import numpy as np
import scipy.io

NAMES = ("Fz", "Cz", "Pz", "C3", "C4")
SFREQ = 128


def planted(seed, n=30, amplitude=12.0, spacing=2.5):
    """Noise of 5 µV with events; errors, a third, carry a bump at 0.3 s on Cz, half of it on Fz."""
    rng = np.random.default_rng(seed)
    samples = ((np.arange(n) + 1) * spacing * SFREQ).astype(int)
    signal = rng.normal(0, 5, (len(NAMES), samples[-1] + 4 * SFREQ))
    signal = signal[:, : signal.shape[1] // SFREQ * SFREQ]
    events = [(sample, "error" if i % 3 == 0 else "correct") for i, sample in enumerate(samples)]
    time = np.arange(SFREQ) / SFREQ
    bump = amplitude * np.exp(-(((time - 0.3) / 0.05) ** 2) / 2)
    for sample, name in events:
        for channel, gain in ((1, 1.0), (0, 0.5)):
            signal[channel, sample : sample + SFREQ] += gain * bump * (name == "error")
    return signal, events


def raw_of(signal, events=(), names=NAMES, types="eeg", sfreq=SFREQ):
    """MNE's Raw of a signal, its events as annotations."""
    raw = mne.io.RawArray(
        1e-6 * signal, mne.create_info(list(names), sfreq, types), verbose="error"
    )
    onsets = [sample / sfreq for sample, _ in events]
    return raw.set_annotations(mne.Annotations(onsets, 0, [name for _, name in events]))


def fif(path, signal, events, names=NAMES, **layout):
    """A raw FIF file."""
    raw_of(signal, events, names, **layout).save(path, verbose="error", overwrite=True)


def brainvision(path, signal, events, names=NAMES):
    """A header, its markers (all stimuli) and its samples, which MNE reads as float32."""
    np.asarray(signal.T, "<f4").tofile(path.with_suffix(".eeg"))
    files = f"[Common Infos]\nCodepage=UTF-8\nDataFile={path.stem}.eeg\n"
    channels = [f"Ch{i + 1}={name},,1,µV" for i, name in enumerate(names)]
    path.write_text(
        f"Brain Vision Data Exchange Header File Version 1.0\n{files}MarkerFile={path.stem}.vmrk\n"
        f"DataFormat=BINARY\nDataOrientation=MULTIPLEXED\nNumberOfChannels={len(names)}\n"
        f"SamplingInterval={1e6 / SFREQ}\n[Binary Infos]\nBinaryFormat=IEEE_FLOAT_32\n"
        "[Channel Infos]\n" + "\n".join(channels) + "\n",
        encoding="utf-8",
    )
    markers = [f"Mk{i + 2}=Stimulus,{n},{at + 1},1,0" for i, (at, n) in enumerate(events)]
    path.with_suffix(".vmrk").write_text(
        f"Brain Vision Data Exchange Marker File Version 1.0\n{files}[Marker Infos]\n"
        "Mk1=New Segment,,1,1,0,20200101000000000000\n" + "\n".join(markers) + "\n",
        encoding="utf-8",
    )


def eeglab(path, signal, events, names=NAMES):
    """A continuous `.set` with its `.fdt`."""
    np.asarray(signal.T, "<f4").tofile(path.with_suffix(".fdt"))
    _save_set(path, names, signal.shape[1], 1, path.with_suffix(".fdt").name, 0.0, [
        (float(at + 1), name, 1.0) for at, name in events
    ])  # fmt: skip


def eeglab_epochs(path, epochs, names, tmin=0.0, channels=NAMES):
    """An epoched `.set` of epochs (n, n_channels, n_times) whose events have these names."""
    n, _, n_times = epochs.shape
    first = round(-tmin * SFREQ)
    events = [(float(i * n_times + first + 1), name, i + 1.0) for i, name in enumerate(names)]
    _save_set(
        path, channels, n_times, n, epochs.transpose(1, 2, 0).astype(np.float32), tmin, events
    )


def _save_set(path, names, n_times, trials, data, tmin, events):
    fields = [("latency", object), ("type", object), ("epoch", object)]
    eeg = {
        "setname": path.stem, "nbchan": float(len(names)), "pnts": float(n_times),
        "trials": float(trials), "srate": float(SFREQ), "xmin": tmin,
        "xmax": tmin + (n_times - 1) / SFREQ, "data": data, "ref": "common",
        "chanlocs": np.array([(name,) for name in names], [("labels", object)]),
        "event": np.array(events, fields),
    }  # fmt: skip
    if trials > 1:
        epoch = [(event[2], event[1], 0.0) for event in events]
        epoch_fields = [("event", object), ("eventtype", object), ("eventlatency", object)]
        eeg["epoch"] = np.array(epoch, epoch_fields)
    scipy.io.savemat(path, {"EEG": eeg}, format="5", oned_as="row")


def edf(path, signal, events, names=NAMES, trigger="Status", unit="uV", hold=False):
    """EDF, or BDF by its ending, with a trigger channel of each event's number.

    It is there for three samples, or is to `hold` until the next one.
    """
    wide = path.suffix == ".bdf"
    top = 2**23 - 1 if wide else 2**15 - 1
    physical = np.ceil(np.abs(signal).max() + 1)
    pulses = np.zeros(signal.shape[1], int)
    for at, name in events:
        pulses[at : None if hold else at + 3] = int(name)
    samples = np.vstack([np.round(signal / physical * top).astype(int), pulses])
    labels = [*names, trigger]
    n, seconds = len(labels), signal.shape[1] // SFREQ
    fixed = [b"\xffBIOSEMI" if wide else b"0       ", b"X".ljust(80), b"X".ljust(80)]
    fixed += [b"01.01.2001.01.01", b"%-8d" % (256 * (n + 1)), (b"24BIT" if wide else b"").ljust(44)]
    fixed += [b"%-8d" % seconds, b"1".ljust(8), b"%-4d" % n]
    limits = [physical] * (n - 1) + [top]
    columns = [
        (16, labels), (80, [""] * n), (8, [unit] * (n - 1) + ["Boolean"]),
        (8, [f"{-limit:.7g}" for limit in limits]), (8, [f"{limit:.7g}" for limit in limits]),
        (8, [-top] * n), (8, [top] * n), (80, [""] * n), (8, [SFREQ] * n), (32, [""] * n),
    ]  # fmt: skip
    header = b"".join(fixed)
    header += b"".join(
        f"{value:<{width}}".encode() for width, column in columns for value in column
    )
    blocks = samples.reshape(n, seconds, SFREQ).transpose(1, 0, 2)
    if wide:
        body = blocks.astype("<i4").reshape(-1, 1).view(np.uint8)[:, :3].tobytes()
    else:
        body = blocks.astype("<i2").tobytes()
    path.write_bytes(header + body)


def gdf(path, signal, events, names=NAMES):
    """GDF 1.25 with a table of events, whose names are numbers."""
    n, seconds = len(names), signal.shape[1] // SFREQ
    physical = float(np.abs(signal).max() + 1)
    top = 2**15 - 1
    header = b"GDF 1.25" + b"X X".ljust(80) + b"X".ljust(80) + b"2020010100000000"
    header += np.int64(256 * (n + 1)).tobytes() + bytes(8 * 3 + 20)
    header += np.int64(seconds).tobytes() + np.array([1, 1, n], "<u4").tobytes()
    header += b"".join(name.ljust(16).encode() for name in names) + b" " * 80 * n
    header += b"uV".ljust(8) * n
    header += np.repeat([-physical, physical], n).astype("<f8").tobytes()
    header += np.repeat([-top, top], n).astype("<i8").tobytes() + b" " * 80 * n
    header += np.full(n, SFREQ, "<i4").tobytes() + np.full(n, 3, "<i4").tobytes() + bytes(32 * n)
    samples = np.round(signal / physical * top).astype("<i2")
    body = samples.reshape(n, seconds, SFREQ).transpose(1, 0, 2).tobytes()
    at, kinds = zip(*events, strict=True)
    table = b"\x01" + int(SFREQ).to_bytes(3, "little") + np.uint32(len(events)).tobytes()
    table += (np.array(at) + 1).astype("<u4").tobytes() + np.array(kinds, int).astype(
        "<u2"
    ).tobytes()
    path.write_bytes(header + body + table)
