"""Fig. 3: the task, as a rendering beside a labelled top view."""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle, Rectangle

from rlihf_lib.task.rendering import render

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
