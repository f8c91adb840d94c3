"""Averages over epochs: waves of both classes, their difference and how large it is."""

import mne
import numpy as np
import pandas as pd

H_FREQ = 10.0  # Hz, low-pass of `peak_over_sd`
PEAK = (0.1, 0.6)  # s after the feedback, where it seeks the peak


def difference_wave(epochs) -> mne.EvokedArray:
    """Mean of the ``error`` epochs minus mean of the ``correct`` ones: EEG channels, volts."""
    return mne.combine_evoked(
        [epochs["error"].average(picks="eeg"), epochs["correct"].average(picks="eeg")], [1, -1]
    )


def excerpt(raw, events, channel, epoch, before=3.5, seconds=5.0) -> tuple[pd.Series, list]:
    """A piece of a continuous recording around a feedback, and the feedbacks in it.

    The recording and its events are as `preprocessing.load_continuous` gives them, `epoch` is the
    number of a feedback, which `before` s precede. The signal, µV around its median, is by time, s
    from the start of the piece; of each feedback come its time and its label, 1 for an error.
    """
    rate = raw.info["sfreq"]
    (sample,) = events.loc[events["epoch"] == epoch, "sample"]
    start = max(0, int(sample - before * rate))
    values = 1e6 * raw.get_data(channel, start, min(raw.n_times, start + int(seconds * rate)))[0]
    inside = events[
        events["sample"].between(start, start + len(values) - 1) & (events["label"] >= 0)
    ]
    feedbacks = list(zip((inside["sample"] - start) / rate, inside["label"], strict=True))
    return pd.Series(values - np.median(values), np.arange(len(values)) / rate), feedbacks


def class_waves(epochs, channels, stop=0.8) -> pd.Series:
    """Mean waves of both classes until `stop` s, µV, by event, channel and time."""
    waves = {}
    for event in ("correct", "error"):
        mean = epochs[event].average(picks=channels)
        mean.apply_baseline((None, 0) if mean.tmin < 0 else None)  # where it can be had
        waves[event] = mean.to_data_frame(index="time")[:stop].unstack()
    return pd.concat(waves, names=["event", "channel", "time"])


def peak_over_sd(epochs) -> tuple[float, float]:
    """Largest difference of the classes at Cz over the trial-to-trial SD there; its latency in s.

    Low-passed as the published value is, which needs epochs of at least 1 s. Of the deviations
    (sample, n - 1) of the two classes, the root of their mean square.
    """
    values, labels = epochs.get_data("Cz")[:, 0], epochs.events[:, 2]
    values = mne.filter.filter_data(values, epochs.info["sfreq"], None, H_FREQ, verbose="error")
    classes = [values[labels == epochs.event_id[name]] for name in ("error", "correct")]
    difference = classes[0].mean(axis=0) - classes[1].mean(axis=0)
    sd = np.sqrt(np.mean([values.var(axis=0, ddof=1) for values in classes], axis=0))
    within = np.flatnonzero((epochs.times >= PEAK[0]) & (epochs.times <= PEAK[1]))
    peak = within[np.abs(difference[within]).argmax()]
    return float(np.abs(difference[peak]) / sd[peak]), float(epochs.times[peak])
