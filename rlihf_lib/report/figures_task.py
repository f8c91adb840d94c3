"""Fig. 3, the task as a rendering beside a labelled top view; paths executed in it."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from rlihf_lib.report.style import LABELS, PAGE_WIDTH, color, line_style, shades
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.rendering import project, render
from rlihf_lib.task.workspace import OBSTACLES, TABLE_HEIGHT

# Obstacles are grey and hatched: colours are of conditions, and of the can.
OBJECT_COLOURS = {"goal": "#FFFFFF", "can": "#C8102E"} | dict.fromkeys(OBSTACLES, "#D0D0D0")
HATCH: dict[str, Any] = {"hatch": "/////", "ec": "#8A8A8A"}
# Of many paths, and of the few that lie over them.
MANY: dict[str, Any] = {"lw": 0.7, "alpha": 0.7}
FEW = {"lw": 1.5, "zorder": 3, "path_effects": [withStroke(linewidth=2.6, foreground="white")]}
OUTLINED = [withStroke(linewidth=1.8, foreground="white")]  # of names on pictures
# World axes drawn to the right and upwards; from above, x points away from the robot, downwards.
FROM_ABOVE, FROM_FRONT = (1, 0), (1, 2)
# Names in the rendering stand below what they name, but for these: points right and up of it.
BESIDE = {"can": (0, 16), "cereal": (-22, 0), "bottle": (24, 8), "hand": (-27, 0)}
ZONE_GREYS = (("#F6F6F6", "#A8A8A8"), ("#E9E9E9", "#555555"))  # inside and outline, outer first


def task_figure(seed: int = 0) -> Figure:
    """Draw a placement of the scene: rendered, where OpenGL is available, and from above."""
    env = PickPlaceEnv()
    env.reset(seed=seed)
    figure, (left, top) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 3.6))
    left.axis("off")
    if (pixels := scene(seed)) is None:
        left.text(0.5, 0.5, "no OpenGL library here", ha="center")
    else:
        left.imshow(pixels)
        _label_picture(env, left)
    top_view(env, top)
    top.legend(fontsize=7, loc="lower center")
    return figure


def _label_picture(env, ax):
    """Outline the goal and name what is seen."""
    *_, rim = silhouettes(env.workspace, "goal", FROM_ABOVE)
    rim = np.insert(rim[:, ::-1], 2, env.workspace.placement["goal"][2], axis=1)
    ax.add_patch(Polygon(project(rim), fill=False, ec="#222222", lw=1.2))
    for name, place in {**env.workspace.placement, "hand": env.controller.hand}.items():
        ax.annotate(
            name, project(place[None])[0], BESIDE.get(name, (0, -14)), va="center", ha="center",
            textcoords="offset points", fontsize=8, path_effects=OUTLINED,
        )  # fmt: skip


def scene(seed: int = 0) -> np.ndarray | None:
    """Render a placement; None without an OpenGL library."""
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "scene.png"
        return plt.imread(picture) if render(picture, seed) else None


def silhouettes(workspace, name: str, view: tuple, margin: float = 0.0) -> Iterator[np.ndarray]:
    """Outlines of an object's collision shapes, or of the goal, as seen along a world axis.

    Of a fast `Workspace`, whose shapes are boxes, cylinders and ellipsoids. `view` are the two
    world axes to draw; outlines, corners of shape (360, 2), lie `margin` metres outside the shapes.
    """
    model, data = workspace.sim.model._model, workspace.sim.data._data
    angle = np.radians(np.arange(360) + 0.5)
    outwards = np.zeros((360, 3))
    outwards[:, view] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for geom in workspace.geom_ids[name]:
        rotation = data.geom_xmat[geom].reshape(3, 3)
        farthest = _farthest(model.geom_type[geom], model.geom_size[geom], outwards @ rotation)
        outline = data.geom_xpos[geom] + farthest @ rotation.T + margin * outwards
        yield outline[:, view]
    if name == "goal":  # a mark, which the simulation doesn't know
        farthest = _farthest(mujoco.mjtGeom.mjGEOM_CYLINDER, workspace.goal.size, outwards)
        yield (workspace.placement[name] + farthest + margin * outwards)[:, view]


def _farthest(kind, size, along):
    """Points of a shape that lie farthest along directions (n, 3), both in its own frame."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return np.sign(along) * size
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return size**2 * along / np.linalg.norm(size * along, axis=1, keepdims=True)
    if kind != mujoco.mjtGeom.mjGEOM_CYLINDER:
        raise ValueError(f"no outline for geoms of type {kind}")
    radial = along[:, :2] / np.maximum(np.hypot(*along.T[:2]), 1e-12)[:, None]
    return np.column_stack([size[0] * radial, size[1] * np.sign(along[:, 2])])


def top_view(env: PickPlaceEnv, ax: Axes) -> None:
    """Draw objects, goal and ideal path from above, as a person facing the robot sees them."""
    _draw_scene(env, ax, FROM_ABOVE, alpha=0.8)
    for name in OBJECT_COLOURS:
        *_, outline = silhouettes(env.workspace, name, FROM_ABOVE)
        (left, far), (right, near) = outline.min(axis=0), outline.max(axis=0)
        place, offset, align = ((left + right) / 2, near), (0, -2), ("center", "top")
        if name in ("bottle", "cereal"):  # which stand one behind the other
            place, offset, align = (right, (far + near) / 2), (2, 0), ("left", "center")
        ax.annotate(
            name, place, offset, textcoords="offset points", ha=align[0], va=align[1], fontsize=7,
            path_effects=OUTLINED,
        )  # fmt: skip
    ax.plot(*env.path.reach[0, 1::-1], "k^", ms=5, label="hand at the start")
    ax.set(ylabel="x, away from the robot (m)", ylim=(0.27, -0.32))


def _side_view(env, ax):
    _draw_scene(env, ax, FROM_FRONT, alpha=0.5)
    for name in OBJECT_COLOURS:
        below = 0.042 if name in ("lemon", "bottle", "goal") else 0.015  # neighbours' names
        y = env.workspace.placement[name][1]
        ax.text(y, TABLE_HEIGHT - below, name, fontsize=7, ha="center", va="top")
    ax.axhline(TABLE_HEIGHT, color="k", lw=0.6)
    ax.set(ylabel="height z (m)", ylim=(TABLE_HEIGHT - 0.08, TABLE_HEIGHT + 0.4))


def _draw_scene(env, ax, view, alpha):
    for name, colour in OBJECT_COLOURS.items():
        for outline in silhouettes(env.workspace, name, view):
            look = HATCH if name in OBSTACLES else {"ec": "#555555"}
            ax.add_patch(Polygon(outline, fc=colour, alpha=alpha, lw=0.5, gid=name, **look))
    for part, dashes, label in ((env.path.reach, ":", "to"), (env.path.carry, "--", "with")):
        ax.plot(*part[:, view].T, "k" + dashes, lw=1, label=f"ideal path {label} the can")
    ax.set(xlabel="y (m)", aspect="equal", xlim=(-0.32, 0.32))


def paths_figure(env: PickPlaceEnv, recordings: dict[str, list], zones: dict[float, str]) -> Figure:
    """Draw executed paths of the hand among the obstacles, from above and from the side.

    Of each condition an `evaluation.Recording` per run, all of the placement to which `env` is
    reset. `zones` are two distances from obstacles, metres, and what they mean to the observer.
    """
    figure, (top, side) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 3.7), width_ratios=[1, 1.1])
    top_view(env, top)
    _side_view(env, side)
    _draw_zones(env.workspace, top, sorted(zones, reverse=True))
    top.set_ylim(0.2, -0.32)
    for condition, runs in recordings.items():
        look = line_style(condition)
        for run in runs:
            drawn = look | (MANY if condition == "rlihf" else FEW)
            _draw_path(run, top, FROM_ABOVE, **drawn)
            _draw_path(run, side, FROM_FRONT, **drawn)
        placed = f"{sum(run.success for run in runs)} of {len(runs)} runs place the can"
        top.plot([], [], label=f"{LABELS[condition]}: {placed}", **look)
    for metres, (_, grey) in zip(sorted(zones), reversed(ZONE_GREYS), strict=True):
        label = f"{100 * metres:.0f} cm from obstacles: {zones[metres]}"
        top.plot([], [], color=grey, lw=0.9, ls=":", label=label)
    figure.legend(
        *top.get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=7,
        title="Path of the hand at the end of training; star: can placed, cross: not",
        title_fontsize=7,
    )  # fmt: skip
    return figure


