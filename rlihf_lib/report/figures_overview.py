"""Fig. 2, the way from an error potential to a policy, drawn from this study's own data."""

import matplotlib.pyplot as plt
import seaborn as sns
from matplotlib.figure import Figure

from rlihf_lib.report import paper
from rlihf_lib.report.figures_policy import SHARE, group_curves
from rlihf_lib.report.style import COLORS, PAGE_WIDTH

TITLES = (
    "A person watches  →",
    "the brain answers  →",
    "a decoder rewards  →",
    "the robot learns  ↺",
)


def overview_figure(scene, waves, p_error, runs) -> Figure:
    """Draw the loop of the paper: scene, error potential, p(error) as reward, learning.

    Parameters
    ----------
    scene : ndarray, shape (height, width, 3), or None
        Picture of the robot, from `figures_task.scene`.
    waves : DataFrame
        Error-minus-correct waves, uV, a column each person, with channel and time in s: the table
        `difference_waves` of notebook 01. Drawn is Cz, or the first channel where there is none.
    p_error : DataFrame
        From `Study.p_error`.
    runs : DataFrame
        Of the main comparison, from `evaluations.load_runs`.
    """
    fig, axes = plt.subplots(1, 4, figsize=(PAGE_WIDTH, 1.9), width_ratios=[1.2, 1, 1, 1])
    robot, brain, decoder, policy = axes
    robot.axis("off")
    if scene is None:
        robot.text(0.5, 0.5, "no OpenGL library here", ha="center", fontsize=7)
    else:
        width = scene.shape[1]
        robot.imshow(scene[:, width // 10 : 9 * width // 10])
    _wave(brain, waves)
    _reward(decoder, p_error)
    group_curves(runs, policy, paper.CONDITIONS, "success")
    policy.set(xlabel="Steps (thousands)", ylabel="Success rate", ylim=(SHARE[0], 1.55))
    policy.set_yticks([0, 0.5, 1])
    policy.legend(fontsize=6, loc="upper left")
    for ax, title in zip(axes, TITLES, strict=True):
        ax.set_title(title, fontweight="bold", loc="left")
    return fig


def _wave(ax, waves):
    """Each person's difference wave and their mean."""
    channel = "Cz" if "Cz" in set(waves["channel"]) else waves["channel"].iloc[0]
    waves = waves[waves["channel"] == channel]
    people = waves.drop(columns=["channel", "time"])
    milliseconds = 1000 * waves["time"]
    ax.plot(milliseconds, people, color="#BBBBBB", lw=0.5)
    ax.plot(milliseconds, people.mean(axis=1), color=COLORS["error"], lw=1.6)
    ax.axhline(0, color="#555555", lw=0.5)
    ax.set(xlabel="Time after the error (ms)", ylabel=f"Error - correct, {channel} (µV)")
    ax.set_xlim(0, milliseconds.max())


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
