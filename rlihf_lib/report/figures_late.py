"""Figures of what policies reach in the end: safety, comparisons, what decides.

Of the table of `evaluations.load_runs`, the late phase. Dots are runs, diamonds means over people
and seeds, bars their 95 % intervals (`statistics`), where five people, or seeds of one, were drawn.
"""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rlihf_lib.report import paper, style
from rlihf_lib.report import statistics as st
from rlihf_lib.report.evaluations import RANGES, phase_scores, size, unit_means
from rlihf_lib.report.figures_policy import AXIS_LABELS, SHARE

CONTROL_STEP = 0.1  # s
RUNS: dict[str, Any] = {"ls": "", "marker": "o", "ms": 3, "mew": 0, "alpha": 0.4}
#: Column of `people.subject_table`: the phase, and what is reached in it.
DECIDED = {
    "success": ("Late", "success"), "return": ("Late", "return"),
    "success_early": ("Early", "success"),
}  # fmt: skip
#: AUROC, by construction, of feedback that is always right, and that says nothing; the last two
#: side by side to be seen.
CONTROLS = {"rlihf-ideal": 1.0, "rlihf-mean": 0.494, "rlihf-shuffled": 0.506}


def safety_figure(runs: pd.DataFrame) -> Figure:
    """Collisions, and the clearance of cans that are placed, in the late phase."""
    late = phase_scores(runs).assign(clearance=lambda table: 100 * table["clearance"])
    fig, axes = plt.subplots(1, 2, figsize=(style.COLUMN_WIDTH, 2.5))
    rng = np.random.default_rng(0)
    for ax, metric in zip(axes, ("collisions", "clearance"), strict=True):
        for x, group in enumerate(paper.CONDITIONS):
            shade = style.color(group)
            scores = late[late["group"] == group].set_index("subject")[metric].dropna()
            if scores.empty:
                ax.text(x, 0, "none\nplaced", ha="center", va="bottom", fontsize=7, color=shade)
                continue
            places = x + rng.uniform(-0.12, 0.12, len(scores))
            ax.plot(places, scores, color=shade, clip_on=False, **RUNS)
            mean_and_interval(scores, ax, x + 0.25, metric, shade)
        ax.set(ylabel=AXIS_LABELS[metric], xlim=(-0.5, 2.6))
        ax.set_xticks(range(3), [style.label(g).removeprefix("RL ") for g in paper.CONDITIONS])
        ax.set_ylim(0, 1.1 * np.nan_to_num(late[metric].max()) or 1)
    return fig


def mean_and_interval(
    scores: pd.Series, ax: Axes, x: float, metric: str, shade: str | tuple
) -> None:
    """Draw the mean of runs' scores, indexed by subject, as a diamond with its interval, at `x`."""
    if scores.empty:
        return
    means = unit_means(scores)
    ax.vlines(x, *st.mean_interval(means, RANGES.get(metric, st.NO_BOUNDS)), color=shade)
    ax.plot(x, means.mean(), "D", color=shade, ms=4, clip_on=False)


