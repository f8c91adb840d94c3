"""Figures of the policies: Fig. 4, Fig. 6 and what the paper leaves out (success, safety).

Each function takes the table of `evaluations.load_runs`, draws, and returns axes or a figure.
"""

import matplotlib.pyplot as plt
import numpy as np

from rlihf_lib.report import paper
from rlihf_lib.report.evaluations import add_phase
from rlihf_lib.report.statistics import bootstrap_interval
from rlihf_lib.report.style import COLORS, COLUMN_WIDTH, LABELS, PAGE_WIDTH, note

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


def learning_curve(runs, ax, metric="return", **line):
    """Draw the mean over runs against training steps, with its 95 % bootstrap band.

    Parameters
    ----------
    runs : DataFrame
        Runs of one curve. A point is the mean over a run's rollouts; the band speaks about runs
        (resampled within subjects) and is absent where no subject has two.
    ax : matplotlib Axes
    metric : str
        Column of `runs`.
    **line
        Passed to `Axes.plot`.

    Returns
    -------
    matplotlib Axes
    """
    points = runs.groupby(["subject", "run", "step"])[metric].mean().unstack("step")
    steps = points.columns.to_numpy() / 1000
    ax.plot(steps, points.mean(axis=0), **line)
    low, high = bootstrap_interval(points.to_numpy(), points.index.get_level_values("subject"))
    ax.fill_between(steps, low, high, color=line.get("color"), alpha=0.18, linewidth=0)
    return ax


def condition_curve(runs, ax, condition, metric="return", **line):
    """Draw the curve of one condition in its colour and dashes; see `learning_curve`."""
    style = {"color": COLORS[condition], "linestyle": DASHES[condition], "label": LABELS[condition]}
    chosen = runs[runs["condition"] == condition]
    return learning_curve(chosen, ax, metric, **{**style, **line})


def mark_phases(ax, total_steps):
    """Draw faint lines between the phases Early, Mid and Late."""
    for third in (1, 2):
        ax.axvline(third * total_steps / 3000, color="#BBBBBB", linewidth=0.6, zorder=0)
    return ax


