"""Figures of the decoder: Fig. 5, how far p(error) can be trusted, what the networks look at.

Each function takes a table or a decoder, draws, and returns axes or a figure.
"""

import matplotlib.pyplot as plt
import mne
import numpy as np

from rlihf_lib.eeg.scores import reliability
from rlihf_lib.report.style import COLORS, COLUMN_WIDTH, PAGE_WIDTH, note


def figure_5(scores, caption=""):
    """Fig. 5: accuracy at pretraining (yellow) and online (orange), a pair of bars per subject.

    Parameters
    ----------
    scores : DataFrame
        As `loso.run_loso` returns it.
    caption : str

    Returns
    -------
    matplotlib Figure
    """
    fig, ax = plt.subplots(figsize=(PAGE_WIDTH, 2.4))
    x = np.arange(len(scores) + 1)
    names = [*scores["subject"], "mean"]
    for side, column, label in (
        (-0.2, "accuracy_pretrain", "Pretraining (validation subjects)"),
        (0.2, "accuracy_online", "Online (held-out subject, replayed)"),
    ):
        values = [*scores[column], scores[column].mean()]
        color = COLORS["pretrain" if side < 0 else "online"]
        ax.bar(x + side, values, 0.38, color=color, edgecolor="#555555", lw=0.4, label=label)
    below = scores["accuracy_online"] - scores["accuracy_online_low"]
    above = scores["accuracy_online_high"] - scores["accuracy_online"]
    ax.errorbar(
        x[:-1] + 0.2, scores["accuracy_online"], [below, above], fmt="none", ecolor="#333333",
        elinewidth=0.8, capsize=1.5, label="95 % interval over trials",
    )  # fmt: skip
    majority = [*scores["majority"], scores["majority"].mean()]
    ax.hlines(majority, x - 0.42, x + 0.42, color="black", lw=1, label="Always the majority class")
    ax.axhline(0.5, color="#888888", lw=0.8, ls=(0, (2, 2)), label="Coin")
    ax.axvline(len(scores) - 0.5, color="#BBBBBB", lw=0.6)
    ax.set_xticks(x, names)
    ax.set(ylim=(0, 1.0), xlim=(-0.6, len(x) - 0.4), ylabel="Accuracy", xlabel="Held-out subject")
    ax.grid(axis="x", visible=False)
    fig.legend(loc="outside upper center", ncols=5, columnspacing=1.0, handlelength=1.5)
    note(fig, caption)
    return fig


def subject_scores(scores, ax, column, chance, label):
    """Draw one score per subject with its 95 % interval over trials, best subject last.

    Parameters
    ----------
    scores : DataFrame
    ax : matplotlib Axes
    column : str
        A score with `_low` and `_high`.
    chance : Series or float
        Chance level of each subject.
    label : str
        Of the axis.
    """
    ranked = scores.sort_values("auroc").reset_index(drop=True)
    x = np.arange(len(ranked))
    low, high = ranked[f"{column}_low"], ranked[f"{column}_high"]
    ax.errorbar(
        x, ranked[column], [ranked[column] - low, high - ranked[column]], fmt="o", ms=3.5,
        color=COLORS["dense"], elinewidth=0.9, capsize=1.5,
    )  # fmt: skip
    if np.isscalar(chance):
        ax.axhline(chance, color="#888888", lw=0.8, ls=(0, (2, 2)))
    else:
        ax.plot(x, chance[scores.sort_values("auroc").index], "_", color="#888888", ms=9)
    ax.axhline(ranked[column].mean(), color=COLORS["dense"], lw=0.8, alpha=0.5)
    ax.set_xticks(x, ranked["subject"], rotation=60)
    ax.set_ylabel(label)
    return ax


def scores_figure(scores, caption=""):
    """AUROC and balanced accuracy per subject, with chance level and mean."""
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.3))
    subject_scores(scores, axes[0], "auroc", 0.5, "AUROC")
    chance = scores["balanced_accuracy_chance"]
    subject_scores(scores, axes[1], "balanced_accuracy", chance, "Balanced accuracy")
    axes[0].set_title("Dots: 95 % interval over trials. Blue line: mean. Dashed: chance")
    axes[1].set_title("Grey: 95th percentile under permuted labels")
    note(fig, caption)
    return fig


