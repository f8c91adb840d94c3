"""Figures of learning: Fig. 4, Fig. 6, and what the learner says of itself.

Each function takes the table of `evaluations.load_runs`, draws, and returns the figure. Lines are
means over runs, bands 95 % intervals (`statistics`). Where fewer than five people, or seeds of one,
were drawn, the runs themselves are shown instead. Vertical lines part Early, Mid and Late.
"""

import matplotlib.pyplot as plt
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rlihf_lib.report import paper
from rlihf_lib.report.evaluations import RANGES, unit_means
from rlihf_lib.report.statistics import MIN_UNITS, mean_interval
from rlihf_lib.report.style import COLUMN_WIDTH, PAGE_WIDTH, color, label, line_style, shades

AXIS_LABELS = {
    "return": "Evaluation return",
    "success": "Success rate",
    "path_efficiency": "Path efficiency",
    "path_deviation": "Path deviation (m)",
    "collisions": "Collisions per episode",
    "min_clearance": "Minimum clearance (cm)",
}
#: Limits of an axis of shares, with room for lines at 0 and 1.
SHARE = (-0.03, 1.03)
MARKERS = "os^Dv"
FEW_WINDOWS = 10  # fewer are marked: a single one makes no line


def learning_curve(runs: pd.DataFrame, ax: Axes, metric: str = "return", **line) -> None:
    """Draw one curve, of runs with the columns subject, run, step and `metric`.

    A point of a run is the mean over its rollouts; `line` is passed to `Axes.plot`.
    """
    points = runs.groupby(["subject", "run", "step"])[metric].mean().unstack("step")
    steps, means = points.columns.to_numpy() / 1000, unit_means(points)
    ax.plot(steps, means.mean(axis=0), **line)
    if len(means) < MIN_UNITS:
        ax.plot(steps, points.T, color=line.get("color"), alpha=0.45, linewidth=0.5)
    else:
        low, high = mean_interval(means, RANGES[metric])
        ax.fill_between(steps, low, high, color=line.get("color"), alpha=0.18, linewidth=0)


def group_curves(runs: pd.DataFrame, ax: Axes, groups, metric: str = "return") -> None:
    """Draw the `learning_curve` of each group in its colour and dashes."""
    for group in groups:
        chosen = runs[runs["group"] == group]
        learning_curve(chosen, ax, metric, **line_style(group), label=label(group))


def mark_phases(ax: Axes, total_steps: float) -> None:
    """Part the thirds of training, Early, Mid and Late, and name the axis of steps."""
    for third in (1, 2):
        ax.axvline(third * total_steps / 3000, color="#BBBBBB", linewidth=0.6, zorder=0)
    ax.set_xlabel("Training steps (thousands)")


def figure_4(runs: pd.DataFrame, scores: pd.DataFrame) -> Figure:
    """Fig. 4: evaluation return against training steps, a panel per person and their mean.

    The baselines know no person and are the same in every panel. People are sorted by the AUROC of
    their decoder, from `Study.scores`.
    """
    people = scores[scores["subject"].isin(runs["subject"])]
    people = people.sort_values("auroc", ascending=False)
    titles = {row.subject: f"{row.subject}, AUROC {row.auroc:.2f}" for row in people.itertuples()}
    n = len(titles) + 1
    columns = min(n, 5 if n > 8 else 4)
    rows = -(-n // columns)
    fig, axes = plt.subplots(
        rows, columns, figsize=(PAGE_WIDTH, 0.8 + 1.25 * rows), sharex=True, sharey=True,
        squeeze=False,
    )  # fmt: skip
    for ax, (person, title) in zip(axes.flat, titles.items(), strict=False):
        group_curves(runs[runs["subject"].isin(["", person])], ax, paper.CONDITIONS)
        ax.set_title(title, fontsize=7.5)
    mean = axes.flat[n - 1]
    group_curves(runs, mean, paper.CONDITIONS)
    mean.set_title("mean over people", fontsize=7.5, fontweight="bold")
    for i, ax in enumerate(axes.flat):
        mark_phases(ax, runs["step"].max())
        ax.set(xlabel="Steps (thousands)" if ax in axes[-1] else "", visible=i < n)
        ax.tick_params(labelbottom=i >= n - columns)
    fig.supylabel(AXIS_LABELS["return"], fontsize=8)
    handles, labels = mean.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=3)
    return fig


