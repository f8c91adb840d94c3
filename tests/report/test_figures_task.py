"""Drawings of the task: the objects' outlines are those of the simulated shapes."""

import itertools

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import pytest
from matplotlib.path import Path
from scipy.spatial import ConvexHull, cKDTree

from rlihf_lib.report import figures_task
from rlihf_lib.report.figures_task import OBJECT_COLOURS, paths_by_weight, paths_figure
from rlihf_lib.report.style import color
from rlihf_lib.rl.evaluation import Recording
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.rendering import PICTURE, project
from rlihf_lib.task.workspace import OBSTACLES, PLACES, TABLE_HEIGHT, Workspace

VIEWS = {"top": (1, 0), "side": (1, 2)}
ZONES = {0.02: "too close", 0.05: "people at ease"}


@pytest.fixture(scope="module")
def env():
    environment = PickPlaceEnv()
    environment.reset(seed=1)
    yield environment
    environment.close()


@pytest.fixture(scope="module")
def drawing(env):
    """The axes of a figure with one path, by name."""
    figure = draw(env)
    yield dict(zip(VIEWS, figure.axes, strict=True))
    plt.close(figure)


def still(env, success=False):
    """Recording of a hand that does not move."""
    hand = np.tile(env.controller.hand, (2, 1))
    return Recording(hand, hand, env.data.qpos[None].copy(), seed=1, success=success)


def draw(env):
    return paths_figure(env, {"dense": [still(env)]}, ZONES)


def test_each_weight_has_a_panel_that_counts_who_places_the_can(env):
    recordings = {"dense": [still(env)], 0.1: [still(env, True), still(env)], 0.7: [still(env)]}
    fig = paths_by_weight(env, recordings, tuple(ZONES))
    tops, sides = fig.axes[:3], fig.axes[3:]
    weights = [f"RLIHF, $w_{{hf}}$ = {weight}" for weight in (0.1, 0.7)]
    words = ["RL dense\n0 of 1", f"{weights[0]}\n1 of 2", f"{weights[1]}\n0 of 1"]
    assert [ax.get_title() for ax in tops] == [f"{title} placed" for title in words]
    for axes in (tops, sides):
        ends = [[line for line in ax.lines if line.get_marker() in ("*", "x")] for ax in axes]
        assert [[line.get_marker() for line in lines] for lines in ends] == [
            ["x"],
            ["*", "x"],
            ["x"],
        ]
        assert len({lines[0].get_color() for lines in ends}) == 3
    names = [text.get_text() for text in fig.legends[0].texts]
    assert {"path of the hand", "ideal path to the can", "ideal path with the can"} <= {*names}
    assert [line.get_ydata()[-1] for line in sides[0].lines[2:3]] == [env.controller.hand[2]]
    plt.close(fig)


def test_baselines_lie_over_the_many_paths_of_rlihf(env):
    recordings = {"dense": [still(env)], "rlihf": [still(env), still(env)]}
    top, _ = paths_figure(env, recordings, ZONES).axes
    paths = [line for line in top.lines if len(line.get_xdata()) == 2 and line.get_lw() != 1]
    (dense,) = [line for line in paths if line.get_color() == color("dense")]
    rlihf = [line for line in paths if line.get_color() == color("rlihf")]
    assert len(rlihf) == 2
    for line in rlihf:
        assert line.get_zorder() < dense.get_zorder() and line.get_lw() < dense.get_lw()
        assert line.get_alpha() < 1 and not line.get_path_effects()
    assert dense.get_path_effects()


@pytest.mark.parametrize("name", OBSTACLES)
def test_obstacles_are_grey_and_hatched(drawing, name):
    (patch,) = (p for p in drawing["top"].patches if p.get_gid() == name)
    assert patch.get_hatch() and np.ptp(patch.get_facecolor()[:3]) == 0


def inside(kind, size, points):
    """Which points (n, 3), in a geom's frame, lie in it."""
    x, y, z = points.T
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return (np.abs(points) <= size).all(axis=1)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return ((points / size) ** 2).sum(axis=1) <= 1
    assert kind == mujoco.mjtGeom.mjGEOM_CYLINDER
    return (x**2 + y**2 <= size[0] ** 2) & (np.abs(z) <= size[1])


