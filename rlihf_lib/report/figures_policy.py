"""Figures of learning: Fig. 2, 4, and what the learner says of itself.

Most take the table of `evaluations.load_runs`. Lines are means over people and seeds, bands their
95 % intervals (`statistics`); where fewer than five people, or seeds of one, were drawn, the runs
themselves are shown.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, MaxNLocator

from rlihf_lib.report import paper, style
from rlihf_lib.report import statistics as st
from rlihf_lib.report.evaluations import RANGES, unit_means
from rlihf_lib.report.style import SHARE

AXIS_LABELS = {
    "return": "Evaluation return",
    "success": "Success rate",
    "path_efficiency": "Path efficiency",
    "path_deviation": "Path deviation (m)",
    "collisions": "Collisions per episode",
    "completed": "Share of the path completed",
    "clearance": "Clearance of placed cans (cm)",
    "critic_loss": "Critic loss",
    "ent_coef": r"Entropy coefficient $\alpha$",
    "mean_q": "Mean Q",
    "judged_wrong": "Share judged wrong",
    "alpha": "Entropy coefficient / $w_{hf}$",
    "error": r"$\sqrt{\mathrm{critic\ loss}}$ / $w_{hf}$",
}
LOGARITHMIC = ("critic_loss", "ent_coef", "alpha", "error")
STEPS = "Steps (thousands)"


def overview_figure(scene, waves, p_error, runs) -> Figure:
    """Fig. 2, the way from an error potential to a policy, drawn from this study's own data.

    Of a picture from `figures_task.scene`; error-minus-correct waves, uV, a column each person,
    with channel and time in s (the table `difference_waves` of notebook 01), drawn at Cz, or the
    first channel where there is none; `Study.p_error`; and the runs of the main comparison.
    """
    fig, axes = plt.subplots(1, 4, figsize=(style.PAGE_WIDTH, 2.1), width_ratios=[1.2, 1, 1, 1])
    robot, brain, decoder, policy = axes
    robot.axis("off")
    if scene is None:
        robot.text(0.5, 0.5, "no OpenGL library here", ha="center", fontsize=7)
    else:
        robot.imshow(scene)
    channel = "Cz" if "Cz" in set(waves["channel"]) else waves["channel"].iloc[0]
    people = waves[waves["channel"] == channel].drop(columns="channel").set_index("time")
    people.index *= 1000
    brain.plot(people, color="#BBBBBB", lw=0.5)
    brain.plot(people.mean(axis=1), color="black", lw=1.6)
    brain.axhline(0, color="#555555", lw=0.5)
    brain.set(xlabel="Time after the event (ms)", ylabel=f"Error − correct, {channel} (µV)")
    brain.set_xlim(0, people.index.max())
    for moment, epochs in zip(("correct", "error"), p_error.groupby("label"), strict=True):
        shade, look = style.COLORS[moment], {"bins": 20, "range": (0, 1), "density": True}
        look |= {"fc": to_rgba(shade, 0.25), "ec": shade, "histtype": "stepfilled"}
        decoder.hist(epochs[1]["p_error"], label=moment, **look)
    decoder.set(xlabel="p(error); reward r = 1 − p", ylabel="Density of epochs", xlim=(0, 1))
    decoder.legend(title="the robot was", loc="upper center", fontsize=7, title_fontsize=7)
    group_curves(runs, policy, paper.CONDITIONS, "success")
    policy.set(xlabel=STEPS, ylabel=AXIS_LABELS["success"], ylim=SHARE)
    policy.legend(fontsize=7, loc="lower right", bbox_to_anchor=(1.05, 0.04))
    titles = "A person watches  →", "the brain answers  →", "a decoder rewards  →"
    for ax, title in zip(axes, (*titles, "the robot learns  ↺"), strict=True):
        ax.set_title(title, fontweight="bold", loc="left")
    return fig


def learning_curve(runs: pd.DataFrame, ax: Axes, metric: str = "return", **line) -> None:
    """Draw one curve, of runs with the columns subject, run, step and `metric`.

    A point of a run is the mean over its rollouts; `line` is passed to `Axes.plot`.
    """
    points = runs.groupby(["subject", "run", "step"])[metric].mean().unstack("step")
    steps, means = points.columns.to_numpy() / 1000, unit_means(points)
    ax.plot(steps, means.mean(axis=0), **line)
    if len(means) < st.MIN_UNITS:
        ax.plot(steps, points.T, color=line.get("color"), alpha=0.45, linewidth=0.5)
    else:
        low, high = st.mean_interval(means, RANGES.get(metric, st.NO_BOUNDS))
        ax.fill_between(steps, low, high, color=line.get("color"), alpha=0.18, linewidth=0)


def group_curves(runs: pd.DataFrame, ax: Axes, groups, metric: str = "return") -> None:
    """Draw the `learning_curve` of each group in its colour and dashes."""
    for group in groups:
        chosen = runs[runs["group"] == group]
        learning_curve(chosen, ax, metric, **style.line_style(group), label=style.label(group))


def name_axes(ax: Axes, runs: pd.DataFrame, metric: str) -> None:
    """Name both axes of a curve; vertical lines part the thirds of training: Early, Mid, Late."""
    for third in (1, 2):
        ax.axvline(third * runs["step"].max() / 3000, color="#BBBBBB", linewidth=0.6, zorder=0)
    ax.set(xlabel="Training steps (thousands)", ylabel=AXIS_LABELS[metric])
    ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    if metric in ("success", "judged_wrong"):
        ax.set_ylim(SHARE)
    if metric in LOGARITHMIC and np.isfinite(ax.dataLim.ymax):  # once something is learnt
        ax.set_yscale("log", subs=())
        if ax.dataLim.ymax < 100 * ax.dataLim.minposy:  # decades alone would be few ticks
            ax.yaxis.set(major_locator=LogLocator(subs=(1, 2, 5)), major_formatter="{x:g}")


def figure_4(runs: pd.DataFrame, scores: pd.DataFrame) -> Figure:
    """Fig. 4: evaluation return against training steps, a panel per person and their mean.

    The baselines know no person and are the same in every panel. People are in the order of the
    data set, that of `Study.scores`, which gives the AUROC of their decoders.
    """
    people = scores[scores["subject"].isin(runs["subject"])]
    panels = {
        f"{row.subject}, AUROC {row.auroc:.2f}": runs[runs["subject"].isin(["", row.subject])]
        for row in people.itertuples()
    }
    panels["mean over people"] = runs
    n = len(panels)
    columns = min(n, 5 if n > 8 else 4)
    rows = -(-n // columns)
    page = style.PAGE_WIDTH, 0.8 + 1.25 * rows
    fig, axes = plt.subplots(rows, columns, figsize=page, sharex=True, sharey=True, squeeze=False)
    for ax, (title, chosen) in zip(axes.flat, panels.items(), strict=False):
        group_curves(chosen, ax, paper.CONDITIONS)
        ax.set_title(title, fontsize=7.5, fontweight="bold" if chosen is runs else None)
    for i, ax in enumerate(axes.flat):
        name_axes(ax, runs, "return")
        # The last panel of a column has numbers; named, they would part the rows.
        ax.set(xlabel=STEPS if i >= columns * (rows - 1) else "", ylabel="", visible=i < n)
        ax.tick_params(labelbottom=i >= n - columns)
    fig.supylabel(AXIS_LABELS["return"], fontsize=8)
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


def training_figure(runs: pd.DataFrame, training: pd.DataFrame, condition: str, horizon) -> Figure:
    """How one condition learns: its own reward while training, a run a line; the evaluation.

    `training` is from `evaluations.load_training`, as `runs` of this condition. The evaluation has
    the same axes for every condition: 1 is the most a step of the `horizon` can earn.
    """
    fig, axes = plt.subplots(1, 3, figsize=(style.PAGE_WIDTH, 2.0))
    shade = style.color(condition)
    earned = training.dropna(subset="return")
    for _, run in earned.groupby("run"):
        axes[0].plot(run["step"] / 1000, run["return"], color=shade, lw=0.5, alpha=0.3)
    mean = earned.groupby("step")["return"].mean()
    outline = [withStroke(linewidth=3, foreground="white")]  # seen among many runs
    axes[0].plot(mean.index / 1000, mean, color=shade, lw=1.6, path_effects=outline)
    name_axes(axes[0], runs, "return")
    axes[0].set_ylabel(f"Training return,\nreward of {style.label(condition)}")
    for ax, metric in zip(axes[1:], ("return", "success"), strict=True):
        group_curves(runs, ax, style.ordered(runs["group"]), metric)
        name_axes(ax, runs, metric)
    axes[1].set_ylim(min(horizon * SHARE[0], axes[1].dataLim.ymin), horizon * SHARE[1])
    return fig


def learner_figure(training: pd.DataFrame, condition: str) -> Figure:
    """What the learner says of itself during one run, in windows of steps.

    Critic loss, entropy coefficient, mean Q and, where somebody watched, the share of steps that
    looked wrong to the observer; from `evaluations.load_training`.
    """
    columns = ["critic_loss", "ent_coef", "mean_q", *["judged_wrong"] * (condition == "rlihf")]
    fig, axes = plt.subplots(1, len(columns), figsize=(style.PAGE_WIDTH, 1.9))
    thousands, shade = training["step"] / 1000, style.color(condition)
    marker = "." if len(training) < 10 else None  # a single window makes no line
    for ax, column in zip(axes, columns, strict=True):
        ax.plot(thousands, training[column], color=shade, lw=0.9, marker=marker)
        name_axes(ax, training, column)
        ax.set(xlabel=STEPS, xlim=(0, None))
    return fig


def success_figure(runs: pd.DataFrame) -> Figure:
    """Success rate, path efficiency and deviation of the paper's conditions while they train."""
    fig, axes = plt.subplots(1, 3, figsize=(style.PAGE_WIDTH, 2.1))
    for ax, metric in zip(axes, paper.METRICS, strict=True):
        group_curves(runs, ax, paper.CONDITIONS, metric)
        ax.set_ylim(bottom=0)
        name_axes(ax, runs, metric)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return fig
