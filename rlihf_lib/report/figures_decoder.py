"""Figures of the decoder: Fig. 5, how far p(error) can be trusted, what the networks look at."""

import matplotlib.pyplot as plt
import mne
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rlihf_lib.eeg.scores import N_BINS, reliability
from rlihf_lib.report import paper
from rlihf_lib.report.statistics import PROBABILITY, interval, mean_interval
from rlihf_lib.report.style import BEHIND, COLORS, COLUMN_WIDTH, PAGE_WIDTH, REFERENCE, SHARE

SCORES = {"accuracy": "Accuracy", "balanced_accuracy": "Balanced accuracy", "auroc": "AUROC"}
MAX_FREQUENCY = 15  # Hz, of temporal filters
N_FFT = 256
MIN_EPOCHS = 10  # of a person in a bin of p(error), below which it is left out


def figure_5(scores: pd.DataFrame) -> Figure:
    """Fig. 5: accuracy at pretraining (yellow) and online (orange), a pair of bars per subject.

    Behind them the range that the paper calls typical. `scores` is as `loso.run_loso` returns it.
    """
    table = scores.set_index("subject")
    table.loc["mean"] = table.mean(numeric_only=True)
    fig, ax = plt.subplots(figsize=(PAGE_WIDTH, 2.6))
    bars = table[["accuracy_pretrain", "accuracy_online"]]
    bars.columns = ["Pretraining (validation subjects)", "Online (held-out subject, replayed)"]
    bars.plot.bar(
        ax=ax, color=[COLORS["pretrain"], COLORS["online"]], width=0.78, ec="#555555", lw=0.4,
        rot=0, legend=False,
    )  # fmt: skip
    x, online = np.arange(len(table)), table["accuracy_online"].to_numpy()
    over_people = mean_interval(scores["accuracy_online"].to_numpy(), PROBABILITY)
    arms = np.c_[_arms(scores, "accuracy_online"), abs(over_people - online[-1])]
    ax.errorbar(
        x + 0.2, online, arms, fmt="none", ecolor="#333333", elinewidth=0.8, capsize=1.5,
        label="95 % interval over trials (mean: over subjects)",
    )  # fmt: skip
    majority = table["majority"]
    ax.hlines(majority, x, x + 0.39, color="black", lw=1, label="Always the majority class")
    ax.axhline(0.5, label="Coin", **REFERENCE)
    ax.axhspan(*paper.ACCURACY, color="#E3EDF5", zorder=0, label="Paper: typically 70 to 90 %")
    ax.axvline(len(scores) - 0.5, color="#BBBBBB", lw=0.6)
    ax.set(ylim=(0, 1.0), xlim=(-0.6, len(x) - 0.4), ylabel="Accuracy", xlabel="Held-out subject")
    ax.grid(axis="x", visible=False)
    fig.legend(loc="outside upper center", ncols=3)
    return fig


def _arms(scores, column):
    ends = scores[[f"{column}_low", f"{column}_high"]]
    return ends.sub(scores[column], axis=0).abs().to_numpy().T


