"""Figures of what policies reach in the end: safety, comparisons, what decides.

Of the table of `evaluations.load_runs`, the late phase. Dots are runs, diamonds means over people
and seeds, bars their 95 % intervals (`statistics`); diamonds are hollow where fewer than five
people, or seeds of one, were drawn, which give no interval.
"""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from rlihf_lib.report import paper, style
from rlihf_lib.report import statistics as st
from rlihf_lib.report.evaluations import RANGES, phase_scores, size, unit_means
from rlihf_lib.report.figures_policy import AXIS_LABELS
from rlihf_lib.report.style import SHARE

CONTROL_STEP = 0.1  # s
RUNS: dict[str, Any] = {"ls": "", "marker": "o", "ms": 3, "mew": 0, "alpha": 0.4}
BESIDE = 1.6  # points between lines that coincide
#: Row of `people.correlation_table`: the phase, and what is reached in it.
DECIDED = {
    "success_early": ("Early", "success"), "success": ("Late", "success"),
    "return": ("Late", "return"), "clearance": ("Late", "clearance"),
}  # fmt: skip
#: AUROC, by construction, of feedback that is always right, and that says nothing; the last two
#: side by side to be seen.
CONTROLS = {"rlihf-ideal": 1.0, "rlihf-mean": 0.494, "rlihf-shuffled": 0.506}


def safety_figure(runs: pd.DataFrame) -> Figure:
    """Collisions, and the clearance of cans that are placed, in the late phase.

    Under each condition: how many of its runs collide at all, and how many place the can.
    """
    late = phase_scores(runs).assign(clearance=lambda table: 100 * table["clearance"])
    panels = {
        "collisions": ("runs with\na collision", late["collisions"] > 0),
        "clearance": ("runs that\nplace the can", late["clearance"].notna()),
    }
    fig, axes = plt.subplots(1, 2, figsize=(style.COLUMN_WIDTH, 3.3))
    rng = np.random.default_rng(0)
    for ax, (metric, (counted, among)) in zip(axes, panels.items(), strict=True):
        names = []
        for x, group in enumerate(paper.CONDITIONS):
            shade, own = style.color(group), late["group"] == group
            name = style.label(group).removeprefix("RL ")
            names.append(f"{name}\n{among[own].sum()}/{own.sum()}")
            if (scores := late[own].set_index("subject")[metric].dropna()).empty:
                continue
            places = x + rng.uniform(-0.12, 0.12, len(scores))
            ax.plot(places, scores, color=shade, clip_on=False, **RUNS)
            mean_and_interval(scores, ax, x + 0.25, metric, shade)
        ax.set(xlabel=counted, ylabel=AXIS_LABELS[metric], xlim=(-0.5, 2.6))
        ax.set_xticks(range(3), names)
        ax.set_ylim(0, 1.1 * np.nan_to_num(late[metric].max()) or 1)
    return fig


def mean_and_interval(
    scores: pd.Series, ax: Axes, x: float, metric: str, shade: str | tuple, label: str = ""
) -> None:
    """Draw the mean of runs' scores, indexed by subject, as a diamond with its interval, at `x`."""
    if scores.empty:
        return
    means = unit_means(scores)
    low, high = st.mean_interval(means, RANGES.get(metric, st.NO_BOUNDS))
    ax.vlines(x, low, high, color=shade)
    _diamond(ax, x, means.mean(), np.isfinite(low), shade, label)


def _diamond(ax, x, y, is_certain, shade, label=""):
    """Draw a mean, hollow where it has no interval."""
    look = {"color": shade, "mfc": shade if is_certain else "white", "ms": 4, "zorder": 2.5}
    ax.plot(x, y, "D", clip_on=False, label=label, **look)