def comparison_figure(runs: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """Performance profiles of late success, and how likely a run of RLIHF beats one of another.

    A profile is the share of runs with a score above each threshold (Agarwal et al. 2021), of every
    group in `runs`; `table` is from `tables.comparison_table`.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH, 2.4), width_ratios=[1.2, 1])
    taus, late = np.linspace(0, 1, 101), phase_scores(runs)
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


def equivalence_figure(people: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """How far late success of RLIHF is from that of dense reward: over all, and person by person.

    Tables as `tables.comparison_table` and `people.subject_table` make them. Who lies between the
    dotted lines, interval and all, teaches as well as dense reward (`statistics.equivalence_test`
    asks for a little less: that a 90 % interval does).
    """
    overall = table[(table["metric"] == "success") & table["comparison"].str.endswith("dense")]
    names = [f"{row.subject} ({row.auroc:.2f})" for row in people.itertuples()]
    rows = pd.concat([people.assign(name=names), overall.assign(name="all people")])
    fig, ax = plt.subplots(figsize=(style.COLUMN_WIDTH, 0.9 + 0.19 * len(rows)))
    places, shade = range(len(rows)), style.color("rlihf")
    ax.hlines(places, rows["ci_low"], rows["ci_high"], color=shade)
    ax.plot(rows["difference"], places, "D", ms=4, color=shade)
    for margin in (-st.EQUIVALENCE_MARGIN, st.EQUIVALENCE_MARGIN):
        ax.axvline(margin, **style.REFERENCE)
    ax.set_yticks(places, rows["name"])
    ax.set(xlabel="Late success, RLIHF less RL dense", ylabel="Person (AUROC)")
    ax.set_ylim(-0.6, len(rows) - 0.4)
    ax.margins(x=0.08)
    return fig


def decoder_policy_figure(
    runs: pd.DataFrame, people: pd.DataFrame, correlations: pd.DataFrame, threshold: pd.DataFrame
) -> Figure:
    """Does a better decoder make a better policy, late, or sooner? `DECIDED` against AUROC.

    A point a person, and each control among `runs`; tables as `people.subject_table`,
    `people.correlation_table` and `people.threshold_table` make them. People are named who teach
    less than half of what dense reward does late. Grey is the interval of the AUROC at which this
    half is reached.
    """
    fig, axes = plt.subplots(1, 3, figsize=(style.PAGE_WIDTH, 2.8))
    shade, found = style.color("rlihf"), correlations.set_index("metric")
    aurocs = people.set_index("subject")["auroc"]
    half = threshold.set_index("measure").loc["auroc"]
    named = people.loc[people["success"] < people["dense"] / 2, "subject"]
    for ax, (tested, (phase, metric)) in zip(axes, DECIDED.items(), strict=True):
        scores = phase_scores(runs, phase)
        own = scores[scores["group"] == "rlihf"]
        dense = scores.loc[scores["group"] == "dense", metric].mean()
        ax.axhline(dense, **style.line_style("dense"), label=style.label("dense"))
        for group, at in CONTROLS.items():
            if len(control := scores[scores["group"] == group]):
                words = style.label(group)
                _person(control, metric, ax, at, style.color(group), words, mfc="none")
        for number, (person, reached) in enumerate(own.groupby("subject")):
            name = "" if number else "RLIHF, a person each"
            _person(reached, metric, ax, aurocs[person], shade, name)
        for person in named:
            place = aurocs[person], own.loc[own["subject"] == person, metric].mean()
            ax.annotate(person, place, (3, 4), textcoords="offset points", fontsize=7)
        r = found.loc[tested]
        spread = f"[{r['ci_low']:.2f}, {r['ci_high']:.2f}]"
        ax.set_title(
            rf"$\rho$ = {r['rho']:.2f} {'' if np.isnan(r['ci_low']) else spread}"
            f"\np, Holm = {r['p_holm']:.2g} (least {r['smallest_p_holm']:.2g})"
        )
        ax.set(xlabel="AUROC of the held-out person", ylabel=f"{phase}: {AXIS_LABELS[metric]}")
        if RANGES[metric] == st.PROBABILITY:
            ax.set_ylim(-0.05, 1.05)
    if pd.notna(half["half_low"]):
        words = f"half of dense: AUROC {half['half_at']:.2f}"
        axes[0].axvspan(half["half_low"], half["half_high"], color="#EEEEEE", lw=0, label=words)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


def _person(scores, metric, ax, auroc, shade, name, **diamond):
    """Draw one person's runs, or a control's, with mean and interval over seeds."""
    reached, label = scores[metric], name or "_nolegend_"
    ax.plot(np.full(len(scores), auroc), reached, color=shade, clip_on=False, **RUNS)
    ax.vlines(auroc, *st.mean_interval(reached, RANGES[metric]), color=shade)
    ax.plot(auroc, reached.mean(), "D", color=shade, ms=4, label=label, **diamond)