def scores_figure(scores: pd.DataFrame) -> Figure:
    """AUROC and balanced accuracy per subject, with chance levels and mean; best decoder last."""
    ranked, shade = scores.set_index("subject").sort_values("auroc"), COLORS["online"]
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.5), sharey=True)
    for ax, column in zip(axes, ("auroc", "balanced_accuracy"), strict=True):
        ax.errorbar(
            ranked.index, ranked[column], _arms(ranked, column), fmt="o", ms=3.5, color=shade,
            elinewidth=0.9, capsize=1.5, label="95 % interval over trials",
        )  # fmt: skip
        ax.axhline(ranked[column].mean(), color=shade, lw=0.8, label="Mean over subjects")
        ax.axhline(0.5, label="Chance", **REFERENCE)
        ax.tick_params(axis="x", rotation=60)
        ax.set(xlabel="Held-out subject", ylabel=SCORES[column])
    label = "95th percentile of chance (permuted labels)"
    axes[1].plot(ranked["balanced_accuracy_chance"], "_", color="black", ms=9, label=label)
    fig.legend(*axes[1].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return fig


def reliability_figure(table: pd.DataFrame) -> Figure:
    """Promised against observed fraction of errors, before and after temperature scaling.

    `table` is p_error.csv: all held-out epochs. Thin lines are people, scaled, in bins of at least
    `MIN_EPOCHS`; thick ones pool all epochs, scaled with their 95 % interval over people.
    """
    fig, axes = plt.subplots(2, figsize=(COLUMN_WIDTH, 3.9), sharex=True, height_ratios=(3, 1))
    ax, histogram = axes
    ax.plot([0, 1], [0, 1], label="Perfect", **REFERENCE)
    people = [own for _, own in table.groupby("subject")]
    for number, own in enumerate(people):
        promised, observed, count = reliability(own["p_error"], own["label"])
        observed[count < MIN_EPOCHS] = np.nan
        label = "" if number else "A person, scaled"
        ax.plot(promised, observed, **BEHIND | {"lw": 0.5}, label=label)
    for column, color, marker, label in (
        ("p_error_raw", "black", "s", "Raw"),
        ("p_error", COLORS["online"], "o", "Temperature-scaled"),
    ):
        promised, observed, count = reliability(table[column], table["label"])
        ax.plot(promised, observed, color=color, marker=marker, ms=3.5, clip_on=False, label=label)
        histogram.stairs(count / count.sum(), np.linspace(0, 1, N_BINS + 1), color=color)
    band = {"color": color, "alpha": 0.25, "lw": 0, "label": "95 % interval over people"}
    ax.fill_between(promised, *_over_people(people), **band)
    ax.set(ylabel="Observed fraction of errors", xlim=(0, 1), ylim=SHARE)
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    histogram.set(xlabel="Decoded p(error)", ylabel="Epochs (share)")
    return fig


def _over_people(people):
    """Interval of the fraction of errors in each bin of all epochs, people resampled."""
    found = [reliability(own["p_error"], own["label"])[1:] for own in people]
    observed, counts = np.transpose(found, (1, 2, 0))
    errors = np.nan_to_num(observed) * counts

    def fraction(i):
        return errors[:, i].sum(-1) / counts[:, i].sum(-1)

    with np.errstate(invalid="ignore"):  # bins that are empty
        return interval(fraction, len(people), bounds=PROBABILITY)


def patterns_figure(decoder, signals: np.ndarray, positions: mne.Info) -> Figure:
    """Show what a decoder's first network follows: temporal filters above, patterns below.

    `signals` are epochs, in volts, shape (n, n_channels, n_times), for `Decoder.patterns`;
    `positions` has those of its channels.
    """
    temporal, patterns = decoder.patterns(signals, 0)
    n_temporal, n_spatial, _ = patterns.shape
    channels = decoder.input_format.channels
    eeg = {positions.ch_names[i] for i in mne.pick_types(positions, eeg=True)}
    picks = [i for i, name in enumerate(channels) if name in eeg]
    info = mne.pick_info(positions, [positions.ch_names.index(channels[i]) for i in picks])
    frequencies = np.fft.rfftfreq(N_FFT, 1 / decoder.input_format.network_sfreq)
    gains = np.abs(np.fft.rfft(temporal, N_FFT, axis=1))
    page = PAGE_WIDTH, 1.0 + 0.95 * n_spatial
    fig, axes = plt.subplots(1 + n_spatial, n_temporal, figsize=page, squeeze=False)
    for f, (ax, *maps) in enumerate(axes.T):
        ax.plot(frequencies, gains[f] / gains.max(), color=COLORS["online"])
        ax.set(ylim=(0, 1.05), xlim=(0, MAX_FREQUENCY), title=f"filter {f + 1}")
        ax.tick_params(labelleft=f == 0)
        for pattern, space in zip(patterns[f][:, picks], maps, strict=True):
            image, _ = mne.viz.plot_topomap(
                pattern / np.abs(pattern).max(), info, axes=space, show=False, contours=0,
                cmap="RdBu_r", vlim=(-1, 1), sensors=False,
            )  # fmt: skip
    axes[0, 0].set(ylabel="Gain\n(largest = 1)", xlabel="Frequency (Hz)")
    for number, ax in enumerate(axes[1:, 0], 1):
        place = {"xycoords": "axes fraction", "rotation": 90, "ha": "right", "va": "center"}
        ax.annotate(f"pattern {number}", (-0.1, 0.5), **place)
    words = "Each scaled to\nits maximum"
    fig.colorbar(image, ax=axes[1:, -1], shrink=0.8, aspect=12, label=words)
    return fig


def channels_figure(tables: dict[str, pd.DataFrame]) -> Figure:
    """AUROC of LDA with different channels (name -> scores); thin lines join a subject's."""
    auroc = pd.concat(tables, names=["channels"]).reset_index("channels")
    fig, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.5))
    _subject_lines(_by_subject(auroc, "channels", "auroc"), ax, "lda", marker="_", ms=14, mew=2)
    ax.axhline(0.5, label="Chance", **REFERENCE)
    ax.set(xlabel="", ylabel="AUROC of LDA", xlim=(-0.3, len(tables) - 0.7))
    fig.legend(loc="outside upper center", ncols=2)
    return fig


