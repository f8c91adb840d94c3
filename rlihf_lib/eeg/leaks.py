"""Channels that know the answer."""

import numpy as np
import pandas as pd

from rlihf_lib.eeg.channels import REMEDY
from rlihf_lib.eeg.scores import auroc
from rlihf_lib.eeg.signals import SubjectEpochs

MAX_AUROC = 0.95  # no electrode of people tells errors so well; a trigger or a label does
BINS = 32  # of the epoch, in each of which a channel is averaged


def channel_auroc(signals, labels):
    """How well each channel alone tells the classes, by its mean in each of some time bins.

    Parameters
    ----------
    signals : ndarray, shape (n_epochs, n_channels, n_times)
        Before any re-referencing, which would spread a leak over all channels.
    labels : ndarray of int, shape (n_epochs,)
        1 = error.

    Returns
    -------
    ndarray, shape (n_channels, n_bins + 1)
        AUROC of the value, 0 to 1; last that of the mean over the epoch.
    """
    bins = np.array_split(signals, min(BINS, signals.shape[2]), axis=2)
    return auroc(np.stack([part.mean(axis=2) for part in (*bins, signals)], axis=2), labels)


def refuse_leaks(aurocs, channels, source):
    """Refuse channels that tell the classes too well over all people.

    Parameters
    ----------
    aurocs : sequence of ndarray, shape (n_channels, n_bins)
        From `channel_auroc`, one per person.
    channels : sequence of str
    source : str
        For the message.

    Returns
    -------
    ndarray, shape (n_channels,)
        Best AUROC of each channel, in either direction, averaged over people.

    Raises
    ------
    ValueError
        Names the channels above `MAX_AUROC`, and the remedy.
    """
    best = 0.5 + np.abs(np.mean(aurocs, axis=0) - 0.5).max(axis=1)
    known = {name: value for name, value in zip(channels, best, strict=True) if value > MAX_AUROC}
    if known:
        told = ", ".join(f"{name} (AUROC {value:.3f})" for name, value in known.items())
        raise ValueError(
            f"{source}: channel {told} alone tells errors from correct epochs over all people, as "
            f"a trigger or a label would and EEG does not; {REMEDY.format(names=' '.join(known))}"
        )
    return best


def single_channels(load, subjects, source):
    """Refuse leaks, and say how well single channels tell the classes.

    Parameters
    ----------
    load : callable
        Subject -> preprocessed `mne.Epochs` in the recorded reference.
    subjects : sequence of str
    source : str
        For the message.

    Returns
    -------
    Series
        Best AUROC of each channel (`refuse_leaks`), the highest first.
    """
    aurocs, channels = [], None
    for subject in subjects:
        epochs = SubjectEpochs.from_mne(subject, load(subject))
        channels = channels or epochs.channels
        order = [epochs.channels.index(name) for name in channels if name in epochs.channels]
        if len(order) == len(channels):  # who lacks one is refused where epochs are decoded
            aurocs.append(channel_auroc(epochs.signals[:, order], epochs.labels))
    best = refuse_leaks(aurocs, channels, source)
    return pd.Series(best, channels, name="AUROC").sort_values(ascending=False)
