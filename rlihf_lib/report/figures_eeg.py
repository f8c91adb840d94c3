"""Pictures of the recordings. Each function takes data and optional axes and returns axes."""

import matplotlib.pyplot as plt
import mne
import numpy as np

from rlihf_lib.eeg.erp import confidence_band
from rlihf_lib.eeg.published import CZ
from rlihf_lib.report.style import COLORS

#: Light to dark greys of what was dropped, with hatches for print.
_DROPPED = ("#999999", "#CCCCCC", "#666666", "#E5E5E5")


def plot_trial_counts(counts, ax=None):
    """Stacked bars of the epochs of each subject.

    Parameters
    ----------
    counts : pandas.DataFrame
        One row per subject; columns correct, error, and whatever was dropped for.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
    """
    ax = ax or plt.gca()
    colors = [COLORS["correct"], COLORS["error"], *_DROPPED]
    bottom = np.zeros(len(counts))
    for name, color in zip(counts.columns, colors, strict=False):
        dropped = "" if name in ("correct", "error") else "dropped: "
        ax.bar(
            counts.index, counts[name], bottom=bottom, color=color, width=0.75,
            label=dropped + name, hatch="//" if dropped else None, edgecolor="white", linewidth=0.3,
        )  # fmt: skip
        bottom += counts[name].to_numpy()
    ax.set(xlabel="Subject", ylabel="Feedback events")
    ax.grid(axis="x", visible=False)
    ax.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return ax


def plot_difference_waves(waves, times, channel, ax=None, published=False):
    """Error-minus-correct waves of the subjects at one channel, their mean and its 95 % band.

    Parameters
    ----------
    waves : ndarray, shape (n_subjects, n_times)
        Volts.
    times : ndarray, shape (n_times,)
        s.
    channel : str
    ax : matplotlib Axes, optional
    published : bool
        Mark the intervals of the published wave at Cz at the lower edge.

    Returns
    -------
    matplotlib Axes
    """
    ax = ax or plt.gca()
    ms, waves = 1000 * times, 1e6 * waves
    ax.axhline(0, color="black", linewidth=0.5)
    ax.plot(ms, waves.T, color="#999999", linewidth=0.5, alpha=0.8)
    mean, low, high = confidence_band(waves)
    ax.fill_between(ms, low, high, color=COLORS["error"], alpha=0.3, linewidth=0)
    ax.plot(ms, mean, color=COLORS["error"], linewidth=1.6)
    if published:
        low, high = ax.get_ylim()
        ax.set_ylim(low - 0.08 * (high - low), high)  # room for the marks, below the waves
        for sign, start, stop in CZ:
            middle = 500 * (start + stop)
            ax.axvspan(
                1000 * start, 1000 * stop, ymax=0.07, facecolor="0.85" if sign > 0 else "0.6"
            )
            ax.text(
                middle, 0.035, "+" if sign > 0 else "−", transform=ax.get_xaxis_transform(),
                ha="center", va="center", fontsize=7,
            )  # fmt: skip
    ax.set(title=channel, xlabel="Time after feedback (ms)", xlim=(ms[0], ms[-1]))
    return ax


def plot_topographies(evoked, times, axes=None):
    """Scalp maps of an evoked response.

    Parameters
    ----------
    evoked : mne.Evoked
        EEG channels with positions; volts.
    times : sequence of float
        s, one map each.
    axes : sequence of matplotlib Axes, optional
        One more than `times`: the last takes the colour bar.

    Returns
    -------
    sequence of matplotlib Axes
    """
    if axes is None:
        _, axes = plt.subplots(
            1, len(times) + 1, width_ratios=[1] * len(times) + [0.07],
            figsize=(1.3 * len(times) + 0.6, 1.6),
        )  # fmt: skip
    values = np.stack([evoked.data[:, np.abs(evoked.times - t).argmin()] for t in times]) * 1e6
    limit = np.abs(values).max()
    for ax, value, time in zip(axes, values, times, strict=False):
        image, _ = mne.viz.plot_topomap(
            value, evoked.info, axes=ax, show=False, vlim=(-limit, limit), cmap="RdBu_r", contours=4
        )
        ax.set_title(f"{1000 * time:.0f} ms")
    bar = plt.colorbar(image, cax=axes[len(times)])
    bar.set_label("Error − correct (µV)")
    return axes


def plot_spectra(spectra, band, ax=None):
    """Power spectral densities, median over channels.

    Parameters
    ----------
    spectra : dict
        Name -> mne.time_frequency.Spectrum.
    band : (float, float)
        Edges of the band-pass, Hz, shaded.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
    """
    ax = ax or plt.gca()
    ax.axvspan(*band, color="#F0F0F0", zorder=0)
    styles = (("#7F7F7F", "-"), (COLORS["correct"], "--"))
    for (name, spectrum), (color, line) in zip(spectra.items(), styles, strict=False):
        power = np.median(spectrum.get_data(picks="eeg"), axis=0) * 1e12
        ax.plot(spectrum.freqs, 10 * np.log10(power), line, color=color, label=name)
    ax.set(xlabel="Frequency (Hz)", ylabel="Power density\n(dB re 1 µV²/Hz)")
    ax.legend(loc="upper right")
    return ax
