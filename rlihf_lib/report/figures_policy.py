"""Figures of learning: Fig. 4, Fig. 6, and what the learner says of itself.

Each function takes the table of `evaluations.load_runs`, draws, and returns axes or a figure. Lines
are means over runs, bands 95 % intervals (`statistics`). Where fewer than five people, or seeds of
one, were drawn, the runs themselves are shown instead.
"""

from itertools import cycle

import matplotlib.pyplot as plt
import numpy as np

from rlihf_lib.report import paper
from rlihf_lib.report.evaluations import RANGES, UNBOUNDED, unit_means
from rlihf_lib.report.statistics import MIN_UNITS, mean_interval
from rlihf_lib.report.style import COLUMN_WIDTH, PAGE_WIDTH, color, label, note, shades

# Told apart in black and white too.
DASHES = {"sparse": (0, (1, 1)), "dense": (0, (4, 1.5)), "rlihf": "solid"}
AXIS_LABELS = {
    "return": "Evaluation return",
    "success": "Success rate",
    "path_efficiency": "Path efficiency",
    "path_deviation": "Path deviation (m)",
    "collisions": "Collisions per episode",
    "min_clearance": "Minimum clearance (cm)",
}
THOUSANDS = "Training steps (thousands)"


def learning_curve(runs, ax, metric="return", **line):
    """Draw the mean over runs against training steps, with its 95 % band or with the runs.

    Parameters
    ----------
    runs : DataFrame
        Runs of one curve, with the columns subject, run, step and `metric`. A point is the mean
        over a run's rollouts.
    ax : matplotlib Axes
    metric : str
    **line
        Passed to `Axes.plot`.

    Returns
    -------
    matplotlib Axes
    """
    points = runs.groupby(["subject", "run", "step"])[metric].mean().unstack("step")
    steps, means = points.columns.to_numpy() / 1000, unit_means(points)
    ax.plot(steps, means.mean(axis=0), **line)
    if len(means) < MIN_UNITS:
        ax.plot(steps, points.T, color=line.get("color"), alpha=0.45, linewidth=0.5)
    else:
        low, high = mean_interval(means, RANGES.get(metric, UNBOUNDED))
        ax.fill_between(steps, low, high, color=line.get("color"), alpha=0.18, linewidth=0)
    return ax


def group_curve(runs, ax, group, metric="return", **line):
    """Draw the curve of one group in its colour and dashes; see `learning_curve`."""
    line = {**line_style(group), "label": label(group), **line}
    return learning_curve(runs[runs["group"] == group], ax, metric, **line)


def line_style(group):
    """Colour and dashes of a group's lines."""
    return {"color": color(group), "linestyle": DASHES[group.split("-")[0]]}


def mark_phases(ax, total_steps):
    """Draw faint lines between the phases Early, Mid and Late."""
    for third in (1, 2):
        ax.axvline(third * total_steps / 3000, color="#BBBBBB", linewidth=0.6, zorder=0)
    return ax


def figure_4(runs, scores, total_steps, caption=""):
    """Fig. 4: evaluation return against training steps, a panel per person and their mean.

    Parameters
    ----------
    runs : DataFrame
        Runs of the main comparison. The baselines know no person and are the same in every panel.
    scores : DataFrame
        From `Study.scores`; people are sorted by the AUROC of their decoder, told in the title.
    total_steps : int
        Environment steps of training.
    caption : str
        Written below.

    Returns
    -------
    matplotlib Figure
    """
    people = scores[scores["subject"].isin(runs["subject"])]
    people = people.sort_values("auroc", ascending=False)
    titles = {row.subject: f"{row.subject}, AUROC {row.auroc:.2f}" for row in people.itertuples()}
    n = len(titles) + 1
    columns = min(n, 5 if n > 8 else 4)
    rows = -(-n // columns)
    fig, axes = plt.subplots(
        rows, columns, figsize=(PAGE_WIDTH, 0.6 + 1.25 * rows), sharex=True, sharey=True,
        squeeze=False,
    )  # fmt: skip
    panels = [*titles.items(), (None, "mean over people")]
    for ax, (person, title) in zip(axes.flat, panels, strict=False):
        shown = runs if person is None else runs[runs["subject"].isin(["", person])]
        ax.set_title(title, fontsize=7.5, fontweight="bold" if person is None else None)
        mark_phases(ax, total_steps)
        for group in paper.CONDITIONS:
            group_curve(shown, ax, group)
    for ax in axes.flat[n:]:
        ax.set_visible(False)
    for ax in axes.flat[max(n - columns, 0) : n]:
        ax.tick_params(labelbottom=True)
    for ax in axes[-1]:
        ax.set_xlabel("Steps (thousands)")
    fig.supylabel(AXIS_LABELS["return"], fontsize=8)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=3)
    note(fig, caption)
    return fig


