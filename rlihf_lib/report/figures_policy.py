"""Figures of policies: Fig. 2, 4, 6, what the learner says of itself, what is reached in the end.

Most take the table of `evaluations.load_runs`. Lines and diamonds are means over people and seeds,
bands and bars their 95 % intervals (`statistics`); where fewer than five people, or seeds of one,
were drawn, the runs themselves are shown. Of the late phase, dots are runs.
"""

from itertools import cycle
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator

from rlihf_lib.report import paper, style
from rlihf_lib.report import statistics as st
from rlihf_lib.report.evaluations import RANGES, late_scores, size, unit_means

AXIS_LABELS = {
    "return": "Evaluation return",
    "success": "Success rate",
    "path_efficiency": "Path efficiency",
    "path_deviation": "Path deviation (m)",
    "collisions": "Collisions per episode",
    "min_clearance": "Minimum clearance (cm)",
    "critic_loss": "Critic loss",
    "ent_coef": r"Entropy coefficient $\alpha$",
    "mean_q": "Mean Q",
    "judged_wrong": "Share judged wrong",
}
STEPS = "Steps (thousands)"
SHARE = (-0.03, 1.03)  # limits of an axis of shares, with room for lines at 0 and 1
CONTROL_STEP = 0.1  # s
RUNS: dict[str, Any] = {"ls": "", "marker": "o", "ms": 3, "mew": 0, "alpha": 0.4}


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
    brain.set(xlabel="Time after the error (ms)", ylabel=f"Error − correct, {channel} (µV)")
    brain.set_xlim(0, people.index.max())
    for moment, epochs in zip(("correct", "error"), p_error.groupby("label"), strict=True):
        shade, look = style.COLORS[moment], {"bins": 20, "range": (0, 1), "density": True}
        look |= {"fc": to_rgba(shade, 0.25), "ec": shade, "histtype": "stepfilled"}
        decoder.hist(epochs[1]["p_error"], label=moment, **look)
    decoder.set(xlabel="p(error); reward r = 1 − p", ylabel="Density of epochs", xlim=(0, 1))
    decoder.legend(title="the robot was", loc="upper center", fontsize=7, title_fontsize=7)
    group_curves(runs, policy, paper.CONDITIONS, "success")
    policy.set(xlabel=STEPS, ylabel=AXIS_LABELS["success"], ylim=(SHARE[0], 1.75))
    policy.set_yticks([0, 0.5, 1])
    policy.legend(fontsize=7, loc="upper left")
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
        low, high = st.mean_interval(means, RANGES[metric])
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
        ax.set(xlabel=STEPS if ax in axes[-1] else "", ylabel="", visible=i < n)
        ax.tick_params(labelbottom=i >= n - columns)
    fig.supylabel(AXIS_LABELS["return"], fontsize=8)
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


def figure_6(runs: pd.DataFrame) -> Figure:
    """Fig. 6: return and success for several weights of human feedback, and the baselines.

    Any number of weights, in shades of RLIHF's colour: darker is heavier.
    """
    fig, axes = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH, 2.6))
    for ax, metric in zip(axes, ("return", "success"), strict=True):
        group_curves(runs, ax, ("sparse", "dense"), metric)
        for chosen, look in _by_weight(runs[runs["group"] == "rlihf"]):
            learning_curve(chosen, ax, metric, markersize=3.5, **look)
        name_axes(ax, runs, metric)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return fig


def _by_weight(rows):
    """Part rows by the weight of human feedback, each with its name, shade and marker."""
    weights = dict(list(rows.groupby("w_hf")))
    shades = style.shades(weights)
    for (w, chosen), marker in zip(weights.items(), cycle("s^vPX"), strict=False):
        yield chosen, {"color": shades[w], "marker": marker, "label": rf"RLIHF, $w_{{hf}}$ = {w:g}"}


def training_figure(runs: pd.DataFrame, training: pd.DataFrame, condition: str, horizon) -> Figure:
    """How one condition learns: its own reward while training, a line per run; then the evaluation.

    `training` is from `evaluations.load_training`, as `runs` of this condition. The evaluation has
    the same axes for every condition: 1 is the most a step of the `horizon` can earn.
    """
    fig, axes = plt.subplots(1, 3, figsize=(style.PAGE_WIDTH, 2.0))
    for _, run in training.dropna(subset="return").groupby("run"):
        axes[0].plot(run["step"] / 1000, run["return"], color=style.color(condition), lw=0.5)
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
        if column in ("critic_loss", "ent_coef") and training[column].notna().any():
            ax.set_yscale("log", subs=())  # not where nothing is learnt, as in the first steps
            ax.yaxis.set(major_locator=LogLocator(subs=(1, 2, 5)), major_formatter="{x:g}")
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


def safety_figure(runs: pd.DataFrame) -> Figure:
    """Collisions and minimum clearance in the late phase."""
    late = late_scores(runs).assign(min_clearance=lambda table: 100 * table["min_clearance"])
    fig, axes = plt.subplots(1, 2, figsize=(style.COLUMN_WIDTH, 2.3))
    rng = np.random.default_rng(0)
    for ax, metric in zip(axes, ("collisions", "min_clearance"), strict=True):
        for x, group in enumerate(paper.CONDITIONS):
            shade = style.color(group)
            scores = late[late["group"] == group].set_index("subject")[metric].dropna()
            ax.plot(x + rng.uniform(-0.12, 0.12, len(scores)), scores, color=shade, **RUNS)
            mean_and_interval(scores, ax, x + 0.25, metric, shade)
        ax.set(ylabel=AXIS_LABELS[metric], xlim=(-0.5, 2.6))
        ax.set_xticks(range(3), [style.label(g).removeprefix("RL ") for g in paper.CONDITIONS])
        ax.set_ylim(0, 1.1 * late[metric].max() or 1)
    return fig


