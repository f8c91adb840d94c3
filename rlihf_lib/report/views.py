"""What a reader plays with (`interact.explore`): one picture for any person, any value."""

import matplotlib.pyplot as plt
import mne
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from rlihf_lib.eeg.erp import difference_wave
from rlihf_lib.eeg.scores import reliability
from rlihf_lib.report import figures_late, figures_policy, figures_task, paper, style
from rlihf_lib.report.evaluations import phase_scores

MS, UV = 1e3, 1e6  # from s and V
SHOWN = (-0.2, 0.8)  # s around the feedback
DIGITS = {"success": 2, "return": 0, "path_efficiency": 2, "path_deviation": 2, "collisions": 1,
          "completed": 2, "clearance": 1}  # fmt: skip


def person_view(epochs: mne.BaseEpochs, channel: str) -> Figure:
    """Error and correct waves of one person at a channel, and the scalp where they differ most.

    Bands: 95 % intervals over trials. The map is drawn at the largest difference at the channel.
    """
    if channel not in epochs.ch_names:
        raise ValueError(f"channel is {channel!r}; choose one of {', '.join(epochs.ch_names)}")
    fig, (waves, scalp) = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH, 2.5), width_ratios=(2.2, 1))
    shown = (epochs.times >= SHOWN[0]) & (epochs.times <= SHOWN[1])
    for event in ("correct", "error"):
        values = UV * epochs[event].get_data(picks=[channel])[:, 0, shown]
        mean = values.mean(axis=0)
        low, high = stats.t.interval(0.95, len(values) - 1, mean, stats.sem(values))
        look = {"color": style.COLORS[event]}
        waves.plot(MS * epochs.times[shown], mean, label=f"{event} ({len(values)} epochs)", **look)
        waves.fill_between(MS * epochs.times[shown], low, high, alpha=0.25, lw=0, **look)
    difference = difference_wave(epochs)
    size = np.where(shown, np.abs(difference.get_data(channel)[0]), 0)
    peak = int(size.argmax())
    waves.axvline(MS * epochs.times[peak], **style.REFERENCE)
    waves.set(xlabel="Time after feedback (ms)", ylabel=f"{channel} (µV)")
    waves.legend(loc="best")
    limit = UV * np.abs(difference.data[:, peak]).max()
    image, _ = mne.viz.plot_topomap(
        UV * difference.data[:, peak], difference.info, axes=scalp, show=False, cmap="RdBu_r",
        vlim=(-limit, limit), contours=4,
    )  # fmt: skip
    scalp.set_title(f"Error − correct at {MS * epochs.times[peak]:.0f} ms")
    fig.colorbar(image, ax=scalp, label="µV", shrink=0.8)
    return fig


def threshold_view(table: pd.DataFrame, threshold: float) -> Figure:
    """What a person's p(error) says, what a threshold makes of it, and whether p is a probability.

    `table` has the person's rows of `Study.p_error`. Left their epochs by class, in the middle how
    many of each class are called an error, right observed against promised errors.
    """
    fig, axes = plt.subplots(1, 3, figsize=(style.PAGE_WIDTH, 2.5), width_ratios=(1.3, 1, 1))
    p, labels = table["p_error"].to_numpy(), table["label"].to_numpy()
    said, bins = p > threshold, np.linspace(0, 1, 21)
    for label, event in enumerate(("correct", "error")):
        chosen = p[labels == label]
        look = {"color": style.COLORS[event], "label": f"{event} ({len(chosen)})"}
        axes[0].hist(chosen, bins, alpha=0.45, **look)
    axes[0].axvline(threshold, color="black", lw=1)
    axes[0].set(xlabel="p(error)", ylabel="Epochs", xlim=(0, 1))
    axes[0].legend()
    counts = np.array([[((labels == t) & (said == s)).sum() for s in (0, 1)] for t in (0, 1)])
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes[1].imshow(shares, cmap="Greys", vmin=0, vmax=1.2)
    for (row, column), count in np.ndenumerate(counts):
        share = shares[row, column]
        shade = "white" if share > 0.7 else "black"
        axes[1].text(column, row, f"{count}\n{share:.0%}", ha="center", va="center", color=shade)
    names = ("correct", "error")
    axes[1].set_xticks((0, 1), names)
    axes[1].set_yticks((0, 1), names)
    axes[1].set(xlabel=f"Called, p > {threshold:.2f}", ylabel="Was")
    axes[1].set_title(
        f"Accuracy {np.mean(said == labels):.2f}, balanced {np.diag(shares).mean():.2f}"
    )
    axes[1].grid(False)
    promised, observed, _ = reliability(p, labels)
    axes[2].plot([0, 1], [0, 1], **style.REFERENCE)
    axes[2].plot(promised, observed, "o-", color=style.COLORS["online"], ms=3.5)
    axes[2].set(xlabel="Promised p(error)", ylabel="Observed errors", xlim=(0, 1), ylim=(0, 1))
    return fig


