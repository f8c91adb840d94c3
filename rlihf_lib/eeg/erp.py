"""Averages over epochs: the error-minus-correct difference wave and how large it is."""

import mne
import numpy as np
from scipy import stats


def difference_wave(epochs) -> mne.EvokedArray:
    """Mean of the ``error`` epochs minus mean of the ``correct`` ones: EEG channels, volts."""
    return mne.combine_evoked(
        [epochs["error"].average(picks="eeg"), epochs["correct"].average(picks="eeg")], [1, -1]
    )


def confidence_band(waves, level=0.95) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean over at least two subjects with its confidence band, by Student's t at every sample.

    Of waves, shape (n_subjects, n_times); mean, low and high have shape (n_times,).
    """
    mean = waves.mean(axis=0)
    low, high = stats.t.interval(level, len(waves) - 1, mean, stats.sem(waves))
    return mean, low, high


def peak_over_sd(epochs, channel="Cz", span=(0.1, 0.6), h_freq=10.0) -> tuple[float, float]:
    """Largest difference between the classes over the trial-to-trial standard deviation there.

    Of the deviations (sample, n - 1) of the two classes, the root of their mean square.

    Parameters
    ----------
    epochs : mne.BaseEpochs
    channel : str
    span : pair of float
        Where the peak is sought, s after the feedback.
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
    within = np.flatnonzero((epochs.times >= span[0]) & (epochs.times <= span[1]))
    peak = within[np.abs(difference[within]).argmax()]
    return float(np.abs(difference[peak]) / sd[peak]), float(epochs.times[peak])