def reliability_figure(table, caption="", n_bins=10):
    """Promised against observed fraction of errors, before and after temperature scaling.

    Parameters
    ----------
    table : DataFrame
        p_error.csv: all held-out epochs.
    caption : str
    n_bins : int

    Returns
    -------
    matplotlib Figure
    """
    fig, (ax, histogram) = plt.subplots(
        2, 1, figsize=(COLUMN_WIDTH, 3.3), sharex=True, height_ratios=(3, 1)
    )
    ax.plot([0, 1], [0, 1], color="#888888", lw=0.8, ls=(0, (2, 2)), label="Perfect")
    for column, color, marker, label in (
        ("p_error_raw", COLORS["sparse"], "s", "Raw"),
        ("p_error", COLORS["rlihf"], "o", "Temperature-scaled"),
    ):
        p, labels = table[column].to_numpy(), table["label"].to_numpy()
        promised, observed, count = reliability(p, labels, n_bins)
        error = 1.96 * np.sqrt(observed * (1 - observed) / np.maximum(count, 1))
        ax.errorbar(
            promised, observed, error, color=color, marker=marker, ms=3.5, capsize=1.5, label=label
        )
        edges = np.linspace(0, 1, n_bins + 1)
        histogram.stairs(count / count.sum(), edges, color=color)
    ax.set(ylabel="Observed fraction of errors", xlim=(0, 1), ylim=(0, 1))
    ax.legend(loc="upper left")
    histogram.set(xlabel="Decoded p(error)", ylabel="Epochs")
    note(fig, caption + "\nbars: 95 % normal interval")
    return fig


def patterns_figure(decoder, signals, positions, network=0, caption=""):
    """Show what one network of a decoder follows: temporal filters above, patterns below.

    Parameters
    ----------
    decoder : decoder.Decoder
    signals : ndarray, shape (n, n_channels, n_times)
        Epochs, in volts, for the patterns; see `Decoder.patterns`.
    positions : mne.Info
        With the positions of the decoder's channels.
    network : int
    caption : str

    Returns
    -------
    matplotlib Figure
    """
    temporal, patterns = decoder.patterns(signals, network)
    n_temporal, n_spatial, _ = patterns.shape
    info = mne.pick_info(positions, [positions.ch_names.index(c) for c in _eeg(decoder, positions)])
    picks = [decoder.input_format.channels.index(name) for name in info.ch_names]
    frequencies = np.fft.rfftfreq(256, 1 / decoder.input_format.network_sfreq)
    gains = np.abs(np.fft.rfft(temporal, 256, axis=1))
    fig, axes = plt.subplots(
        1 + n_spatial, n_temporal, figsize=(PAGE_WIDTH, 1.0 + 0.95 * n_spatial),
        squeeze=False,
    )  # fmt: skip
    for f in range(n_temporal):
        ax = axes[0, f]
        ax.plot(frequencies, gains[f] / gains.max(), color=COLORS["dense"])
        ax.set(ylim=(0, 1.05), xlim=(0, 15), title=f"filter {f + 1}")
        if f:
            ax.set_yticklabels([])
        else:
            ax.set(ylabel="Gain (rel.)", xlabel="Frequency (Hz)")
        for d in range(n_spatial):
            pattern = patterns[f, d, picks]
            image, _ = mne.viz.plot_topomap(
                pattern / np.abs(pattern).max(), info, axes=axes[1 + d, f], show=False, contours=0,
                cmap="RdBu_r", vlim=(-1, 1), sensors=False,
            )  # fmt: skip
    bar = fig.colorbar(image, ax=axes[1:, -1], shrink=0.8, aspect=12)
    bar.set_label("Pattern (rel.)")
    note(fig, caption)
    return fig


def _eeg(decoder, positions):
    eeg = [positions.ch_names[i] for i in mne.pick_types(positions, eeg=True)]
    return [name for name in decoder.input_format.channels if name in eeg]


def channels_figure(tables, caption=""):
    """AUROC with different channels, a line per subject.

    Parameters
    ----------
    tables : dict of str to DataFrame
        Label of the channels -> scores.
    caption : str

    Returns
    -------
    matplotlib Figure
    """
    fig, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.3))
    values = np.array([table["auroc"] for table in tables.values()])
    x = np.arange(len(tables))
    ax.plot(x, values, color="#BBBBBB", lw=0.8, marker=".", ms=4)
    ax.plot(x, values.mean(1), color=COLORS["dense"], marker="o", ms=5, label="Mean over subjects")
    ax.axhline(0.5, color="#888888", lw=0.8, ls=(0, (2, 2)), label="Chance")
    ax.set_xticks(x, tables)
    ax.set(ylabel="AUROC", xlim=(-0.3, len(x) - 0.7))
    ax.legend()
    note(fig, caption)
    return fig


def online_update_figure(updates, caption=""):
    """Accuracy, balanced accuracy and AUROC against the number of fine-tuning events.

    Parameters
    ----------
    updates : DataFrame
        As `finetuning.online_update` returns it.
    caption : str

    Returns
    -------
    matplotlib Figure
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.1))
    labels = {"accuracy": "Accuracy", "balanced_accuracy": "Balanced accuracy", "auroc": "AUROC"}
    for ax, (column, label) in zip(axes, labels.items(), strict=True):
        lines = updates.pivot(index="n_events", columns="subject", values=column)
        ax.plot(lines.index, lines, color="#CCCCCC", lw=0.7)
        ax.plot(lines.index, lines.mean(axis=1), color=COLORS["online"], marker="o", ms=4)
        ax.set(xlabel="Labelled events of the person, N", ylabel=label, xticks=lines.index)
    note(fig, caption)
    return fig