def paths_by_weight(env: PickPlaceEnv, recordings: dict, zones: tuple[float, ...]) -> Figure:
    """Draw the hand's paths from above and from the side, a column a reward (cf. Fig. 1).

    `recordings` holds, by condition ("sparse", "dense"), weight of human feedback, or observer,
    `evaluation.Recording`s of the placement to which `env` is reset; `zones` are distances from
    obstacles, metres. A path that crosses a zone from above may pass over it: look at both rows.
    """
    fig, (tops, sides) = plt.subplots(
        2, len(recordings), figsize=(PAGE_WIDTH, 3.1), sharex=True, sharey="row", squeeze=False,
        height_ratios=[0.56, 0.43],
    )  # fmt: skip
    tones = shades(key for key in recordings if not isinstance(key, str))
    for top, side, (key, runs) in zip(tops, sides, recordings.items(), strict=True):
        _draw_scene(env, top, FROM_ABOVE, alpha=0.8)
        _draw_zones(env.workspace, top, sorted(zones, reverse=True))
        _draw_scene(env, side, FROM_FRONT, alpha=0.5)
        look = {"color": tones.get(key, color(key if key in LABELS else "rlihf")), "lw": 0.7}
        for run in runs:
            _draw_path(run, top, FROM_ABOVE, **look)
            _draw_path(run, side, FROM_FRONT, **look)
        placed = f"{sum(run.success for run in runs)} of {len(runs)} placed"
        title = f"$w_{{hf}}$ = {key:g}" if key in tones else str(key)
        top.set_title(f"{LABELS.get(key, f'RLIHF, {title}')}\n{placed}", fontsize=8)
        side.axhline(TABLE_HEIGHT, color="k", lw=0.6)
        top.set(xlabel="", ylim=(0.2, -0.36), yticks=(-0.3, -0.1, 0.1))
        side.set(xticks=(-0.2, 0, 0.2), yticks=(TABLE_HEIGHT, TABLE_HEIGHT + 0.2))
        side.set_ylim(TABLE_HEIGHT - 0.03, TABLE_HEIGHT + 0.4)
    tops[0].set_ylabel("x, away from\nthe robot (m)")
    sides[0].set_ylabel("height z (m)")
    marks = [Line2D([], [], color="k", ls="", marker=m, label=label)
             for m, label in (("*", "can placed"), ("x", "not placed"))]  # fmt: skip
    hand = Line2D([], [], color="k", lw=0.7, label="path of the hand")
    ideal = [Line2D([], [], color="k", ls=dashes, lw=1, label=f"ideal path {label} the can")
             for dashes, label in ((":", "to"), ("--", "with"))]  # fmt: skip
    words = ", ".join(f"{100 * metres:.0f}" for metres in sorted(zones))
    zone = Line2D([], [], color="#888888", ls=":", label=f"{words} cm from obstacles (across)")
    fig.legend(handles=[hand, zone, *ideal, *marks], loc="outside upper center", ncols=3)
    return fig


def _draw_path(run, ax, view, **look):
    """Draw a recording's path of the hand; at its end a star if the can is placed, else a cross."""
    path, mark = run.hand[:, view], {"marker": "x", "ms": 4, "path_effects": OUTLINED}
    if run.success:
        mark = {"marker": "*", "ms": 6, "mec": "white", "mew": 0.4}
    ax.plot(*path.T, **look)
    ax.plot(*path[-1], color=look["color"], zorder=3.5, **mark)


def _draw_zones(workspace, ax, distances):
    """Outline all that is nearer to an obstacle than each distance, largest first."""
    for order, (metres, (inside, grey)) in enumerate(zip(distances, ZONE_GREYS, strict=True)):
        zones = [z for o in OBSTACLES for z in silhouettes(workspace, o, FROM_ABOVE, metres)]
        # Insides over the outlines: zones that overlap have one outline.
        for number, width in enumerate((1.6, 0)):
            for zone in zones:
                patch = Polygon(zone, fc=inside, ec=grey, lw=width, ls=":", gid=f"{metres} m")
                ax.add_patch(patch).set_zorder(0.6 + 0.1 * order + 0.05 * number)
