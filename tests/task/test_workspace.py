"""Placement, sleep, and the can: it stands or falls, and stays standing where it was placed."""

import json
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.rl.evaluation import load_policy, rollout
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.scripted import expert_action
from rlihf_lib.task.workspace import PLACED_WITHIN, TABLE_HEIGHT, Workspace

ROOT = Path(__file__).parents[2]
HOLD, LEAVE = np.array([0, 0, 0, -1.0]), np.array([0, 0, 1.0, -1.0])
UP = np.array([0, 0, 1.0])
FREE = (0.2, 0.25)  # a place on the table with nothing near, metres


@pytest.fixture(scope="module", params=[True, False], ids=["fast", "stock"])
def world(request):
    environment = PickPlaceEnv(workspace=Workspace(fast=request.param))
    yield environment
    environment.close()


def tilt(env):
    """Angle between the can's axis and the vertical, degrees."""
    axis = env.data.xmat[env.workspace.body_ids["can"]].reshape(3, 3)[:, 2]
    return np.degrees(np.arctan2(np.hypot(axis[0], axis[1]), axis[2]))


def lowest(env):
    """Height of the can's lowest point, metres."""
    (geom,) = env.workspace.geom_ids["can"]
    centre, rotation = env.data.geom_xpos[geom], env.data.geom_xmat[geom].reshape(3, 3)
    mesh = env.model.geom_dataid[geom]
    if env.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        first, count = env.model.mesh_vertadr[mesh], env.model.mesh_vertnum[mesh]
        points = env.model.mesh_vert[first : first + count]
    else:
        radius, half = env.model.geom_size[geom][:2]
        turn = np.linspace(0, 2 * np.pi, 361)
        rim = radius * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
        points = np.vstack([rim - half * UP, rim + half * UP])
    return centre[2] + (points @ rotation[2]).min()


def release(env, degrees, azimuth):
    """Let the can go, leaning, and return how it leans half a second later, degrees."""
    env.reset(seed=0)
    address = env.workspace.qpos_address["can"]
    half = np.radians(degrees) / 2
    turn = [np.cos(half), *np.sin(half) * np.array([np.cos(azimuth), np.sin(azimuth), 0])]
    env.data.qpos[address : address + 7] = [*FREE, TABLE_HEIGHT, *turn]
    mujoco.mj_kinematics(env.model, env.data)
    env.data.qpos[address + 2] += TABLE_HEIGHT - lowest(env)
    mujoco.mj_kinematics(env.model, env.data)
    assert lowest(env) == pytest.approx(TABLE_HEIGHT) and tilt(env) == pytest.approx(degrees)
    for _ in range(5):
        env.controller.advance(HOLD)
    return tilt(env)


@pytest.mark.parametrize("degrees", [3, 6, 10, 17, 25])
def test_can_let_go_leaning_stands_up_within_half_a_second(world, degrees):
    assert max(release(world, degrees, azimuth) for azimuth in (0.3, 2, 4)) < 1


def test_can_let_go_leaning_too_far_falls(world):
    assert min(release(world, 40, azimuth) for azimuth in (0.3, 2, 4)) > 60


def trained():
    """Folders of shipped runs, dense and of feedback, that end up placing the can."""
    for actor in sorted(ROOT.glob("results/*/runs/*/actor.safetensors")):
        config = json.loads((actor.parent / "config.json").read_text())
        evaluation = pd.read_csv(actor.parent / "eval.csv")
        late = evaluation[evaluation["step"] > 0.8 * evaluation["step"].max()]
        if config["condition"] in ("dense", "rlihf") and late["success"].mean() >= 0.8:
            yield actor.parent


def place(env, act, seed):
    """Run an episode; after a success leave upwards and wait.

    Returns
    -------
    dict or None
        None without success; else degrees, metres, seconds at the success and two seconds later.
    """
    *_, (*_, info) = rollout(env, act, seed)
    if not info["is_success"]:
        return None
    dof = env.model.joint(env.workspace.objects[0].joints[0]).dofadr[0]
    velocity = env.data.qvel[dof : dof + 6]
    names = [{env.model.geom(g).name for g in pair} for pair in env.data.contact.geom]
    outcome = {
        "touched": any("can_g0" in pair and "gripper0" in str(pair) for pair in names),
        "tilt": tilt(env),
        "speed": np.linalg.norm(velocity[:3]),
        "spin": np.linalg.norm(velocity[3:]),
    }
    for action in 10 * [LEAVE] + 10 * [HOLD]:
        env.controller.advance(action)
    away = np.linalg.norm(env.body("can")[:2] - env.workspace.placement["goal"][:2])
    return outcome | {
        "left": env.controller.hand[2] - env.body("can")[2],
        "after": tilt(env),
        "away": away,
    }


