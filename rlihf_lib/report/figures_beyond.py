"""Figures of notebook 06: what feedback must be like for a robot to learn from it."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rlihf_lib.report import style
from rlihf_lib.report.evaluations import RANGES, derive, phase_scores
from rlihf_lib.report.figures_late import CONTROL_STEP, RUNS
from rlihf_lib.report.figures_policy import AXIS_LABELS
from rlihf_lib.report.people import TAUGHT
from rlihf_lib.report.statistics import PROBABILITY
from rlihf_lib.report.style import SHARE

MARKERS = "osD^vP"  # of studies, in their order


def people_figure(
    people: Mapping[str, pd.DataFrame], references: pd.DataFrame, runs: pd.DataFrame
) -> Figure:
    """What people have taught against the AUROC of their decoders: a point each, a marker a study.

    Tables as `people.taught` makes them, by what to call the study. `references`: the same means
    of groups without a person, which index it. `runs` are the first study's, of the steps that the
    tables are about: each is a dot, and a thin line joins a person's.
    """
    fig, axes = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH, 3.0), sharey=True)
    shade, end = style.color("rlihf"), runs["step"].max() / 1000
    when = f",\n{2 * end / 3:.0f} to {end:.0f} thousand steps"
    own = phase_scores(derive(runs)).query("group == 'rlihf'")
    own = own.merge(next(iter(people.values()))[["subject", "auroc"]], on="subject")
    for ax, metric in zip(axes, TAUGHT, strict=True):
        for group, reached in references[metric].items():
            ax.axhline(reached, **style.line_style(group), label=style.label(group))
        ends = own.groupby("auroc")[metric].agg(["min", "max"])
        ax.vlines(ends.index, ends["min"], ends["max"], color=shade, lw=0.6, alpha=0.6)
        ax.plot(own["auroc"], own[metric], color=shade, **RUNS)
        for number, (name, table) in enumerate(people.items()):
            (points,) = ax.plot(table["auroc"], table[metric], MARKERS[number], color=shade, ms=5)
            points.set(label=f"{style.STUDIES.get(name, name)} (n = {len(table)})")
            points.set_markerfacecolor(shade if number == 0 else "none")
        ax.set(xlabel="AUROC of the held-out person", ylabel=AXIS_LABELS[metric] + when, ylim=SHARE)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


def cases_figure(late: pd.DataFrame, metrics: tuple[str, ...]) -> Figure:
    """What runs of each case of an experiment reach late: dots are runs, diamonds their means.

    Of `beyond.Beyond.late`, a panel for each metric; dotted: the mean of the first case.
    """
    cases = late["case"].cat.categories[::-1]
    size = style.PAGE_WIDTH, 0.8 + 0.22 * len(cases)
    fig, axes = plt.subplots(1, len(metrics), figsize=size, sharey=True, squeeze=False)
    for ax, metric in zip(axes[0], metrics, strict=True):
        scale = 100 if metric == "clearance" else 1
        for place, case in enumerate(cases):
            scores = scale * late.loc[late["case"] == case, metric].dropna()
            if place == len(cases) - 1:
                ax.axvline(scores.mean(), **style.REFERENCE)
            ax.plot(scores, np.full(len(scores), place), color=style.color("rlihf"), **RUNS)
            ax.plot(scores.mean(), place, "D", color=style.color("rlihf"), ms=4)
        ax.set(xlabel=AXIS_LABELS[metric], yticks=range(len(cases)), yticklabels=cases)
        if RANGES[metric] == PROBABILITY:
            ax.set_xlim(SHARE)
    return fig


def grid_figure(late: pd.DataFrame, metrics: tuple[str, ...]) -> Figure:
    """Means over the runs of a grid of intervals (down) and delays (across), in s; in numbers.

    Below each mean its lowest and highest run. Of `beyond.Beyond.late` with the columns interval
    and delay, in control steps.
    """
    size = style.PAGE_WIDTH, 2.2
    fig, axes = plt.subplots(1, len(metrics), figsize=size, sharey=True, squeeze=False)
    for ax, metric in zip(axes[0], metrics, strict=True):
        table, low, high = (
            late.pivot_table(metric, "interval", "delay", how) for how in ("mean", "min", "max")
        )
        ax.imshow(table, cmap="Oranges", vmin=0, vmax=1, aspect="auto")
        for at in np.ndindex(table.shape):
            look = {"ha": "center", "color": "white" if table.iloc[at] > 0.6 else "black"}
            ax.text(*at[::-1], f"{table.iloc[at]:.2f}", va="bottom", **look)
            runs = f"{low.iloc[at]:.2f} to {high.iloc[at]:.2f}"
            ax.text(*at[::-1], runs, va="top", size=style.SMALL, **look)
        ax.set_xticks(
            range(table.shape[1]), [f"{CONTROL_STEP * delay:g}" for delay in table.columns]
        )
        ax.set_yticks(range(table.shape[0]), [f"{CONTROL_STEP * every:g}" for every in table.index])
        ax.set(xlabel="Delay of the answer (s)", title=AXIS_LABELS[metric])
        ax.grid(visible=False)
    axes[0, 0].set_ylabel("One answer every ... s")
    return fig


def labels_figure(late: pd.DataFrame, metrics: tuple[str, ...]) -> Figure:
    """What is reached late against how many steps people were asked about, by who fills in.

    Of `beyond.Beyond.late` with the columns answers and told (how steps without an answer are
    judged); dots are runs, lines join their means.
    """
    size = style.PAGE_WIDTH, 2.6
    fig, axes = plt.subplots(1, len(metrics), figsize=size, squeeze=False)
    palette = style.shades(range(late["told"].nunique()))
    for ax, metric in zip(axes[0], metrics, strict=True):
        for number, (told, runs) in enumerate(late.groupby("told", sort=False)):
            look = {"color": palette[number], "marker": MARKERS[number]}
            ax.plot(runs["answers"], runs[metric], ls="", ms=3, alpha=0.5, **look)
            means = runs.groupby("case", observed=True)[["answers", metric]].mean()
            ax.plot(*means.sort_values("answers").to_numpy().T, ms=5, label=told, **look)
        ax.set(xlabel="Answers in a run", ylabel=AXIS_LABELS[metric], xscale="log", ylim=SHARE)
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig
