"""Fig. 2, the way from an error potential to a policy, drawn from this study's own data."""

import matplotlib.pyplot as plt
import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure

from rlihf_lib.report.figures_policy import group_curve
from rlihf_lib.report.style import COLORS, PAGE_WIDTH, note

TITLES = (
    "A person watches  →",
    "the brain answers  →",
    "a decoder rewards  →",
    "the robot learns  ↺",
)


def overview_figure(scene, waves, p_error, runs, caption="") -> Figure:
    """Draw the loop of the paper: scene, error potential, p(error) as reward, learning.

    Parameters
    ----------
    scene : ndarray, shape (height, width, 3)
        Picture of the robot, from `figures_task.scene`.
    waves : DataFrame
        Error-minus-correct wave at Cz of each person, uV, a column each, and time in s.
    p_error : DataFrame
        From `Study.p_error`.
    runs : DataFrame
        Of the main comparison, from `evaluations.load_runs`.
    caption : str
    """
    fig, axes = plt.subplots(1, 4, figsize=(PAGE_WIDTH, 1.9), width_ratios=[1.2, 1, 1, 1])
    robot, brain, decoder, policy = axes
    width = scene.shape[1]
    robot.imshow(scene[:, width // 10 : 9 * width // 10])
    robot.axis("off")
    _wave(brain, waves)
    _reward(decoder, p_error)
    for group in ("sparse", "dense", "rlihf"):
        group_curve(runs, policy, group, "success")
    policy.set(xlabel="Steps (thousands)", ylabel="Success rate", ylim=(-0.03, 1.55))
    policy.set_yticks([0, 0.5, 1])
    policy.legend(fontsize=6, loc="upper left")
    for ax, title in zip(axes, TITLES, strict=True):
        ax.set_title(title, fontweight="bold", loc="left")
    note(fig, caption)
    return fig


def _wave(ax, waves):
    """Each person's difference wave and their mean."""
    people = waves.drop(columns="time")
    milliseconds = 1000 * waves["time"]
    ax.plot(milliseconds, people, color="#BBBBBB", lw=0.5)
    ax.plot(milliseconds, people.mean(axis=1), color=COLORS["error"], lw=1.6)
    ax.axhline(0, color="#555555", lw=0.5)
    ax.set(xlabel="Time after the error (ms)", ylabel="Error - correct, Cz (µV)", xlim=(0, 800))


def _reward(ax, p_error):
    """How sure the decoder is of epochs of either class, and what reward that makes."""
    classes = p_error.assign(moment=p_error["label"].map({0: "correct", 1: "error"}))
    sns.histplot(
        classes, x="p_error", hue="moment", hue_order=["correct", "error"], palette=COLORS, ax=ax,
        bins=20, binrange=(0, 1), stat="density", common_norm=False, element="step", alpha=0.25,
    )  # fmt: skip
    ax.set(xlabel="p(error); reward r = 1 - p", ylabel="Density of epochs", xlim=(0, 1))
    legend = ax.get_legend()
    legend.set_title("the robot was")
    sns.move_legend(ax, "upper center", fontsize=6, title_fontsize=6)


def cz_waves(table: pd.DataFrame) -> pd.DataFrame:
    """Pick the waves at Cz from the table `difference_waves` of notebook 01."""
    return table[table["channel"] == "Cz"].drop(columns="channel")
