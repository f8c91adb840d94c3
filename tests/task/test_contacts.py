"""The environment's clearance against distances found, and proved, without MuJoCo's collisions.

Alternating projections, accelerated (FISTA with restarts), bring a pair of points of two convex
shapes together: their distance is an upper bound. The plane through one of them, perpendicular to
the line between them, has the one shape on its one side; how far the other reaches beyond gives a
lower bound. Iterated until the two are 10 um apart, for all states at once.
"""

import itertools
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial import cKDTree

from rlihf_lib.rl.evaluation import load_policy, rollout
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.scripted import expert_action
from rlihf_lib.task.workspace import OBSTACLES

ROOT = Path(__file__).parents[2]
CAP = 0.15  # metres up to which clearance is measured
GAP = 1e-5  # metres between the reference's bounds
TOLERANCE = 1e-4  # metres
BOX, CAPSULE, CYLINDER, ELLIPSOID = (
    getattr(mujoco.mjtGeom, f"mjGEOM_{name}")
    for name in ("BOX", "CAPSULE", "CYLINDER", "ELLIPSOID")
)


def nearest(kind, size, points):
    """Nearest points of a shape, in its own frame, shape (n, 3); of a capsule, of its segment."""
    x, y, z = points.T
    if kind == BOX:
        return np.clip(points, -size, size)
    if kind == CAPSULE:
        return np.stack([0 * x, 0 * y, np.clip(z, -size[1], size[1])], axis=1)
    if kind == CYLINDER:
        inwards = np.minimum(1, size[0] / np.maximum(np.hypot(x, y), 1e-12))
        return np.stack([inwards * x, inwards * y, np.clip(z, -size[1], size[1])], axis=1)
    assert kind == ELLIPSOID, f"no reference for {kind}"
    # The root of a convex, falling function, by Newton's method from its left.
    root = np.maximum((size * np.abs(points) - size**2).max(axis=1, keepdims=True), 0)
    for _ in range(15):
        part = (size * points / (size**2 + root)) ** 2
        slope = np.maximum(2 * (part / (size**2 + root)).sum(axis=1, keepdims=True), 1e-300)
        root = np.maximum(root + (part.sum(axis=1, keepdims=True) - 1) / slope, 0)
    return points * size**2 / (size**2 + root)


def reach(kind, size, along):
    """How far the shape, or the capsule's segment, reaches along directions (n, 3)."""
    if kind == BOX:
        return np.abs(along) @ size
    if kind == CAPSULE:
        return size[1] * np.abs(along[:, 2])
    if kind == CYLINDER:
        return size[0] * np.hypot(*along.T[:2]) + size[1] * np.abs(along[:, 2])
    return np.linalg.norm(size * along, axis=1)


class Shape:
    """A geom of a model in n poses: centres (n, 3) and rotations (n, 3, 3)."""

    def __init__(self, model, geom, centres, rotations):
        self.kind, self.size = model.geom_type[geom], model.geom_size[geom]
        self.radius = self.size[0] if self.kind == CAPSULE else 0.0
        self.centres, self.rotations = centres, rotations

    def nearest(self, points, rows):
        """Nearest points of the poses `rows`, (n, 3), in the world's frame."""
        centres, rotations = self.centres[rows], self.rotations[rows]
        local = np.einsum("nij,ni->nj", rotations, points - centres)
        return centres + np.einsum("nij,nj->ni", rotations, nearest(self.kind, self.size, local))

    def reach(self, along, rows):
        """How far it reaches, from the world's origin, along unit vectors (n, 3)."""
        local = np.einsum("nij,ni->nj", self.rotations[rows], along)
        return reach(self.kind, self.size, local) + (self.centres[rows] * along).sum(axis=1)


def distances(a, b):
    """Lower and upper bounds of the distances of two shapes, (n,), 0 where they overlap."""
    n = len(a.centres)
    low, high, rows = np.zeros(n), np.full(n, np.inf), np.arange(n)
    x = ahead = a.centres
    momentum = np.ones((n, 1))
    for step in range(1, 20_001):
        new = a.nearest(b.nearest(ahead, rows), rows)
        back = ((ahead - new) * (new - x)).sum(axis=1, keepdims=True) > 0
        momentum = np.where(back, 1, momentum)
        following = 0.5 + np.sqrt(0.25 + momentum**2)
        ahead = new + np.where(back, 0, (momentum - 1) / following) * (new - x)
        x, momentum = new, following
        if step % 10 == 0:
            way = b.nearest(x, rows) - x
            far = np.linalg.norm(way, axis=1)
            along = way / np.maximum(far, 1e-15)[:, None]
            beyond = a.reach(along, rows) - (along * x).sum(axis=1)
            rounded = far - a.radius - b.radius
            low[rows] = np.maximum(low[rows], rounded - beyond)
            high[rows] = np.minimum(high[rows], np.maximum(rounded, 0))
            left = high[rows] - low[rows] > GAP
            if not left.any():
                break
            rows, x, ahead, momentum = rows[left], x[left], ahead[left], momentum[left]
    return low, high


@pytest.fixture(scope="module")
def env():
    environment = PickPlaceEnv(horizon=60)
    yield environment
    environment.close()