def mean_and_interval(scores: pd.Series, ax: Axes, x: float, metric: str, shade: str) -> None:
    """Draw the mean of runs' scores, indexed by subject, as a diamond with its interval, at `x`."""
    means = unit_means(scores)
    ax.vlines(x, *st.mean_interval(means, RANGES[metric]), color=shade)
    ax.plot(x, means.mean(), "D", color=shade, ms=4)


def trade_off_figure(runs: pd.DataFrame) -> Figure:
    """Time taken against clearance kept, over the late rollouts that place the can (cf. Fig. 1).

    Of dense reward and of RLIHF at any weights; `runs` has the column steps.
    """
    late = runs.query("phase == 'Late' and success == 1")
    late = late.assign(seconds=CONTROL_STEP * late["steps"], cm=100 * late["min_clearance"])
    fig, ax = plt.subplots(figsize=(style.COLUMN_WIDTH, 2.6))
    placed = late.groupby(["group", "w_hf", "subject", "run"])[["seconds", "cm"]].mean()
    dense = {"label": style.label("dense"), "color": style.color("dense"), "marker": "D"}
    weights = _by_weight(placed.query("group == 'rlihf'"))
    for scores, look in [(placed.query("group == 'dense'"), dense), *weights]:
        if len(scores):
            means = unit_means(scores)
            (x, y), intervals = means.mean(), st.mean_interval(means)
            arms = np.abs(intervals - [[x, y]])
            ax.plot(*scores.to_numpy().T, color=look["color"], **RUNS)
            ax.errorbar(x, y, arms[:, 1:], arms[:, :1], ls="", ms=4.5, **look)
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
    fig, (left, right) = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH, 2.4), width_ratios=[1.2, 1])
    taus, late = np.linspace(0, 1, 101), late_scores(runs)
    for group in style.ordered(late["group"]):
        chosen = late[late["group"] == group]
        above = chosen[["success"]].to_numpy() > taus
        shares = unit_means(pd.DataFrame(above, chosen["subject"], dtype=float))
        name = f"{style.label(group)} ({size(chosen)})"
        left.step(taus, shares.mean(), where="post", label=name, **style.line_style(group))
        low, high = st.mean_interval(shares, st.PROBABILITY)
        left.fill_between(taus, low, high, step="post", color=style.color(group), alpha=0.18, lw=0)
    left.set(xlabel=r"Late success rate $\tau$", ylabel=r"Share of runs above $\tau$")
    left.set(xlim=(-0.02, 1.02), ylim=SHARE)
    fig.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    rows = table[table["metric"] == "success"][::-1]
    places, shade = range(len(rows)), style.color("rlihf")
    right.hlines(places, rows["improvement_low"], rows["improvement_high"], color=shade)
    right.plot(rows["improvement"], places, "D", ms=4, color=shade)
    right.axvline(0.5, **style.REFERENCE)
    right.set_yticks(places, rows["comparison"].str.replace(" - ", " > "))
    right.set(xlim=SHARE, ylim=(-0.6, len(rows) - 0.4), xlabel="P(better) in late success")
    return fig


def decoder_policy_figure(runs: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """Does a better decoder give a better policy? Late success against AUROC, a point a person.

    `table` is from `tables.subject_table`. People are named whose policies stay behind dense reward
    by more than `statistics.EQUIVALENCE_MARGIN`. The title holds Spearman's correlation.
    """
    fig, ax = plt.subplots(figsize=(style.COLUMN_WIDTH, 2.5))
    shade = style.color("rlihf")
    late = late_scores(runs).query("group == 'rlihf'").merge(table[["subject", "auroc"]])
    ax.plot(late["auroc"], late["success"], color=shade, **RUNS)
    ax.vlines(table["auroc"], table["success_low"], table["success_high"], color=shade)
    ax.plot(table["auroc"], table["success"], "D", color=shade, ms=4, label=style.label("rlihf"))
    behind = table[table["success"] < table["dense"] - st.EQUIVALENCE_MARGIN].sort_values("auroc")
    heights = cycle((4, -9))  # neighbours' names above and below
    for row, height in zip(behind.itertuples(), heights, strict=False):
        place = row.auroc, row.success
        ax.annotate(row.subject, place, (4, height), textcoords="offset points", fontsize=7)
    ax.axhline(table["dense"].iloc[0], **style.line_style("dense"), label=style.label("dense"))
    r = st.spearman(table["auroc"], table["success"])
    spread = "no interval" if np.isnan(r["ci_low"]) else f"[{r['ci_low']:.2f}, {r['ci_high']:.2f}]"
    ax.set_title(
        rf"Spearman's $\rho$ = {r['rho']:.2f}, {spread}, n = {r['n']}"
        f"\np = {r['p']:.2g} (smallest possible: {r['smallest_p']:.2g})"
    )
    ax.set(xlabel="AUROC of the held-out person", ylabel="Success rate, late phase")
    ax.set_ylim(-0.05, 1.05)
    ax.legend()
    return fig
