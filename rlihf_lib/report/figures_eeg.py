"""Figures of the recordings. Each function takes data, draws, and returns the figure."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rlihf_lib.report.statistics import mean_interval
from rlihf_lib.report.style import BEHIND, COLORS, COLUMN_WIDTH, PAGE_WIDTH

# Light to dark greys of what was dropped, hatched for print.
DROPPED = ("#999999", "#CCCCCC", "#666666", "#E5E5E5")
MS = 1e3  # from s


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


def waves_figure(waves: pd.DataFrame, components: Sequence[tuple] = ()) -> Figure:
    """Waves of both classes and, below, their difference; a column of panels a channel.

    `waves`, µV, has a column per subject, the rows of `erp.class_waves`. Lines are means over
    subjects with their 95 % intervals, thin ones subjects. The `components` of the difference at
    Cz, as in `eeg.published`, are shaded and named: N236 is negative, its middle 236 ms.
    """
    channels = waves.index.unique("channel")
    fig, axes = plt.subplots(2, len(channels), sharex=True, sharey="row", squeeze=False)
    fig.set_size_inches(PAGE_WIDTH, 3.9)
    for (upper, lower), channel in zip(axes.T, channels, strict=True):
        correct, error = (waves.loc[event].loc[channel] for event in ("correct", "error"))
        _mean_wave(upper, correct, COLORS["correct"], ls=(0, (4, 1.5)), label="correct")
        _mean_wave(upper, error, COLORS["error"], label="error")
        lower.plot(MS * error.index, error - correct, **BEHIND | {"lw": 0.5})
        _mean_wave(lower, error - correct, "black")
        upper.set_title(channel)
        lower.set(xlabel="Time after feedback (ms)", xlim=MS * error.index[[0, -1]])
        for sign, start, stop in components if channel == "Cz" else ():
            kind, y, grey = ("P", 0.95, "0.94") if sign > 0 else ("N", 0.05, "0.87")
            lower.axvspan(MS * start, MS * stop, color=grey, lw=0, zorder=0)
            middle, across = MS * (start + stop) / 2, lower.get_xaxis_transform()
            look = {"fontsize": 7, "ha": "center", "va": "center", "transform": across}
            lower.text(middle, y, f"{kind}{middle:.0f}", **look)
    axes[0, 0].set_ylabel("Mean response (µV)")
    axes[1, 0].set_ylabel("Error − correct (µV)")
    axes[1, 0].margins(y=0.15)  # room for the names
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


def _mean_wave(ax, values, color, **line):
    low, high = mean_interval(values.T)
    ax.fill_between(MS * values.index, low, high, color=color, alpha=0.3, lw=0)
    ax.plot(MS * values.index, values.mean(axis=1), color=color, lw=1.4, **line)
    ax.axhline(0, color="black", lw=0.5)
    ax.axvline(0, color="black", lw=0.5)


def spectra_figure(spectra: pd.DataFrame, band: tuple[float, float]) -> Figure:
    """Power densities, a column of µV²/Hz per signal, against the index, Hz; `band` is shaded."""
    fig, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.3))
    low, high = band
    ax.axvspan(*band, color="#E8E8E8", lw=0, zorder=0, label=f"pass-band, {low:g} to {high:g} Hz")
    decibels = 10 * np.log10(spectra)
    decibels.plot(ax=ax, style=["-", "--"], color=["#BBBBBB", "black"])
    ax.set(xlabel="Frequency (Hz)", ylabel="Power density\n(dB re 1 µV²/Hz)")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 0.2))  # clear of both lines
    return fig