def phase_view(runs: pd.DataFrame, person: str, phase: str) -> Figure:
    """Success while one person teaches, beside the baselines, and a phase's means as a table.

    `runs` are the main comparison's; the phase, one of `paper.PHASES`, is shaded.
    """
    chosen = runs[runs["subject"].isin(["", person])]
    fig, (curves, table) = plt.subplots(
        1, 2, figsize=(style.PAGE_WIDTH, 2.6), width_ratios=(1, 1.25)
    )
    within = chosen[chosen["phase"] == phase]
    figures_policy.group_curves(chosen, curves, paper.CONDITIONS, "success")
    figures_policy.name_axes(curves, chosen, "success")
    number = paper.PHASES.index(phase)
    third = chosen["step"].max() / 3000
    curves.axvspan(number * third, (number + 1) * third, color="#F0F0F0", zorder=-1)
    curves.legend(loc="best")
    means = within.groupby("group")[list(DIGITS)].mean().T
    means.loc["clearance"] *= 100  # in cm; of cans that are placed
    texts = {metric: means.loc[metric].map(f"{{:.{n}f}}".format) for metric, n in DIGITS.items()}
    table.axis("off")
    cells = table.table(
        [[texts[m][g].replace("nan", "–") for g in paper.CONDITIONS] for m in DIGITS],
        rowLabels=[figures_policy.AXIS_LABELS[metric] for metric in DIGITS],
        colLabels=[style.label(group) for group in paper.CONDITIONS],
        bbox=(0.32, 0, 0.68, 0.9), edges="horizontal",
    )  # fmt: skip
    cells.auto_set_font_size(False)
    cells.set_fontsize(7.5)
    table.set_title(f"{person}, {phase}: means over runs and rollouts")
    return fig


def weight_view(env, recordings: dict, runs: pd.DataFrame, weight: float) -> Figure:
    """Paths at a weight of human feedback and with dense reward, and the clearance that is kept.

    `recordings` holds, by weight and as "dense", a list of `evaluation.Recording`s of the placement
    to which `env` is reset; `runs` those of the ablation. Dots are runs, over the late rollouts.
    """
    fig, (top, clearance) = plt.subplots(
        1, 2, figsize=(style.PAGE_WIDTH, 3.2), width_ratios=(1.6, 1)
    )
    figures_task.top_view(env, top)
    late = phase_scores(runs)
    shades = style.shades(late.loc[late["group"] == "rlihf", "w_hf"])
    shown = {
        "dense": ("dense", late["group"] == "dense"),
        weight: ("rlihf", (late["group"] == "rlihf") & (late["w_hf"] == weight)),
    }
    for x, (key, (group, rows)) in enumerate(shown.items()):
        look = style.line_style(group) | ({"color": shades[weight]} if key == weight else {})
        words = style.label(group) + (f", $w_{{hf}}$ = {weight:g}" if group == "rlihf" else "")
        for recording in recordings[key]:
            top.plot(*recording.hand[:, figures_task.FROM_ABOVE].T, lw=1.2, **look)
        top.plot([], [], label=words, **look)
        scores = 100 * late[rows].set_index("subject")["clearance"].dropna()
        shade = look["color"]
        clearance.plot([x] * len(scores), scores, color=shade, **figures_late.RUNS)
        figures_late.mean_and_interval(scores, clearance, x + 0.15, "clearance", shade)
    top.legend(loc="upper left", bbox_to_anchor=(0, -0.18), ncols=2)
    clearance.set_xticks((0, 1), ("RL dense", f"RLIHF, {weight:g}"))
    clearance.set(ylabel="Clearance of placed cans, late (cm)", xlim=(-0.5, 1.6))
    clearance.set_ylim(0, 1.1 * clearance.get_ylim()[1])
    return fig
