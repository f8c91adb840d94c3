"""Figures of the weight of human feedback: Fig. 6, and what a weight does to learner and robot.

Weights are shades of RLIHF's colour, heavier is darker, each with a marker of its own.
"""

from collections.abc import Iterator
from itertools import combinations, cycle

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rlihf_lib.report import statistics as st
from rlihf_lib.report import style
from rlihf_lib.report.evaluations import phase_scores, unit_means
from rlihf_lib.report.figures_late import CONTROL_STEP, RUNS, mean_and_interval
from rlihf_lib.report.figures_policy import AXIS_LABELS, group_curves, learning_curve, name_axes
from rlihf_lib.rl.observer import AT_EASE_CLEARANCE, UNEASY_CLEARANCE

EACH = {"ls": "", "ms": 3, "mfc": "none", "mew": 0.7, "alpha": 0.8, "label": ""}  # run or person


def by_weight(rows: pd.DataFrame) -> Iterator[tuple[pd.DataFrame, dict]]:
    """Part rows by the weight of human feedback, each with its name, shade and marker."""
    weights = dict(list(rows.groupby("w_hf")))
    shades = style.shades(weights)
    for (w, chosen), marker in zip(weights.items(), cycle("s^vPX"), strict=False):
        yield chosen, {"color": shades[w], "marker": marker, "label": rf"RLIHF, $w_{{hf}}$ = {w:g}"}


def figure_6(runs: pd.DataFrame) -> Figure:
    """Fig. 6: return and success for any weights of human feedback, and the baselines.

    Bands lie side by side though people are the same; so the third panel has their differences.
    """
    fig, axes = plt.subplots(1, 3, figsize=(style.PAGE_WIDTH, 2.6), width_ratios=[1, 1, 0.8])
    for ax, metric in zip(axes, ("return", "success"), strict=False):
        group_curves(runs, ax, ("sparse", "dense"), metric)
        for chosen, look in by_weight(runs[runs["group"] == "rlihf"]):
            learning_curve(chosen, ax, metric, markersize=3.5, **look)
        name_axes(ax, runs, metric)
    _paired(runs[runs["group"] == "rlihf"], axes[2])
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return fig


def _paired(runs: pd.DataFrame, ax: Axes) -> None:
    """Draw the late return at each weight less that at a lower one: a dot a person, and the mean.

    Of one person, a dot for each pair of their runs' means.
    """
    returns = phase_scores(runs).pivot_table("return", "subject", "w_hf")
    shades, pairs = style.shades(returns), list(combinations(returns, 2))
    for x, (low, high) in enumerate(pairs):
        differences = (returns[high] - returns[low]).dropna()
        ax.plot([x] * len(differences), differences, color=shades[high], **RUNS)
        mean_and_interval(differences, ax, x + 0.25, "difference", shades[high])
    ax.axhline(0, **style.REFERENCE)
    ax.set_xticks(range(len(pairs)), [f"{high:g}\n− {low:g}" for low, high in pairs])
    ax.set(xlim=(-0.5, len(pairs) - 0.2), ylabel="Late return, difference")
    ax.set_xlabel(r"Larger − smaller $w_{hf}$")


def weights_figure(training: pd.DataFrame) -> Figure:
    """What the critics have to learn beside human feedback, by its weight.

    The entropy coefficient, and the root of the critic loss (the size of their errors), both in
    units of the weight, that is of what a step can earn by feedback: of the runs of
    `evaluations.load_training`, in windows of ten times 1,000 steps.
    """
    own = training[training["w_hf"] > 0]
    own = own.assign(
        step=own["step"].sub(1) // 10_000 * 10_000 + 5_000,
        alpha=own["ent_coef"] / own["w_hf"],
        error=np.sqrt(own["critic_loss"]) / own["w_hf"],
    )
    fig, axes = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH, 2.3))
    for ax, column in zip(axes, ("alpha", "error"), strict=True):
        for chosen, look in by_weight(own):
            learning_curve(chosen, ax, column, markersize=3.5, **look)
        name_axes(ax, training, column)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return fig


def trade_off_figure(runs: pd.DataFrame) -> Figure:
    """Time taken against clearance kept, over the late rollouts that place the can (cf. Fig. 1).

    Of dense reward, a small mark a run, and of RLIHF at any weights, a small mark a person; n runs
    place the can. Large marks are means: of RLIHF over the people who place it at every weight.
    `runs` has the column steps. Lines: where people are at ease above, and the robot too close
    below.
    """
    late = runs.query("phase == 'Late' and success == 1")
    late = late.assign(seconds=CONTROL_STEP * late["steps"], cm=100 * late["min_clearance"])
    fig, ax = plt.subplots(figsize=(style.COLUMN_WIDTH, 3.3))
    placed = late.groupby(["group", "w_hf", "subject", "run"])[["seconds", "cm"]].mean()
    dense = {"label": style.label("dense"), "color": style.color("dense"), "marker": "D"}
    ours = placed.query("group == 'rlihf'")
    at_each = ours.groupby(["w_hf", "subject"]).size().unstack("w_hf").dropna().index
    for scores, look in [(placed.query("group == 'dense'"), dense), *by_weight(ours)]:
        if len(scores):
            ax.plot(*unit_means(scores).to_numpy().T, **look | EACH)
            compared = unit_means(scores[scores.index.isin(["", *at_each], level="subject")])
            (x, y), intervals = compared.mean(), st.mean_interval(compared)
            arms = np.abs(intervals - [[x, y]])
            words = f"{look['label']} (n = {len(scores)})"
            look |= {"label": words, "mec": "black", "mew": 0.5, "ms": 5, "elinewidth": 1.2}
            ax.errorbar(x, y, arms[:, 1:], arms[:, :1], ls="", **look)
    if not len(late):
        ax.text(0.5, 0.5, "no run places the can", transform=ax.transAxes, ha="center")
    for metres, words, side in (
        (UNEASY_CLEARANCE, "too close ", "top"), (AT_EASE_CLEARANCE, "at ease ", "bottom"),
    ):  # fmt: skip
        ax.axhline(100 * metres, **style.REFERENCE)
        across = ax.get_yaxis_transform()
        ax.text(1, 100 * metres, words, transform=across, ha="right", va=side, size=style.SMALL)
    ax.set(xlabel="Time to place the can (s)", ylabel=AXIS_LABELS["clearance"])
    ax.set_ylim(bottom=0)
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig
