"""Figures of what policies do late in training: safety, comparisons, what decides.

Each function takes the table of `evaluations.load_runs`, draws, and returns the figure. Dots are
runs, diamonds means over people and seeds, bars their 95 % intervals (`statistics`), where at least
five people, or seeds of one, were drawn.
"""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rlihf_lib.report import paper
from rlihf_lib.report.evaluations import RANGES, late_scores, size, unit_means
from rlihf_lib.report.figures_policy import AXIS_LABELS, SHARE
from rlihf_lib.report.statistics import EQUIVALENCE_MARGIN, PROBABILITY, mean_interval, spearman
from rlihf_lib.report.style import (
    COLUMN_WIDTH,
    PAGE_WIDTH,
    REFERENCE,
    color,
    label,
    line_style,
    ordered,
    shades,
)

CONTROL_STEP = 0.1  # s
RUNS: dict[str, Any] = {"ls": "", "marker": "o", "ms": 3, "mew": 0, "alpha": 0.4}
THRESHOLDS = np.linspace(0, 1, 101)  # of a performance profile


def safety_figure(runs: pd.DataFrame) -> Figure:
    """Collisions and minimum clearance in the late phase."""
    late = late_scores(runs).assign(min_clearance=lambda table: 100 * table["min_clearance"])
    fig, axes = plt.subplots(1, 2, figsize=(COLUMN_WIDTH, 2.1))
    rng = np.random.default_rng(0)
    for ax, metric in zip(axes, ("collisions", "min_clearance"), strict=True):
        for x, group in enumerate(paper.CONDITIONS):
            shade = color(group)
            scores = late[late["group"] == group].set_index("subject")[metric].dropna()
            ax.plot(x + rng.uniform(-0.12, 0.12, len(scores)), scores, color=shade, **RUNS)
            means = unit_means(scores)
            ax.vlines(x + 0.25, *mean_interval(means, RANGES[metric]), color=shade)
            ax.plot(x + 0.25, means.mean(), "D", color=shade, ms=4)
        ax.set(ylabel=AXIS_LABELS[metric], xlim=(-0.5, 2.6))
        ax.set_xticks(range(3), [label(group).removeprefix("RL ") for group in paper.CONDITIONS])
        ax.set_ylim(0, 1.1 * late[metric].max() or 1)
    return fig


def trade_off_figure(runs: pd.DataFrame) -> Figure:
    """Time taken against clearance kept, over the late rollouts that place the can (cf. Fig. 1).

    Of dense reward and of RLIHF at any weights; `runs` has the column steps.
    """
    late = runs.query("phase == 'Late' and success == 1")
    late = late.assign(seconds=CONTROL_STEP * late["steps"], cm=100 * late["min_clearance"])
    weights = sorted(late.loc[late["group"] == "rlihf", "w_hf"].unique())
    looks = {("dense", 0.0): (label("dense"), color("dense"))}
    for weight, shade in zip(weights, shades(len(weights)), strict=True):
        looks["rlihf", weight] = (f"{label('rlihf')}, $w_{{hf}}$ = {weight:g}", shade)
    fig, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.6))
    placed = late.groupby(["group", "w_hf", "subject", "run"])[["seconds", "cm"]].mean()
    for of, (name, shade) in looks.items():
        if of in placed.index:
            scores = placed.loc[of]
            means = unit_means(scores)
            (x, y), intervals = means.mean(), mean_interval(means)
            arms = np.abs(intervals - [[x, y]])
            ax.plot(*scores.to_numpy().T, color=shade, **RUNS)
            ax.errorbar(x, y, arms[:, 1:], arms[:, :1], fmt="D", ms=4, color=shade, label=name)
    if not len(late):
        ax.text(0.5, 0.5, "no run places the can", transform=ax.transAxes, ha="center")
    ax.set(xlabel="Time to place the can (s)", ylabel=AXIS_LABELS["min_clearance"])
    ax.set_ylim(bottom=0)
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


def comparison_figure(runs: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """Performance profiles of late success, and how likely a run of RLIHF beats one of another.

    A profile is the share of runs with a score above each threshold (Agarwal et al. 2021), of every
    group in `runs`; `table` is from `tables.comparison_table`.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.4), width_ratios=[1.2, 1])
    late = late_scores(runs)
    for group in ordered(late["group"]):
        chosen = late[late["group"] == group].set_index("subject")
        above = pd.DataFrame(chosen[["success"]].to_numpy() > THRESHOLDS, chosen.index, dtype=float)
        shares = unit_means(above)
        name = f"{label(group)} ({size(chosen.reset_index())})"
        left.step(THRESHOLDS, shares.mean(), where="post", label=name, **line_style(group))
        low, high = mean_interval(shares, PROBABILITY)
        left.fill_between(THRESHOLDS, low, high, step="post", color=color(group), alpha=0.18, lw=0)
    left.set(xlabel=r"Late success rate $\tau$", ylabel=r"Share of runs above $\tau$")
    left.set(xlim=(-0.02, 1.02), ylim=SHARE)
    fig.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    rows = table[table["metric"] == "success"][::-1]
    places, shade = range(len(rows)), color("rlihf")
    right.hlines(places, rows["improvement_low"], rows["improvement_high"], color=shade)
    right.plot(rows["improvement"], places, "D", ms=4, color=shade)
    right.axvline(0.5, **REFERENCE)
    right.set_yticks(places, rows["comparison"].str.replace(" - ", " > "))
    right.set(xlim=SHARE, ylim=(-0.6, len(rows) - 0.4), xlabel="P(improvement) in late success")
    return fig


def decoder_policy_figure(runs: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """Does a better decoder give a better policy? Late success against AUROC, a point a person.

    `table` is from `tables.subject_table`. People are named whose policies stay behind dense reward
    by more than `statistics.EQUIVALENCE_MARGIN`. The title holds Spearman's correlation.
    """
    fig, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.5))
    shade = color("rlihf")
    late = late_scores(runs).query("group == 'rlihf'").merge(table[["subject", "auroc"]])
    ax.plot(late["auroc"], late["success"], color=shade, **RUNS)
    ax.vlines(table["auroc"], table["success_low"], table["success_high"], color=shade)
    ax.plot(table["auroc"], table["success"], "D", color=shade, ms=4, label=label("rlihf"))
    for row in table[table["success"] < table["dense"] - EQUIVALENCE_MARGIN].itertuples():
        ax.annotate(
            row.subject, (row.auroc, row.success), (4, 4), textcoords="offset points", fontsize=7
        )
    ax.axhline(table["dense"].iloc[0], **line_style("dense"), label=label("dense"))
    r = spearman(table["auroc"], table["success"])
    spread = "no interval" if np.isnan(r["ci_low"]) else f"[{r['ci_low']:.2f}, {r['ci_high']:.2f}]"
    ax.set_title(
        rf"Spearman's $\rho$ = {r['rho']:.2f}, {spread}, n = {r['n']}"
        f"\np = {r['p']:.2g} (smallest possible: {r['smallest_p']:.2g})"
    )
    ax.set(xlabel="AUROC of the held-out person", ylabel="Success rate, late phase")
    ax.set(ylim=(-0.05, 1.05))
    ax.legend(loc="best")
    return fig