@pytest.fixture(scope="module")
def geoms(env):
    """Those of the hand, of the can and of the obstacles that can touch."""
    model = env.model
    solid = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
    names = [model.geom(g).name for g in solid]
    hand, can, obstacles = (
        [g for g, name in zip(solid, names, strict=True) if name.startswith(prefix)]
        for prefix in ("gripper0", "can", OBSTACLES)
    )
    assert len(hand) == 10 and len(can) == 1 and len(obstacles) == 4
    return hand, can, obstacles


@pytest.fixture(scope="module")
def states(env):
    """Poses of all geoms, whether the can is held, and the environment's clearance, by source."""
    rng = np.random.default_rng(0)
    kept = {"expert": [], "policy": [], "random": []}

    def keep(source, clearance):
        poses = env.data.geom_xpos.copy(), env.data.geom_xmat.reshape(-1, 3, 3).copy()
        kept[source].append((*poses, env.grasped, clearance))

    def episode(source, act, seed, noise):
        for *_, info in rollout(env, lambda env: act(env) + rng.normal(0, noise, 4), seed):
            keep(source, info["moment"].clearance)

    seed = 0
    while len(kept["expert"]) < 700:
        episode("expert", expert_action, seed, noise=0.5 * (seed % 3))
        seed += 1
    actors = sorted(ROOT.glob("results/*/runs/*/actor.safetensors"))
    assert actors, "no trained policy in results/*/runs"
    for number, actor in enumerate(actors[:: -(-len(actors) // 8)]):
        policy = load_policy(actor.parent, env)
        for again in range(3):
            episode("policy", policy, 100_000 + 3 * number + again, noise=0.3 * again)
    while len(kept["random"]) < 1500:
        env.reset(seed=int(rng.integers(1000)))
        for _ in range(rng.integers(8)):
            env.step(rng.uniform(-1, 1, 4))
        for _ in range(5):
            for name in ("can", *OBSTACLES):
                address = env.workspace.qpos_address[name]
                turn = rng.normal(size=4)
                env.data.qpos[address : address + 3] = env.controller.hand + rng.normal(0, 0.12, 3)
                env.data.qpos[address + 3 : address + 7] = turn / np.linalg.norm(turn)
            mujoco.mj_kinematics(env.model, env.data)
            env.grasped = bool(rng.integers(2))
            keep("random", env.contacts.clearance(env.grasped))
    return kept


def reference(model, geoms, states):
    """Lower and upper bounds of the clearance of `states`, (n,) each."""
    hand, can, obstacles = geoms
    centres, rotations, held, _ = (np.array(part) for part in zip(*states, strict=True))
    bounds = np.full((2, len(states)), CAP)
    for pair in itertools.product(hand + can, obstacles):
        a, b = (Shape(model, g, centres[:, g], rotations[:, g]) for g in pair)
        closer = np.minimum(distances(a, b), bounds)
        bounds = np.where(held | (pair[0] in hand), closer, bounds)
    return bounds


def test_clearance_is_right_to_a_tenth_of_a_millimetre(env, geoms, states):
    touching = near = 0
    for source, kept in states.items():
        low, high = reference(env.model, geoms, kept)
        assert (high - low).max() <= GAP
        errors = np.array([clearance for *_, clearance in kept]) - (low + high) / 2
        worst = np.abs(errors).argmax()
        assert abs(errors[worst]) < TOLERANCE, (source, worst, errors[worst], high[worst])
        touching += (high < GAP).sum()
        near += (low > 0).sum() - (low == CAP).sum()
    assert sum(map(len, states.values())) >= 2000 and min(map(len, states.values())) >= 300
    assert touching >= 300 and near >= 1000


def surface(model, geom, rng, n=10_000):
    """Points on the surface of a geom, in its frame, shape (n, 3)."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    on_sphere = rng.normal(size=(n, 3))
    on_sphere /= np.linalg.norm(on_sphere, axis=1, keepdims=True)
    if kind == CAPSULE:
        return size[0] * on_sphere + np.outer(rng.uniform(-size[1], size[1], n), [0, 0, 1])
    if kind == ELLIPSOID:
        return size * on_sphere
    if kind == CYLINDER:
        flat = np.stack([np.hypot(*on_sphere.T[:2]) / size[0], np.abs(on_sphere[:, 2]) / size[1]])
        return on_sphere / flat.max(axis=0)[:, None]
    return on_sphere / (np.abs(on_sphere) / size).max(axis=1, keepdims=True)


def test_reference_agrees_with_points_on_the_surfaces(env, geoms, states):
    hand, can, obstacles = geoms
    rng = np.random.default_rng(1)
    points = {g: surface(env.model, g, rng) for g in hand + can + obstacles}
    some = [states["random"][i][:2] for i in range(0, 1500, 250)]
    centres, rotations = (np.array(part) for part in zip(*some, strict=True))
    apart = 0
    for pair in itertools.product(hand + can, obstacles):
        a, b = (Shape(env.model, g, centres[:, g], rotations[:, g]) for g in pair)
        for row, (low, high) in enumerate(zip(*distances(a, b), strict=True)):
            here, there = (centres[row, g] + points[g] @ rotations[row, g].T for g in pair)
            # With gaps of up to 6 mm between points, infinite if none is as near as it should be.
            sampled = cKDTree(there).query(here, distance_upper_bound=high + 0.006)[0].min()
            assert sampled > low - 1e-6
            assert sampled < np.inf or low == 0
            apart += low > 0
    assert apart > 100
