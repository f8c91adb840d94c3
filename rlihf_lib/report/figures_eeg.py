"""Figures of the recordings. Each function takes data, draws, and returns the figure."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import mne
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rlihf_lib.eeg.erp import confidence_band
from rlihf_lib.eeg.published import CZ
from rlihf_lib.report.style import BEHIND, COLORS, PAGE_WIDTH

# Light to dark greys of what was dropped, hatched for print.
DROPPED = ("#999999", "#CCCCCC", "#666666", "#E5E5E5")
MS, UV = 1e3, 1e6  # from s and V


def trial_counts_figure(counts: pd.DataFrame) -> Figure:
    """Stacked bars of the feedback events of each subject.

    `counts` has a row per subject; columns correct, error, and whatever was dropped for.
    """
    fig, ax = plt.subplots(figsize=(PAGE_WIDTH, 2.2))
    colors = [COLORS["correct"], COLORS["error"], *DROPPED][: counts.shape[1]]
    shown = counts.rename(columns=lambda n: n if n in ("correct", "error") else f"dropped: {n}")
    shown.plot.bar(stacked=True, ax=ax, color=colors, width=0.75, rot=0, ec="white", lw=0.3)
    for bar in ax.patches[2 * len(counts) :]:
        bar.set_hatch("//")
    ax.set(xlabel="Subject", ylabel="Feedback events")
    ax.grid(axis="x", visible=False)
    ax.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return fig


def difference_waves_figure(
    waves: dict[str, np.ndarray], times: np.ndarray, published: bool = False
) -> Figure:
    """Error-minus-correct waves of the subjects, their mean and its 95 % band, a panel a channel.

    Name of a channel -> volts, shape (n_subjects, n_times), at `times`, s; at the lower edge of Cz
    the intervals of the `published` wave, if asked.
    """
    fig, axes = plt.subplots(1, len(waves), figsize=(PAGE_WIDTH, 2.2), sharey=True, squeeze=False)
    for ax, (channel, values) in zip(axes[0], waves.items(), strict=True):
        ax.axhline(0, color="black", linewidth=0.5)
        ax.plot(MS * times, UV * values.T, **BEHIND)
        mean, low, high = confidence_band(UV * values)
        ax.fill_between(MS * times, low, high, color=COLORS["error"], alpha=0.3, linewidth=0)
        ax.plot(MS * times, mean, color=COLORS["error"], linewidth=1.6)
        ax.set(title=channel, xlabel="Time after feedback (ms)")
        ax.set_xlim(MS * times[0], MS * times[-1])
        if published and channel == "Cz":
            low, high = ax.get_ylim()
            ax.set_ylim(low - 0.08 * (high - low), high)  # room for the marks, below the waves
            for sign, start, stop in CZ:
                grey, mark = ("0.85", "+") if sign > 0 else ("0.6", "−")
                ax.axvspan(MS * start, MS * stop, ymax=0.07, facecolor=grey)
                place = {"transform": ax.get_xaxis_transform(), "ha": "center", "va": "center"}
                ax.text(MS * (start + stop) / 2, 0.035, mark, fontsize=7, **place)
    axes[0, 0].set_ylabel("Error − correct (µV)")
    return fig


def topographies_figure(evoked: mne.Evoked, times: Sequence[float]) -> Figure:
    """Scalp maps of an error-minus-correct wave, one per time (s)."""
    fig, axes = plt.subplots(1, len(times), figsize=(1.3 * len(times) + 0.6, 1.6), squeeze=False)
    values = np.stack([evoked.data[:, np.abs(evoked.times - t).argmin()] for t in times]) * UV
    limit = np.abs(values).max()
    for ax, value, time in zip(axes[0], values, times, strict=True):
        image, _ = mne.viz.plot_topomap(
            value, evoked.info, axes=ax, show=False, vlim=(-limit, limit), cmap="RdBu_r", contours=4
        )
        ax.set_title(f"{MS * time:.0f} ms")
    fig.colorbar(image, ax=axes, label="Error − correct (µV)")
    return fig


def spectra_figure(spectra: pd.DataFrame, band: tuple[float, float]) -> Figure:
    """Power densities, a column of µV²/Hz per signal, against the index, Hz; `band` is shaded."""
    fig, ax = plt.subplots(figsize=(PAGE_WIDTH / 2, 2.2))
    ax.axvspan(*band, color="#F0F0F0", zorder=0)
    decibels = 10 * np.log10(spectra)
    decibels.plot(ax=ax, style=["-", "--"], color=["#7F7F7F", COLORS["correct"]])
    ax.set(xlabel="Frequency (Hz)", ylabel="Power density\n(dB re 1 µV²/Hz)")
    ax.legend(loc="upper right")
    return fig