def figure_6(runs, weights, total_steps, metric="return", ax=None):
    """Fig. 6: learning curves for several weights of human feedback, and the baselines.

    Parameters
    ----------
    runs : DataFrame
        Runs of the ablation and of both baselines.
    weights : sequence of float
        Any number; darker is heavier.
    total_steps : int
    metric : str
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
    """
    ax = ax or plt.figure(figsize=(COLUMN_WIDTH, 2.6)).subplots()
    mark_phases(ax, total_steps)
    for group in ("sparse", "dense"):
        group_curve(runs, ax, group, metric)
    rlihf = runs[runs["group"] == "rlihf"]
    for weight, shade, marker in zip(
        sorted(weights), shades(len(weights)), cycle("os^Dv"), strict=False
    ):
        learning_curve(
            rlihf[np.isclose(rlihf["w_hf"], weight)], ax, metric, color=shade, marker=marker,
            markersize=3, label=f"RLIHF, $w_{{hf}}$ = {weight:g}",
        )  # fmt: skip
    ax.set(xlabel=THOUSANDS, ylabel=AXIS_LABELS[metric])
    return ax


def training_figure(runs, training, condition, total_steps, caption=""):
    """How one condition learns: its own reward while training, then the evaluation.

    Parameters
    ----------
    runs, training : DataFrame
        From `evaluations.load_runs` and `evaluations.load_training`, of this condition.
    condition : {"sparse", "dense", "rlihf"}
    total_steps : int
    caption : str

    Returns
    -------
    matplotlib Figure
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.0))
    for _, windows in training.dropna(subset="return").groupby("run"):
        axes[0].plot(
            windows["step"] / 1000, windows["return"], color=color(condition), alpha=0.5, lw=0.8
        )
    axes[0].set_ylabel(f"Training return ({label(condition)})")
    for ax, metric in zip(axes[1:], ("return", "success"), strict=True):
        group_curve(runs, ax, condition, metric)
        ax.set_ylabel(AXIS_LABELS[metric])
    axes[2].set_ylim(-0.03, 1.03)
    for ax in axes:
        mark_phases(ax, total_steps)
        ax.set_xlabel(THOUSANDS)
    note(fig, caption)
    return fig


def learner_figure(training, condition, total_steps, caption=""):
    """What the learner says of itself during one run, in windows of steps.

    Parameters
    ----------
    training : DataFrame
        From `evaluations.load_training`, of one run: critic loss, entropy coefficient, mean Q and
        the share of steps that looked wrong to the observer.
    condition : {"sparse", "dense", "rlihf"}
    total_steps : int
    caption : str

    Returns
    -------
    matplotlib Figure
        The share judged wrong is drawn where somebody watched.
    """
    panels = {
        "critic_loss": "Critic loss",
        "ent_coef": r"Entropy coefficient $\alpha$",
        "mean_q": "Mean Q",
        "judged_wrong": "Steps judged wrong (share)",
    }
    if condition != "rlihf":
        del panels["judged_wrong"]
    fig, axes = plt.subplots(1, len(panels), figsize=(PAGE_WIDTH, 1.9))
    # A single window makes no line.
    line = {"color": color(condition), "lw": 0.9, "marker": "." if len(training) < 10 else None}
    for ax, (column, words) in zip(axes, panels.items(), strict=True):
        ax.plot(training["step"] / 1000, training[column], **line)
        mark_phases(ax, total_steps)
        ax.set(xlabel="Steps (thousands)", ylabel=words)
    for ax, column in zip(axes[:2], panels, strict=False):
        if training[column].notna().any():  # nothing is learnt in the first steps
            ax.set_yscale("log")
    if condition == "rlihf":
        axes[-1].set_ylim(-0.03, 1.03)
    note(fig, caption)
    return fig


def success_figure(runs, total_steps, caption="", groups=paper.CONDITIONS):
    """Success rate, path efficiency and deviation of several groups against training steps.

    Returns
    -------
    matplotlib Figure
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.1))
    for ax, metric in zip(axes, paper.METRICS, strict=True):
        mark_phases(ax, total_steps)
        for group in groups:
            group_curve(runs, ax, group, metric)
        ax.set(ylabel=AXIS_LABELS[metric], xlabel=THOUSANDS)
        ax.set_ylim(bottom=0)
    axes[0].set_ylim(-0.03, 1.03)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    note(fig, caption)
    return fig
