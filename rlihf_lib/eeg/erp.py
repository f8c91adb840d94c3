"""Averages over epochs: the error-minus-correct difference wave and how large it is."""

import mne
import numpy as np
from scipy import stats


def difference_wave(epochs):
    """Mean of the error epochs minus mean of the correct epochs.

    Parameters
    ----------
    epochs : mne.BaseEpochs
        With events ``correct`` and ``error``.

    Returns
    -------
    mne.EvokedArray
        EEG channels, volts.
    """
    return mne.combine_evoked(
        [epochs["error"].average(picks="eeg"), epochs["correct"].average(picks="eeg")], [1, -1]
    )


def confidence_band(waves, level=0.95):
    """Mean over subjects with its confidence band, by Student's t at every sample.

    Parameters
    ----------
    waves : ndarray, shape (n_subjects, n_times)
        At least two subjects.
    level : float

    Returns
    -------
    mean, low, high : ndarray, shape (n_times,)
    """
    n = len(waves)
    half = stats.t.ppf((1 + level) / 2, n - 1) * waves.std(axis=0, ddof=1) / np.sqrt(n)
    mean = waves.mean(axis=0)
    return mean, mean - half, mean + half


def peak_over_sd(epochs, channel="Cz", stop=0.6, h_freq=10.0):
    """Largest difference between the classes over the trial-to-trial standard deviation there.

    Of the deviations (sample, n - 1) of the two classes, the root of their mean square.

    Parameters
    ----------
    epochs : mne.BaseEpochs
    channel : str
    stop : float
        The peak is sought from 0.1 s after the feedback to here, s.
    h_freq : float
        Low-pass before, Hz, as for the published value; for epochs of at least 1 s.

    Returns
    -------
    ratio : float
    latency : float
        Of the peak, s.
    """
    values, labels = epochs.get_data(channel)[:, 0], epochs.events[:, 2]
    values = mne.filter.filter_data(values, epochs.info["sfreq"], None, h_freq, verbose="error")
    classes = [values[labels == epochs.event_id[name]] for name in ("error", "correct")]
    difference = classes[0].mean(axis=0) - classes[1].mean(axis=0)
    sd = np.sqrt(np.mean([values.var(axis=0, ddof=1) for values in classes], axis=0))
    within = np.flatnonzero((epochs.times >= 0.1) & (epochs.times <= stop))
    peak = within[np.abs(difference[within]).argmax()]
    return float(np.abs(difference[peak]) / sd[peak]), float(epochs.times[peak])
