"""Channels that may be decoded: they are there, lie on the scalp, and don't know the answer."""

from functools import cache

import mne
import numpy as np
import pandas as pd

from rlihf_lib.eeg.scores import auroc
from rlihf_lib.eeg.signals import SubjectEpochs

MAX_AUROC = 0.95  # no electrode of people tells errors so well; a trigger or a label does
BINS = 32  # of the epoch, in each of which a channel is averaged
_REMEDY = (
    "leave it out with --drop-channels {names}, or give it its true type in the file "
    "(epochs.set_channel_types), such as misc"
)


def set_positions(instance) -> None:
    """Give EEG channels without a position the one of the 10-05 system, by their name."""
    picks = mne.pick_types(instance.info, eeg=True, exclude=())
    eeg = {instance.ch_names[pick]: instance.info["chs"][pick] for pick in picks}
    own = {name: channel["loc"][:3].copy() for name, channel in eeg.items() if _is_located(channel)}
    if len(own) == len(eeg):
        return
    named, landmarks = _standard_positions()
    found = {name: named[name.lower()] for name in eeg if name.lower() in named}
    # One montage for all: a second one would take from the others what they have.
    montage = mne.channels.make_dig_montage(found | own, **landmarks)
    instance.set_montage(montage, on_missing="ignore", verbose="error")


def refuse_unlocated(info, path) -> None:
    """Refuse EEG channels that have no place on the scalp: triggers, labels, sensors."""
    if lost := unlocated(info):
        raise ValueError(
            f"{path}: EEG channel {', '.join(lost)} has no position, neither in the file nor by a "
            f"name of the 10-05 system; {_REMEDY.format(names=' '.join(lost))}"
        )


def unlocated(info) -> list[str]:
    """Names of EEG channels that have no place on the scalp."""
    kinds = zip(info.get_channel_types(), info["chs"], strict=True)
    return [c["ch_name"] for kind, c in kinds if kind == "eeg" and not _is_located(c)]


def channel_auroc(signals, labels) -> np.ndarray:
    """AUROC of each channel alone, by its mean in time bins and, last, in the whole epoch.

    From signals (n, n_channels, n_times) that are not re-referenced, which would spread a leak over
    all channels, to shape (n_channels, n_bins + 1).
    """
    bins = np.array_split(signals, min(BINS, signals.shape[2]), axis=2)
    return auroc(np.stack([part.mean(axis=2) for part in (*bins, signals)], axis=2), labels)


def refuse_leaks(aurocs, channels, source) -> np.ndarray:
    """Refuse channels that tell the classes better than `MAX_AUROC` over all people.

    From one `channel_auroc` per person to the best of each channel, in either direction, averaged
    over people, shape (n_channels,). `source` is for the message, here and below.
    """
    best = 0.5 + np.abs(np.mean(aurocs, axis=0) - 0.5).max(axis=1)
    known = {name: value for name, value in zip(channels, best, strict=True) if value > MAX_AUROC}
    if known:
        told = ", ".join(f"{name} (AUROC {value:.3f})" for name, value in known.items())
        raise ValueError(
            f"{source}: channel {told} alone tells errors from correct epochs over all people, as "
            f"a trigger or a label would and EEG does not; {_REMEDY.format(names=' '.join(known))}"
        )
    return best


def single_channels(cohort, source) -> pd.Series:
    """What `refuse_leaks` finds of a cohort in the recorded reference, the highest AUROC first."""
    aurocs: list[np.ndarray] = []
    channels: tuple[str, ...] = ()
    for subject in cohort:
        epochs = SubjectEpochs.from_mne(subject, cohort[subject])
        channels = channels or epochs.channels
        if set(channels) <= set(epochs.channels):  # who lacks one is refused where it is decoded
            order = [epochs.channels.index(name) for name in channels]
            aurocs.append(channel_auroc(epochs.signals[:, order], epochs.labels))
    best = refuse_leaks(aurocs, channels, source)
    return pd.Series(best, channels, name="AUROC").sort_values(ascending=False)


@cache
def _standard_positions():
    """Place of each electrode, by its name in small letters, and of the landmarks."""
    head = [
        mne.channels.transform_to_head(mne.channels.make_standard_montage(name)).get_positions()
        for name in ("standard_1020", "standard_1005")
    ]
    # The 10-20 system has O9 and O10 beside those of the 10-05; what both have is equal.
    named = {n.lower(): place for system in head for n, place in system["ch_pos"].items()}
    return named, {name: head[1][name] for name in ("nasion", "lpa", "rpa", "coord_frame")}


def _is_located(channel):
    place = channel["loc"][:3]
    return bool(np.isfinite(place).all() and place.any())