def figure_4(runs, subjects, total_steps, caption=""):
    """Fig. 4: evaluation return against training steps, a panel per subject.

    Parameters
    ----------
    runs : DataFrame
        Runs of the main comparison. The baselines know no subject and are the same in every panel.
    subjects : list of str
        Decoded subjects, a panel each; grey where the profile trains no policy.
    total_steps : int
        Environment steps of training.
    caption : str
        Written below.

    Returns
    -------
    matplotlib Figure
    """
    columns = min(4, len(subjects))
    rows = -(-len(subjects) // columns)
    fig, axes = plt.subplots(
        rows,
        columns,
        figsize=(PAGE_WIDTH, 0.5 + 1.35 * rows),
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    first = None
    for ax, subject in zip(axes.flat, subjects, strict=False):
        of_subject = runs[(runs["subject"] == "") | (runs["subject"] == subject)]
        ax.set_title(subject)
        mark_phases(ax, total_steps)
        if subject not in set(runs["subject"]):
            ax.set_facecolor("#F2F2F2")
            ax.text(
                0.5,
                0.5,
                "not run in\nthis profile",
                transform=ax.transAxes,
                ha="center",
                va="center",
                color="#767676",
                fontsize=7,
            )
            continue
        for condition in paper.CONDITIONS:
            condition_curve(of_subject, ax, condition)
        first = first or ax
    for ax in axes.flat[len(subjects) :]:
        ax.set_visible(False)
    fig.supylabel(AXIS_LABELS["return"], fontsize=8)
    handles, labels = first.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=3)
    for ax in axes[-1]:
        ax.set_xlabel("Steps (thousands)")
    note(fig, caption)
    return fig


def figure_6(runs, weights, total_steps, metric="return", ax=None):
    """Fig. 6: learning curves for several weights of human feedback, and the baselines.

    Parameters
    ----------
    runs : DataFrame
        Runs of the ablation and of both baselines.
    weights : sequence of float
    total_steps : int
    metric : str
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
    """
    ax = ax or plt.figure(figsize=(COLUMN_WIDTH, 2.4)).subplots()
    mark_phases(ax, total_steps)
    for condition in ("sparse", "dense"):
        condition_curve(runs, ax, condition, metric)
    markers = ("o", "s", "^", "D", "v")
    for weight, marker in zip(weights, markers, strict=False):
        chosen = runs[(runs["condition"] == "rlihf") & np.isclose(runs["w_hf"], weight)]
        learning_curve(
            chosen,
            ax,
            metric,
            color=COLORS[f"w{weight:g}"],
            marker=marker,
            markersize=3,
            label=f"RLIHF, $w_{{hf}}$ = {weight:g}",
        )
    ax.set(xlabel="Training steps (thousands)", ylabel=AXIS_LABELS[metric])
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
    for _, episodes in training.groupby("run"):
        axes[0].plot(
            episodes["step"] / 1000, episodes["return"], color=COLORS[condition], alpha=0.5, lw=0.8
        )
    axes[0].set_ylabel(f"Training return ({LABELS[condition]})")
    for ax, metric in zip(axes[1:], ("return", "success"), strict=True):
        condition_curve(runs, ax, condition, metric)
        ax.set_ylabel(AXIS_LABELS[metric])
    axes[2].set_ylim(-0.03, 1.03)
    for ax in axes:
        mark_phases(ax, total_steps)
        ax.set_xlabel("Training steps (thousands)")
    note(fig, caption)
    return fig


def success_figure(runs, total_steps, caption=""):
    """Success rate and path efficiency of the three conditions against training steps.

    Returns
    -------
    matplotlib Figure
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.1))
    for ax, metric in zip(axes, paper.METRICS, strict=True):
        mark_phases(ax, total_steps)
        for condition in paper.CONDITIONS:
            condition_curve(runs, ax, condition, metric)
        ax.set(ylabel=AXIS_LABELS[metric], xlabel="Training steps (thousands)")
        ax.set_ylim(bottom=0)
    axes[0].set_ylim(-0.03, 1.03)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    note(fig, caption)
    return fig


def safety_figure(runs, total_steps, caption=""):
    """Collisions and minimum clearance in the late phase: a dot per run, the mean, its interval.

    Returns
    -------
    matplotlib Figure
    """
    late = add_phase(runs, total_steps).query("phase == 'Late'")
    per_run = late.groupby(["condition", "subject", "run"])[["collisions", "min_clearance"]].mean()
    per_run["min_clearance"] *= 100  # m to cm
    fig, axes = plt.subplots(1, 2, figsize=(COLUMN_WIDTH, 1.9))
    rng = np.random.default_rng(0)
    for ax, metric in zip(axes, per_run.columns, strict=True):
        for position, condition in enumerate(paper.CONDITIONS):
            scores = per_run.loc[condition, metric].dropna()
            color = COLORS[condition]
            jitter = position + rng.uniform(-0.12, 0.12, len(scores))
            ax.plot(jitter, scores, "o", color=color, markersize=3, alpha=0.45)
            low, high = bootstrap_interval(scores, scores.index.get_level_values("subject"))
            ax.vlines(position + 0.25, low, high, color=color)
            ax.plot(position + 0.25, scores.mean(), "D", color=color, markersize=4)
        ax.set(ylabel=AXIS_LABELS[metric], xlim=(-0.5, 2.6))
        ax.set_xticks(range(3), [LABELS[c].removeprefix("RL ") for c in paper.CONDITIONS])
        ax.set_ylim(0, 1.1 * per_run[metric].max() or 1)
    note(fig, caption)
    return fig


def decoder_policy_figure(table, ax=None, caption=""):
    """Does a better decoder give a better policy? Late success against AUROC, a point a subject.

    Parameters
    ----------
    table : DataFrame
        From `tables.subject_table`.
    ax : matplotlib Axes, optional
    caption : str

    Returns
    -------
    matplotlib Axes
    """
    ax = ax or plt.figure(figsize=(COLUMN_WIDTH, 2.1)).subplots()
    ax.vlines(
        table["auroc"], table["success_ci_low"], table["success_ci_high"], color=COLORS["rlihf"]
    )
    ax.plot(table["auroc"], table["success"], "o", color=COLORS["rlihf"], label=LABELS["rlihf"])
    for row in table.itertuples():
        ax.annotate(row.subject, (row.auroc, row.success), (4, 4), textcoords="offset points")
    dense = (table["success"] - table["success_minus_dense"]).iloc[0]
    ax.axhline(dense, color=COLORS["dense"], linestyle=DASHES["dense"], label=LABELS["dense"])
    ax.set(xlabel="AUROC of the held-out subject", ylabel="Success rate, late phase")
    ax.set(ylim=(-0.05, 1.05))
    ax.legend(loc="best")
    note(ax.figure, caption)
    return ax
