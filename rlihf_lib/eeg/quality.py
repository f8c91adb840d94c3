"""Whether signals of one's own can be EEG: units, flat channels, offsets, artefacts.

Each refusal is a ValueError that names file, channel, value and remedy. The limits are far from
what EEG shows: of 40 sessions of the NER 2015 challenge, in brackets, none comes near. A pulse that
stays below the limit of artefacts and comes with one class only is found by what it tells
(`channels.refuse_leaks`); with both, nothing tells it from EEG.
"""

import os
import warnings

import mne
import numpy as np

#: V, standard deviation within epochs of the median channel (8 to 22 µV).
UNIT = (0.1e-6, 1e-3)
FLAT = 0.01  # standard deviation of a channel, relative to the median channel's (0.53 at least)
#: V, and relative to the standard deviation within epochs: mean of a typical epoch (0).
OFFSET, RELATIVE_OFFSET = 50e-6, 3.0
MIN_EPOCHS = 5  # of each class
#: Of epochs, and more than `MIN_EPOCHS`: so many artefacts are a fault of the file (28 %).
ARTEFACTS = 1 / 2
MAX_BADS = 1 / 3  # of the channels; the others hardly know what those would have measured
_REMEDY = "leave it out with --drop-channels {names}, or mark it bad in the file to interpolate it"


def refuse_vast(n_bytes, path) -> None:
    """Refuse what this computer's memory cannot hold twice, before it is read."""
    most = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2
    if n_bytes > most:
        raise ValueError(
            f"{path} says that it holds {n_bytes / 2**30:,.1f} GiB, more than half of this "
            f"computer's memory ({most / 2**30:.1f} GiB); cut it into runs, or export it anew"
        )


def refuse_nan(values, names, sfreq, path) -> None:
    """Refuse signals (..., n_channels, n_times) that are not finite everywhere."""
    if len(bad := np.argwhere(~np.isfinite(values))):
        channel, sample = bad[0][-2:]
        raise ValueError(
            f"{path}: {len(bad)} samples are NaN or infinite, the first in channel "
            f"{names[channel]} at {sample / sfreq:.3f} s; interpolate them or cut them out"
        )


def interpolate(instance, path) -> None:
    """Interpolate EEG channels marked bad from the others; instance has positions."""
    bads = instance.info["bads"]
    n_channels = instance.get_channel_types().count("eeg")
    if len(bads) > MAX_BADS * n_channels:
        raise ValueError(
            f"{path}: {len(bads)} of {n_channels} EEG channels are marked bad ({', '.join(bads)}), "
            "too many to interpolate; drop them with --drop-channels, or leave the file out"
        )
    if bads:
        instance.interpolate_bads(reset_bads=True, verbose="error")


def remove_offset(epochs, path) -> None:
    """Take the mean out of each epoch if an offset, which filters can't reach, is all one sees."""
    picks = mne.pick_types(epochs.info, eeg=True, exclude=())
    values = epochs.get_data(picks, copy=False)
    offset = np.median(np.abs(values.mean(axis=2)), axis=0)
    spread = np.median(values.std(axis=2), axis=0)
    if (offset > np.maximum(OFFSET, RELATIVE_OFFSET * spread)).any():
        worst = int(offset.argmax())
        warnings.warn(
            f"{path}: channels have offsets (up to {1e6 * offset[worst]:.0f} µV, on "
            f"{epochs.ch_names[picks[worst]]}) and epochs are too short to be filtered "
            "better, so the mean of each is taken out",
            stacklevel=2,
        )
        epochs.apply_baseline((None, None), verbose="error")


def require_eeg(signals, names, path, reject) -> None:
    """Refuse epochs (n, n_channels, n_times) in volts that are no EEG.

    That is, in another unit, with a flat channel, or most of them beyond `reject` peak to peak.
    """
    if not len(signals):
        return
    signals = np.asarray(signals)
    typical = np.median(signals.std(axis=2), axis=0)
    level = np.median(typical)
    if not UNIT[0] <= level <= UNIT[1]:
        raise ValueError(
            f"{path}: its channels vary by {1e6 * level:.3g} µV (median standard deviation), EEG "
            "by 1 to 100 µV; nothing was recorded, or the values are not in volts: scale them in "
            "the file"
        )
    flat = signals.std(axis=(0, 2)) < FLAT * level
    if flat.any():
        named = np.array(names)[flat]
        raise ValueError(
            f"{path}: EEG channel {', '.join(named)} is flat, as a reference is; "
            f"{_REMEDY.format(names=' '.join(named))}"
        )
    beyond = np.ptp(signals, axis=2) > reject
    if (n := int(beyond.any(axis=1).sum())) > max(ARTEFACTS * len(signals), MIN_EPOCHS):
        counts = beyond.sum(axis=0)
        order = np.argsort(-counts, kind="stable")[:3]
        worst = [names[i] for i in order if counts[i] > counts.max() / 2]
        raise ValueError(
            f"{path}: {n} of {len(signals)} epochs exceed {1e6 * reject:.0f} µV peak to peak, most "
            f"on channel {', '.join(worst)}, as loose electrodes and pulses do; "
            f"{_REMEDY.format(names=' '.join(worst))}, or repair the recording"
        )


def require_classes(labels, events, path) -> None:
    """Refuse a person who has hardly an epoch of one of the classes."""
    for label, event in enumerate(events):
        if (n := int(np.sum(labels == label))) < MIN_EPOCHS:
            raise ValueError(
                f"{path}: epochs left of the event {event!r}: {n}, of the other: "
                f"{len(labels) - n}; {MIN_EPOCHS} of each are needed, so leave this person out"
            )
