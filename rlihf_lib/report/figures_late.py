"""Figures of what policies reach in the end: safety, trade-offs, comparisons, what decides.

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
from rlihf_lib.report.figures_policy import AXIS_LABELS, SHARE, by_weight
from rlihf_lib.report.people import threshold_table

CONTROL_STEP = 0.1  # s
RUNS: dict[str, Any] = {"ls": "", "marker": "o", "ms": 3, "mew": 0, "alpha": 0.4}
PHASES = {"Late": "success", "Early": "success_early"}  # and its column of `people.subject_table`
#: AUROC, by construction, of feedback that is always right, and that says nothing; the last two
#: side by side to be seen.
CONTROLS = {"rlihf-ideal": 1.0, "rlihf-mean": 0.494, "rlihf-shuffled": 0.506}


def safety_figure(runs: pd.DataFrame) -> Figure:
    """Collisions, and the clearance of cans that are placed, in the late phase."""
    late = phase_scores(runs).assign(clearance=lambda table: 100 * table["clearance"])
    fig, axes = plt.subplots(1, 2, figsize=(style.COLUMN_WIDTH, 2.3))
    rng = np.random.default_rng(0)
    for ax, metric in zip(axes, ("collisions", "clearance"), strict=True):
        for x, group in enumerate(paper.CONDITIONS):
            shade = style.color(group)
            scores = late[late["group"] == group].set_index("subject")[metric].dropna()
            ax.plot(x + rng.uniform(-0.12, 0.12, len(scores)), scores, color=shade, **RUNS)
            mean_and_interval(scores, ax, x + 0.25, metric, shade)
        ax.set(ylabel=AXIS_LABELS[metric], xlim=(-0.5, 2.6))
        ax.set_xticks(range(3), [style.label(g).removeprefix("RL ") for g in paper.CONDITIONS])
        ax.set_ylim(0, 1.1 * np.nan_to_num(late[metric].max()) or 1)
    return fig


def mean_and_interval(scores: pd.Series, ax: Axes, x: float, metric: str, shade: str) -> None:
    """Draw the mean of runs' scores, indexed by subject, as a diamond with its interval, at `x`."""
    if scores.empty:
        return
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
    weights = by_weight(placed.query("group == 'rlihf'"))
    for scores, look in [(placed.query("group == 'dense'"), dense), *weights]:
        if len(scores):
            means = unit_means(scores)
            (x, y), intervals = means.mean(), st.mean_interval(means)
            arms = np.abs(intervals - [[x, y]])
            ax.plot(*scores.to_numpy().T, color=look["color"], **RUNS)
            ax.errorbar(x, y, arms[:, 1:], arms[:, :1], ls="", ms=4.5, **look)
    if not len(late):
        ax.text(0.5, 0.5, "no run places the can", transform=ax.transAxes, ha="center")
    ax.set(xlabel="Time to place the can (s)", ylabel=AXIS_LABELS["clearance"])
    ax.set_ylim(bottom=0)
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


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
        look = style.line_style(group) | {"lw": 1.5 if len(shares) >= st.MIN_UNITS else 0.8}
        name = f"{style.label(group)} ({size(chosen)})"
        left.step(taus, shares.mean(), where="post", label=name, **look)
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


def decoder_policy_figure(
    runs: pd.DataFrame, people: pd.DataFrame, correlations: pd.DataFrame
) -> Figure:
    """Does a better decoder make a better policy, late, or sooner? Success against AUROC.

    A point a person, and each control among `runs`; tables as `people.subject_table` and
    `people.correlation_table` make them. People are named who teach less than half of what dense
    reward does late. Between the best decoder that teaches no success and the weakest that does
    (`people.threshold_table`) lies a band, if AUROC parts them.
    """
    fig, axes = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH, 2.7), sharey=True)
    shade, found = style.color("rlihf"), correlations.set_index("metric")
    aurocs = people.set_index("subject")["auroc"]
    border = threshold_table(people).set_index("measure").loc["auroc"]
    named = people.loc[people["success"] < people["dense"] / 2, "subject"]
    for ax, (phase, tested) in zip(axes, PHASES.items(), strict=True):
        scores = phase_scores(runs, phase)
        own = scores[(scores["group"] == "rlihf") & scores["subject"].isin(aurocs.index)]
        if border["parts_people"]:
            ax.axvspan(
                border["fails_up_to"],
                border["places_from"],
                color="#EEEEEE",
                lw=0,
                label="nobody is decoded so well",
            )
        dense = scores.loc[scores["group"] == "dense", "success"].mean()
        ax.axhline(dense, **style.line_style("dense"), label=style.label("dense"))
        for group, at in CONTROLS.items():
            if len(control := scores[scores["group"] == group]):
                _person(control, ax, at, style.color(group), style.label(group), mfc="none")
        for number, (person, reached) in enumerate(own.groupby("subject")):
            name = "" if number else "RLIHF, a person each"
            _person(reached, ax, aurocs[person], shade, name)
        for person in named:
            place = aurocs[person], own.loc[own["subject"] == person, "success"].mean()
            ax.annotate(person, place, (3, 4), textcoords="offset points", fontsize=7)
        r = found.loc[tested]
        spread = f"[{r['ci_low']:.2f}, {r['ci_high']:.2f}]"
        ax.set_title(
            rf"{phase}: Spearman's $\rho$ = {r['rho']:.2f}, "
            f"{'no interval' if np.isnan(r['ci_low']) else spread}, n = {r['n']:.0f}\n"
            f"p = {r['p']:.2g} (smallest possible: {r['smallest_p']:.2g})"
        )
        ax.set_xlabel("AUROC of the held-out person")
    axes[0].set(ylabel=AXIS_LABELS["success"], ylim=(-0.05, 1.05))
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


def _person(scores, ax, auroc, shade, name, **diamond):
    """Draw the success of one person's runs, or a control's, with mean and interval over seeds."""
    success, label = scores["success"], name or "_nolegend_"
    ax.plot(np.full(len(scores), auroc), success, color=shade, **RUNS)
    ax.vlines(auroc, *st.mean_interval(success, st.PROBABILITY), color=shade)
    ax.plot(auroc, success.mean(), "D", color=shade, ms=4, label=label, **diamond)
