"""Figures of what policies do late in training: safety, comparisons, what decides.

Each function takes the table of `evaluations.load_runs`, draws, and returns a figure. Dots are
runs, diamonds means over people and seeds, bars their 95 % intervals (`statistics`), where at least
five people, or seeds of one, were drawn.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from rlihf_lib.report import paper
from rlihf_lib.report.evaluations import (
    RANGES,
    UNBOUNDED,
    add_phase,
    late_scores,
    size,
    unit_means,
)
from rlihf_lib.report.figures_policy import AXIS_LABELS, line_style
from rlihf_lib.report.statistics import EQUIVALENCE_MARGIN, mean_interval, spearman
from rlihf_lib.report.style import COLUMN_WIDTH, PAGE_WIDTH, color, label, note, ordered, shades

CONTROL_STEP = 0.1  # s


def safety_figure(runs, total_steps, caption=""):
    """Collisions and minimum clearance in the late phase: a dot per run, the mean, its interval.

    Returns
    -------
    matplotlib Figure
    """
    late = late_scores(runs, total_steps).set_index(["group", "subject"])
    late["min_clearance"] *= 100  # m to cm
    fig, axes = plt.subplots(1, 2, figsize=(COLUMN_WIDTH, 1.9))
    rng = np.random.default_rng(0)
    for ax, metric in zip(axes, ("collisions", "min_clearance"), strict=True):
        for position, group in enumerate(paper.CONDITIONS):
            scores, style = late.loc[group, metric].dropna(), {"color": color(group)}
            jitter = position + rng.uniform(-0.12, 0.12, len(scores))
            ax.plot(jitter, scores, "o", **style, markersize=3, alpha=0.45, markeredgewidth=0)
            means = unit_means(scores)
            low, high = mean_interval(means, RANGES.get(metric, UNBOUNDED))
            ax.vlines(position + 0.25, low, high, **style)
            ax.plot(position + 0.25, means.mean(), "D", **style, markersize=4)
        ax.set(ylabel=AXIS_LABELS[metric], xlim=(-0.5, 2.6))
        ax.set_xticks(range(3), [label(group).removeprefix("RL ") for group in paper.CONDITIONS])
        ax.set_ylim(0, 1.1 * late[metric].max() or 1)
    note(fig, caption)
    return fig


def trade_off_figure(runs, total_steps, caption=""):
    """Time taken against clearance kept, over the late rollouts that place the can (cf. Fig. 1).

    Parameters
    ----------
    runs : DataFrame
        Of baselines and of RLIHF at any weights, with the column steps.
    total_steps : int
    caption : str

    Returns
    -------
    matplotlib Figure
        A dot per run, a diamond per group or weight.
    """
    late = add_phase(runs, total_steps).query("phase == 'Late' and success == 1")
    late = late.assign(seconds=CONTROL_STEP * late["steps"], cm=100 * late["min_clearance"])
    weights = sorted(late.loc[late["group"] == "rlihf", "w_hf"].unique())
    looks = {("dense", 0.0): (label("dense"), color("dense"))}
    for weight, shade in zip(weights, shades(len(weights)), strict=True):
        looks["rlihf", weight] = (f"{label('rlihf')}, $w_{{hf}}$ = {weight:g}", shade)
    fig, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.6))
    for (group, weight), (name, shade) in looks.items():
        chosen = late[(late["group"] == group) & (late["w_hf"] == weight)]
        scores = chosen.groupby(["subject", "run"])[["seconds", "cm"]].mean()
        if len(scores):
            means = unit_means(scores)
            (x, y), intervals = means.mean(), [mean_interval(means[m], UNBOUNDED) for m in means]
            bars = np.nan_to_num(np.abs(np.array(intervals).T - [x, y]))
            ax.plot(*scores.to_numpy().T, "o", color=shade, ms=3, alpha=0.4, mew=0)
            ax.errorbar(x, y, bars[:, 1:], bars[:, :1], fmt="D", ms=4, color=shade, label=name)
    if not len(late):
        ax.text(0.5, 0.5, "no run places the can", transform=ax.transAxes, ha="center")
    ax.set(xlabel="Time to place the can (s)", ylabel=AXIS_LABELS["min_clearance"])
    ax.set_ylim(bottom=0)
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    note(fig, caption)
    return fig


def comparison_figure(runs, table, total_steps, caption=""):
    """Performance profiles of late success, and how likely a run of RLIHF beats one of another.

    Parameters
    ----------
    runs : DataFrame
        Of the groups whose profiles are drawn: the share of runs with a score above each threshold
        (Agarwal et al. 2021).
    table : DataFrame
        From `tables.comparison_table`.
    total_steps : int
    caption : str

    Returns
    -------
    matplotlib Figure
    """
    late, taus = late_scores(runs, total_steps), np.linspace(0, 1, 101)
    fig, (left, right) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.4), width_ratios=[1.2, 1])
    for group in ordered(late["group"]):
        chosen = late[late["group"] == group].set_index("subject")
        above = pd.DataFrame(chosen[["success"]].to_numpy() > taus, chosen.index, dtype=float)
        shares = unit_means(above)
        name = f"{label(group)} ({size(chosen.reset_index())})"
        left.step(taus, shares.mean(), where="post", label=name, **line_style(group))
        low, high = mean_interval(shares, (0, 1))
        left.fill_between(taus, low, high, step="post", color=color(group), alpha=0.18, lw=0)
    left.set(xlabel=r"Late success rate $\tau$", ylabel=r"Share of runs above $\tau$")
    left.set(xlim=(-0.02, 1.02), ylim=(-0.03, 1.03))
    fig.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    rows = table[table["metric"] == "success"][::-1]
    style = {"color": color("rlihf")}
    right.hlines(range(len(rows)), rows["improvement_low"], rows["improvement_high"], **style)
    right.plot(rows["improvement"], range(len(rows)), "D", markersize=4, **style)
    right.axvline(0.5, color="#767676", linewidth=0.8, linestyle=":")
    right.set_yticks(range(len(rows)), rows["comparison"].str.replace(" - ", " > "))
    right.set(xlim=(-0.03, 1.03), ylim=(-0.6, len(rows) - 0.4))
    right.set_xlabel("P(improvement) in late success")
    note(fig, caption)
    return fig


def decoder_policy_figure(runs, table, total_steps, caption=""):
    """Does a better decoder give a better policy? Late success against AUROC, a point a person.

    Parameters
    ----------
    runs : DataFrame
        Each of RLIHF's is a small dot.
    table : DataFrame
        From `tables.subject_table`. People are named whose policies stay behind dense reward by
        more than `statistics.EQUIVALENCE_MARGIN`.
    total_steps : int
    caption : str

    Returns
    -------
    matplotlib Figure
        The title holds Spearman's correlation, its interval and p.
    """
    fig, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.5))
    style = {"color": color("rlihf")}
    late = (
        late_scores(runs, total_steps).query("group == 'rlihf'").merge(table[["subject", "auroc"]])
    )
    ax.plot(late["auroc"], late["success"], "o", **style, ms=3, alpha=0.35, mew=0)
    ax.vlines(table["auroc"], table["success_low"], table["success_high"], **style)
    ax.plot(table["auroc"], table["success"], "D", **style, ms=4, label=label("rlihf"))
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
    note(fig, caption)
    return fig