def figure_6(runs: pd.DataFrame, metric: str = "return") -> Figure:
    """Fig. 6: learning curves for several weights of human feedback, and the baselines.

    Any number of weights; darker is heavier.
    """
    fig, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.9))
    group_curves(runs, ax, ("sparse", "dense"), metric)
    weights = dict(list(runs[runs["group"] == "rlihf"].groupby("w_hf")))
    looks = zip(weights.items(), shades(len(weights)), strict=True)
    for i, ((weight, chosen), shade) in enumerate(looks):
        learning_curve(
            chosen, ax, metric, color=shade, marker=MARKERS[i % len(MARKERS)], markersize=3,
            label=f"RLIHF, $w_{{hf}}$ = {weight:g}",
        )  # fmt: skip
    mark_phases(ax, runs["step"].max())
    ax.set(ylabel=AXIS_LABELS[metric], ylim=SHARE if metric == "success" else None)
    fig.legend(loc="outside upper center", ncols=2)
    return fig


def training_figure(runs: pd.DataFrame, training: pd.DataFrame, condition: str) -> Figure:
    """How one condition learns: its own reward while training, a line per run; then the evaluation.

    `training` is from `evaluations.load_training`, as `runs` of this condition.
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.0))
    windows = training.dropna(subset="return").assign(thousands=lambda t: t["step"] / 1000)
    sns.lineplot(
        windows, x="thousands", y="return", units="run", estimator=None, ax=axes[0],
        color=color(condition), alpha=0.5, lw=0.8,
    )  # fmt: skip
    axes[0].set_ylabel(f"Training return ({label(condition)})")
    for ax, metric in zip(axes[1:], ("return", "success"), strict=True):
        group_curves(runs, ax, [condition], metric)
        ax.set_ylabel(AXIS_LABELS[metric])
    axes[2].set_ylim(SHARE)
    for ax in axes:
        mark_phases(ax, runs["step"].max())
    return fig


def learner_figure(training: pd.DataFrame, condition: str) -> Figure:
    """What the learner says of itself during one run, in windows of steps.

    Critic loss, entropy coefficient, mean Q and, where somebody watched, the share of steps that
    looked wrong to the observer; from `evaluations.load_training`.
    """
    panels = {
        "critic_loss": "Critic loss",
        "ent_coef": r"Entropy coefficient $\alpha$",
        "mean_q": "Mean Q",
        "judged_wrong": "Share judged wrong",
    }
    if condition != "rlihf":
        del panels["judged_wrong"]
    fig, axes = plt.subplots(1, len(panels), figsize=(PAGE_WIDTH, 1.9))
    marker = "." if len(training) < FEW_WINDOWS else None
    for ax, (column, words) in zip(axes, panels.items(), strict=True):
        values = training[column]
        ax.plot(training["step"] / 1000, values, color=color(condition), lw=0.9, marker=marker)
        mark_phases(ax, training["step"].max())
        ax.set(xlabel="Steps (thousands)", ylabel=words)
        if column == "judged_wrong":
            ax.set_ylim(SHARE)
        elif column != "mean_q" and values.notna().any():  # nothing is learnt in the first steps
            ax.set_yscale("log")
    return fig


def success_figure(runs: pd.DataFrame) -> Figure:
    """Success rate, path efficiency and deviation of the paper's conditions while they train."""
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.1))
    for ax, metric in zip(axes, paper.METRICS, strict=True):
        group_curves(runs, ax, paper.CONDITIONS, metric)
        mark_phases(ax, runs["step"].max())
        ax.set_ylabel(AXIS_LABELS[metric])
        ax.set_ylim(bottom=0)
    axes[0].set_ylim(SHARE)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return fig
