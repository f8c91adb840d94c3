"""Fig. 3, the task as a rendering beside a labelled top view, and the paths executed in it."""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import BoxStyle, Circle, FancyBboxPatch, Rectangle

from rlihf_lib.report.style import COLORS, LABELS, PAGE_WIDTH, note
from rlihf_lib.rl.observer import PREFERRED_CLEARANCE
from rlihf_lib.task.rendering import render
from rlihf_lib.task.workspace import OBSTACLES, TABLE_HEIGHT

# Outlines on the table: half-widths (m) of boxes or a radius (m), and a colour.
OUTLINES = {
    "can": (0.025, "#C8102E"),
    "goal": (0.045, "#999999"),
    "lemon": ((0.034, 0.02), "#E6C700"),
    "cereal": ((0.015, 0.05), "#8C564B"),
    "bottle": (0.029, "#009E73"),
    "bread": ((0.02, 0.024), "#D8A15D"),
}


def task_figure(seed=0):
    """Draw the scene of one placement: rendering where OpenGL is available, and top view.

    Parameters
    ----------
    seed : int
        Of the placement.

    Returns
    -------
    Figure
    """
    from rlihf_lib.task.gym_env import PickPlaceEnv

    env = PickPlaceEnv()
    env.reset(seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "scene.png"
        backend = render(picture, seed)
        pixels = plt.imread(picture) if backend else None
    if pixels is None:
        figure, top = plt.subplots(figsize=(3.5, 3.2), layout="constrained")
        top.set_title("top view (no OpenGL library here: drawn, not rendered)", fontsize=7)
    else:
        figure, (left, top) = plt.subplots(
            1, 2, figsize=(7.16, 2.9), layout="constrained", width_ratios=[1.3, 1]
        )
        left.imshow(pixels)
        left.axis("off")
    top_view(env.workspace.placement, env.path, top)
    return figure


def top_view(placement, path, ax=None):
    """Draw objects, goal and ideal path from above, as a person facing the robot sees them.

    Parameters
    ----------
    placement : dict of str to ndarray, shape (3,)
        Centre of each object, metres.
    path : IdealPath
    ax : Axes, optional

    Returns
    -------
    Axes
    """
    ax = ax or plt.gca()
    for name, (size, colour) in OUTLINES.items():
        x, y = placement[name][:2]
        if np.isscalar(size):
            ax.add_patch(Circle((y, x), size, color=colour, alpha=0.8, lw=0))
        else:
            corner = (y - size[1], x - size[0])
            ax.add_patch(Rectangle(corner, 2 * size[1], 2 * size[0], color=colour, alpha=0.8, lw=0))
        ax.annotate(
            name, (y, x), xytext=(0, 11), textcoords="offset points", ha="center", fontsize=7
        )
    ax.plot(path.reach[:, 1], path.reach[:, 0], "k:", lw=1, label="ideal path to the can")
    ax.plot(path.carry[:, 1], path.carry[:, 0], "k--", lw=1, label="ideal path with the can")
    ax.plot(*path.reach[0, 1::-1], "k^", ms=5, label="hand at the start")
    ax.set(xlabel="y (m)", ylabel="x, away from the robot (m)", aspect="equal")
    ax.set(xlim=(-0.32, 0.32), ylim=(0.27, -0.32))
    ax.legend(fontsize=6, loc="lower center", frameon=False, ncols=1)
    return ax


def paths_figure(env, recordings, caption):
    """Draw executed paths of the hand among the obstacles, from above and from the side.

    Parameters
    ----------
    env : PickPlaceEnv
        Reset to the placement of the recordings.
    recordings : dict of str to list of rlihf_lib.rl.replay.Recording
        Of each condition, one per run, all of the same placement.
    caption : str

    Returns
    -------
    Figure
    """
    figure, (top, side) = plt.subplots(
        1, 2, figsize=(PAGE_WIDTH, 3.3), layout="constrained", width_ratios=[1, 1.1]
    )
    placement, path = env.workspace.placement, env.path
    top_view(placement, path, top)
    top.get_legend().remove()
    _side_view(env, side)
    for name in OBSTACLES:
        _clearance_line(top, name, placement[name])
    for condition, runs in recordings.items():
        for run in runs:
            style = {"color": COLORS[condition], "lw": 1, "alpha": 0.8}
            top.plot(run.hand[:, 1], run.hand[:, 0], **style)
            side.plot(run.hand[:, 1], run.hand[:, 2], **style)
            end = {"color": COLORS[condition], "marker": "*" if run.success else "x", "ms": 6}
            top.plot(*run.hand[-1, 1::-1], **end)
            side.plot(*run.hand[-1, 1:], **end)
        placed = sum(run.success for run in runs)
        label = f"{LABELS[condition]}: {placed} of {len(runs)} runs place the can"
        top.plot([], [], color=COLORS[condition], label=label)
    top.plot([], [], color="#888888", lw=0.8, ls=":", label="preferred clearance, 2 cm")
    figure.legend(loc="outside upper center", ncols=3, fontsize=6)
    note(
        figure,
        f"hand of the policies at the end of training; star: can placed, cross: not · {caption}",
    )
    return figure


def _side_view(env, ax):
    """Draw the scene as seen from the robot's front: across the table and up."""
    for name, (size, colour) in OUTLINES.items():
        centre = env.workspace.placement[name]
        half = size if np.isscalar(size) else size[1]
        height = 0.008 if name == "goal" else 2 * env.workspace.standing_height(name)
        ax.add_patch(
            Rectangle(
                (centre[1] - half, TABLE_HEIGHT), 2 * half, height, color=colour, alpha=0.5, lw=0
            )
        )
        below = 0.035 if name == "bottle" else 0.015  # the cereal box stands behind it
        ax.text(centre[1], TABLE_HEIGHT - below, name, fontsize=6, ha="center", va="top")
    ax.axhline(TABLE_HEIGHT, color="k", lw=0.6)
    ax.plot(env.path.reach[:, 1], env.path.reach[:, 2], "k:", lw=1)
    ax.plot(env.path.carry[:, 1], env.path.carry[:, 2], "k--", lw=1)
    ax.set(xlabel="y (m)", ylabel="height z (m)", aspect="equal", xlim=(-0.32, 0.32))
    ax.set_ylim(TABLE_HEIGHT - 0.07, TABLE_HEIGHT + 0.4)


def _clearance_line(ax, name, centre):
    """Outline the zone round an obstacle into which people prefer the robot not to go."""
    size, _ = OUTLINES[name]
    style = {"fill": False, "ls": ":", "lw": 0.8, "ec": "#888888"}
    x, y = centre[:2]
    if np.isscalar(size):
        ax.add_patch(Circle((y, x), size + PREFERRED_CLEARANCE, **style))
    else:
        dx, dy = size
        rounded = BoxStyle("Round", pad=PREFERRED_CLEARANCE, rounding_size=PREFERRED_CLEARANCE)
        corner = (y - dy, x - dx)
        ax.add_patch(FancyBboxPatch(corner, 2 * dy, 2 * dx, boxstyle=rounded, **style))