@pytest.fixture(scope="module")
def placed():
    """What became of the successes of the expert and of trained policies."""
    env = PickPlaceEnv(horizon=60)
    outcomes = {"expert": [place(env, expert_action, seed) for seed in range(20)]}
    folders = list(trained())
    assert folders, "no trained policy in results/*/runs places the can"
    folders = folders[:: -(-len(folders) // 8)]
    outcomes["policies"] = [
        place(env, policy, seed)
        for number, policy in enumerate(load_policy(folder, env) for folder in folders)
        for seed in range(1000 * (number + 1), 1000 * (number + 1) - (-24 // len(folders)))
    ]
    env.close()
    return {
        who: pd.DataFrame([outcome for outcome in some if outcome])
        for who, some in outcomes.items()
    }


@pytest.mark.parametrize("who", ["expert", "policies"])
def test_success_means_let_go_upright_and_at_rest(placed, who):
    assert len(placed[who]) >= 12
    assert not placed[who]["touched"].any()
    assert placed[who]["tilt"].max() < 5
    assert placed[who]["speed"].max() < 0.02 and placed[who]["spin"].max() < 0.3


@pytest.mark.parametrize("who", ["expert", "policies"])
def test_can_placed_stands_on_the_goal_when_the_hand_has_left(placed, who):
    standing = (placed[who]["after"] < 2) & (placed[who]["away"] < PLACED_WITHIN)
    assert len(standing) >= 12 and placed[who]["left"].min() > 0.05
    assert standing.mean() >= 0.95


def test_a_joint_at_zero_starts_at_plus_zero_whatever_robosuite_draws():
    world = Workspace(fast=False)
    world.rng = SimpleNamespace(standard_normal=lambda n: -np.ones(n))
    world.reset()
    qpos = world.sim.data._data.qpos
    assert (qpos == 0).any() and not np.signbit(qpos[qpos == 0]).any()


def test_fast_reset_leaves_the_state_that_robosuites_own_reset_leaves():
    env = PickPlaceEnv()
    workspace, parts = env.workspace, mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty((2, mujoco.mj_stateSize(env.model, parts)))
    for reset, row in zip((workspace.reset, super(Workspace, workspace).reset), state, strict=True):
        list(rollout(env, expert_action, 4))
        workspace.reseed(7)
        reset()
        mujoco.mj_getState(env.model, env.data, row, parts)
    np.testing.assert_array_equal(*state)


def test_an_object_sleeps_until_touched_and_then_moves_as_if_it_had_been_awake():
    def push(sleep):
        """Push the bottle along x from beside it; return its places and whether it slept."""
        env = PickPlaceEnv()
        env.reset(seed=0)
        if not sleep:
            env.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        address = env.workspace.qpos_address["bottle"]
        env.data.qpos[address : address + 2] = env.controller.hand[:2] + np.array([0.12, 0.01])
        lemon = env.workspace.qpos_address["lemon"]  # stands there, and rolls as it likes
        env.data.qpos[lemon : lemon + 2] = [0.25, 0.25]
        tree = env.model.body_treeid[env.workspace.body_ids["bottle"]]
        places, asleep = [], []
        for step in range(16):
            env.step(np.array([0, 0, -1, 0] if step < 6 else [1, 0, 0, 0]))
            places.append(env.body("bottle"))
            asleep.append(env.data.tree_asleep[tree] >= 0)
        return np.array(places), asleep

    (slept, asleep), (awake, never) = push(sleep=True), push(sleep=False)
    assert asleep[5] and not asleep[-1] and not any(never)
    assert np.linalg.norm(awake[-1] - awake[5]) > 0.05
    assert np.linalg.norm(slept - awake, axis=1).max() < 0.005