def online_update_figure(updates: pd.DataFrame) -> Figure:
    """What fine-tuning changes in each person's scores, against its number of events.

    `updates` is as `finetuning.online_update` returns it; titles tell the mean without events.
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.4), sharey=True)
    for ax, (column, words) in zip(axes, SCORES.items(), strict=True):
        scores = _by_subject(updates, "n_events", column)
        _subject_lines(scores - scores.loc[0], ax, "online", (-1, 1), marker="o", ms=4, ls="-")
        ax.axhline(0, **REFERENCE)
        ax.set_title(f"{words} ({scores.loc[0].mean():.2f} at N = 0)")
        ax.set(xlabel="Labelled events of the person, N", xticks=scores.index)
    axes[0].set_ylabel("Change from N = 0")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center")
    return fig


def latency_figure(tables: dict[str, pd.DataFrame]) -> Figure:
    """AUROC of LDA against when its window ends, by the filter (name -> `lda.across_subjects`)."""
    fig, axes = plt.subplots(1, len(tables), figsize=(PAGE_WIDTH, 2.3), sharey=True, squeeze=False)
    for ax, (name, table) in zip(axes[0], tables.items(), strict=True):
        lines = _by_subject(table, "window", "auroc")
        _subject_lines(lines, ax, "lda", marker="o", ms=4, ls="-")
        ax.axhline(0.5, label="Chance", **REFERENCE)
        ax.set(xlabel="End of the EEG used, after feedback (s)", title=name)
    axes[0, 0].set_ylabel("AUROC of whitened LDA")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


def _by_subject(table, row, score):
    """Arrange scores: a row a value of `row`, as they come, and a column a subject."""
    return table.pivot(index=row, columns="subject", values=score).loc[table[row].unique()]


def _subject_lines(
    lines: pd.DataFrame, ax: Axes, decoder: str, bounds: tuple = PROBABILITY, **look
) -> None:
    """Draw a thin line a subject, their mean and, where they are enough, its 95 % interval."""
    mean = lines.mean(axis=1)
    arms = np.abs(mean_interval(lines.T, bounds) - mean.to_numpy())
    ax.plot(lines, marker=".", ms=3, **BEHIND)
    look = {"ls": "", "elinewidth": 1, "capsize": 2, "zorder": 3, "color": COLORS[decoder]} | look
    words = "Mean over subjects, its 95 % interval"
    ax.errorbar(lines.index, mean, arms, label=words, **look)