def comparison_figure(runs: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """Performance profiles of late success, and how likely a run of RLIHF beats one of another.

    A profile is the share of runs with a score above each threshold (Agarwal et al. 2021), of every
    group in `runs`; those that coincide are drawn side by side. `table` is from
    `tables.comparison_table`.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH, 2.4), width_ratios=[1.2, 1])
    taus, late = np.linspace(0, 1, 101), phase_scores(runs)
    drawn: list[tuple] = []
    for group in style.ordered(late["group"]):
        chosen = late[late["group"] == group]
        above = chosen[["success"]].to_numpy() > taus
        shares = unit_means(pd.DataFrame(above, chosen["subject"], dtype=float))
        name, mean = f"{style.label(group)} ({size(chosen)})", tuple(shares.mean())
        up = ScaledTranslation(0, drawn.count(mean) * BESIDE / 72, fig.dpi_scale_trans)
        look = style.line_style(group) | {"transform": left.transData + up, "clip_on": False}
        left.step(taus, mean, where="post", label=name, **look)
        drawn.append(mean)
        low, high = st.mean_interval(shares, st.PROBABILITY)
        left.fill_between(taus, low, high, step="post", color=style.color(group), alpha=0.18, lw=0)
    left.set(xlabel=r"Late success rate $\tau$", ylabel=r"Share of runs above $\tau$")
    left.set(xlim=(-0.02, 1.02), ylim=SHARE)
    fig.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    rows = table[table["metric"] == "success"][::-1]
    ends = rows["improvement_low"], rows["improvement_high"]
    _bars(right, rows["improvement"], *ends, style.color("rlihf"))
    right.axvline(0.5, **style.REFERENCE)
    names = rows["comparison"].str.replace(" - ", " > ")
    right.set_yticks(range(len(rows)), names, fontsize=style.SMALL)
    right.set(xlim=SHARE, ylim=(-0.6, len(rows) - 0.4), xlabel="P(better) in late success")
    return fig


def _bars(ax, values, low, high, shade):
    """Draw a row for each value, from below: its interval and a diamond."""
    ax.hlines(range(len(values)), low, high, color=shade)
    for place, (value, is_certain) in enumerate(zip(values, np.isfinite(low), strict=True)):
        _diamond(ax, value, place, is_certain, shade)


def equivalence_figure(people: pd.DataFrame, table: pd.DataFrame, runs: pd.DataFrame) -> Figure:
    """How far late success of RLIHF is from that of dense reward: over all, and person by person.

    Tables as `tables.comparison_table` and `people.subject_table` make them; of `runs` each
    person's are dots. Who lies between the dashed lines, interval and all, teaches as well as
    dense reward (`statistics.equivalence_test` asks for a little less: that a 90 % interval does).
    """
    overall = table[(table["metric"] == "success") & table["comparison"].str.endswith("dense")]
    names = [f"{row.subject} ({row.auroc:.2f})" for row in people.itertuples()]
    rows = pd.concat([people.assign(name=names), overall.assign(name="all people")])
    fig, ax = plt.subplots(figsize=(style.COLUMN_WIDTH, 1.0 + 0.19 * len(rows)))
    shade = style.color("rlihf")
    late = phase_scores(runs).query("group == 'rlihf'").set_index("subject")["success"]
    for place, person in enumerate(people.itertuples()):
        scores = late.loc[[person.subject]] - person.dense
        ax.plot(scores, np.full(len(scores), place), color=shade, **RUNS)
    _bars(ax, rows["difference"], rows["ci_low"], rows["ci_high"], shade)
    ax.axvline(0, color="#555555", lw=0.8, zorder=1)
    for sign, side in ((-1, "right"), (1, "left")):
        margin = sign * st.EQUIVALENCE_MARGIN
        ax.axvline(margin, **style.REFERENCE)
        ax.annotate(
            f"{margin:+.2f}".replace("-", "−"), (margin, 1), (-6 * sign, 2), ha=side,
            xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=style.SMALL,
        )  # fmt: skip
    ax.axhline(len(people) - 0.5, color="#BBBBBB", lw=0.6)
    ax.set_yticks(range(len(rows)), rows["name"])
    ax.set(xlabel="RLIHF − dense, late success", ylabel="Person (AUROC)")
    ax.set_ylim(-0.6, len(rows) - 0.4)
    ax.margins(x=0.08)
    return fig


def decoder_policy_figure(
    runs: pd.DataFrame, people: pd.DataFrame, correlations: pd.DataFrame, threshold: pd.DataFrame
) -> Figure:
    """Does a better decoder make a better policy, sooner or in the end, or a safer one? By AUROC.

    A point a person, and each control among `runs`; tables as `people.subject_table`,
    `people.correlation_table` and `people.threshold_table` make them. People are named who teach
    less than half of what dense reward does late. Grey is the gap between the two people round the
    AUROC at which this half is reached.
    """
    fig, axes = plt.subplots(1, len(DECIDED), figsize=(style.PAGE_WIDTH, 3.1))
    shade, found = style.color("rlihf"), correlations.set_index("metric")
    aurocs = people.set_index("subject")["auroc"]
    low, high = threshold.set_index("measure").loc["auroc", ["half_after", "half_by"]]
    named = people.loc[people["success"] < people["dense"] / 2, "subject"]
    for ax, (tested, (phase, metric)) in zip(axes, DECIDED.items(), strict=True):
        scores = phase_scores(runs, phase).set_index("subject")
        scores["clearance"] *= 100
        scores = scores.dropna(subset=metric)  # of cans that are placed
        reached = {group: own[metric] for group, own in scores.groupby("group")}
        rlihf, dense = (reached.get(group, scores[metric].iloc[:0]) for group in ("rlihf", "dense"))
        ax.axhline(dense.mean(), **style.line_style("dense"), label=style.label("dense"))
        for group in filter(reached.__contains__, CONTROLS):
            look = metric, style.color(group), style.label(group)
            _runs_and_mean(ax, CONTROLS[group], reached[group], *look)
        for number, (person, own) in enumerate(rlihf.groupby(level="subject")):
            label = "" if number else "RLIHF, a person each"
            _runs_and_mean(ax, aurocs[person], own, metric, shade, label)
        for person in named[named.isin(rlihf.index)]:
            place = aurocs[person], rlihf[person].mean()
            ax.annotate(person, place, (3, 4), textcoords="offset points", fontsize=7)
        if tested in found.index:  # no clearance where nothing is placed
            ax.set_title(_correlation(found.loc[tested]))
        of_phase = {"success": f"{phase} success rate", "return": f"{phase} return"}
        ax.set(xlabel="AUROC", ylabel=of_phase.get(metric, AXIS_LABELS[metric]))
        if metric != "return":
            ax.set_ylim(-0.05, 1.05 if metric == "success" else None)
    late = axes[[*DECIDED].index("success")]
    if pd.notna(low):
        label = f"half of dense: AUROC {low:.2f} to {high:.2f}"
        late.axvspan(low, high, color="#EEEEEE", lw=0, label=label)
    fig.legend(*late.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


def _correlation(found):
    words = [rf"$\rho$ = {found['rho']:.2f}", rf"$p_\mathrm{{Holm}}$ = {found['p_holm']:#.2g}"]
    if np.isfinite(found["ci_low"]):
        words.insert(1, f"[{found['ci_low']:.2f}, {found['ci_high']:.2f}]")
    return "\n".join(words).replace("-", "−")


def _runs_and_mean(ax, x, scores, metric, shade, label):
    ax.plot(np.full(len(scores), x), scores, color=shade, clip_on=False, **RUNS)
    mean_and_interval(scores, ax, x, metric, shade, label)