@pytest.fixture(scope="module")
def filled(env):
    """Points that fill each object as placed, metres, shape (n, 3)."""
    rng, model, data = np.random.default_rng(0), env.model, env.data
    filled = {}
    for name in (*OBSTACLES, "can"):
        (geom,) = env.workspace.geom_ids[name]
        points = rng.uniform(-0.1, 0.1, (3_000_000, 3))
        points = points[inside(model.geom_type[geom], model.geom_size[geom], points)]
        filled[name] = points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    # The goal: 9 cm across and 8 mm high, on the table.
    disc = rng.uniform([-0.045, -0.045, 0], [0.045, 0.045, 0.008], (100_000, 3))
    place = np.array([*env.workspace.placement["goal"][:2], TABLE_HEIGHT])
    filled["goal"] = disc[np.hypot(*disc.T[:2]) < 0.045] + place
    return filled


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("name", PLACES)
def test_outline_drawn_is_that_of_the_simulated_shape(drawing, filled, view, name):
    (patch,) = (p for p in drawing[view].patches if p.get_gid() == name)
    drawn, true = patch.get_xy()[:-1], filled[name][:, VIEWS[view]]
    for end in (np.min, np.max):
        np.testing.assert_allclose(end(drawn, axis=0), end(true, axis=0), atol=0.0015)
    outline = Path(ConvexHull(drawn).points[ConvexHull(drawn).vertices])
    assert outline.contains_points(true, radius=1e-5).mean() > 0.999
    assert ConvexHull(drawn).volume == pytest.approx(ConvexHull(true).volume, rel=0.06)
    assert patch.get_facecolor()[:3] == plt.matplotlib.colors.to_rgb(OBJECT_COLOURS[name])


def test_outlines_are_as_large_as_robosuites_meshes(env, drawing):
    stock = Workspace(fast=False)
    model = stock.sim.model._model
    for name in ("can", *OBSTACLES):
        vertices = []
        for geom in stock.geom_ids[name]:
            mesh, rotation = model.geom_dataid[geom], np.zeros(9)
            mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            points = model.mesh_vert[first : first + count]
            vertices.append(points @ rotation.reshape(3, 3).T + model.geom_pos[geom])
        size = np.ptp(np.vstack(vertices), axis=0)
        for view, axes in VIEWS.items():
            (patch,) = (p for p in drawing[view].patches if p.get_gid() == name)
            np.testing.assert_allclose(np.ptp(patch.get_xy(), axis=0), size[[*axes]], atol=0.004)
    stock.close()


@pytest.mark.parametrize("metres", ZONES)
def test_zones_are_as_wide_as_the_observer_says(drawing, filled, metres):
    zones = [p for p in drawing["top"].patches if p.get_gid() == f"{metres} m"]
    found = set()
    for zone in zones:
        for name in OBSTACLES:
            near = cKDTree(filled[name][:, VIEWS["top"]]).query(zone.get_xy())[0]
            if np.abs(near - metres).max() < 0.0015:
                found.add(name)
    assert found == set(OBSTACLES)
    labels = [line.get_label() for line in drawing["top"].lines]
    assert any(label.startswith(f"{100 * metres:.0f} cm") for label in labels)


@pytest.mark.parametrize("seed", range(4))
def test_names_in_the_picture_do_not_overlap(monkeypatch, seed):
    monkeypatch.setattr(figures_task, "scene", lambda _: np.zeros(PICTURE[:2]))
    figure = figures_task.task_figure(seed)
    figure.canvas.draw()
    picture = figure.axes[0]
    boxes = {text.get_text(): text.get_window_extent() for text in picture.texts}
    assert set(boxes) == {*PLACES, "hand"}
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes.values(), 2))
    plt.close(figure)


def test_points_of_the_world_are_found_in_the_picture(env):
    pixels = figures_task.scene(1)
    if pixels is None:
        pytest.skip("no OpenGL library here")
    assert pixels.shape == (*PICTURE[:2], 3)
    env.reset(seed=1)
    seen = {}
    for name in ("can", "lemon", "goal"):
        x, y = project(env.workspace.placement[name][None])[0].round().astype(int)
        seen[name] = pixels[y - 3 : y + 4, x - 3 : x + 4].mean(axis=(0, 1))
    assert seen["can"][0] > 2 * max(seen["can"][1:]), "red"
    assert min(seen["lemon"][:2]) > 1.3 * seen["lemon"][2], "yellow"
    assert np.ptp(seen["goal"]) < 0.1 and seen["goal"].mean() < 0.7, "grey"


@pytest.mark.parametrize("seed", range(4))
def test_names_of_objects_do_not_overlap(env, seed):
    env.reset(seed=seed)
    figure = draw(env)
    figure.canvas.draw()
    for ax in figure.axes:
        boxes = [text.get_window_extent() for text in ax.texts]
        assert len(boxes) == len(PLACES)
        assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    plt.close(figure)
