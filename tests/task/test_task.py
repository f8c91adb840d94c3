"""The real robosuite scene: interface, seeding, physics, expert, path."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

from rlihf_lib.task.expert import expert_action
from rlihf_lib.task.gym_env import OBSERVATION, PickPlaceEnv
from rlihf_lib.task.path import RELEASE_WORTH, IdealPath, Polyline, path_efficiency
from rlihf_lib.task.workspace import Workspace

CAN, GOAL, HAND = [-0.07, -0.2, 0.84], [-0.07, 0.2, 0.84], [-0.19, -0.15, 1.0]


@pytest.fixture(scope="module")
def env():
    environment = PickPlaceEnv(horizon=120)
    yield environment
    environment.close()


def episode(env, seed, act=expert_action):
    """Run one episode; return its moments, its last flags and its metrics."""
    env.reset(seed=seed)
    moments, done = [], False
    while not done:
        _, _, terminated, truncated, info = env.step(act(env))
        moments.append(info["moment"])
        done = terminated or truncated
    return moments, terminated, truncated, info["metrics"]


def test_environment_passes_both_checkers(env):
    gymnasium_check(env, skip_render_check=True)
    sb3_check(env)


def test_observation_has_the_documented_size(env):
    observation, _ = env.reset(seed=0)
    assert observation.shape == (sum(size for _, size, _ in OBSERVATION),)
    assert np.isfinite(observation).all()


def test_seed_decides_the_placements_and_the_whole_episode(env):
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (20, 4))

    def run(seed):
        first, _ = env.reset(seed=seed)
        return [first, *(env.step(action)[0] for action in actions)]

    once, again, other = run(5), run(5), run(6)
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(once[0], other[0])


def test_later_resets_draw_new_placements_from_the_seed(env):
    def placements():
        first = env.reset(seed=3)[0]
        return np.array([first, env.reset()[0], env.reset()[0]])

    drawn = placements()
    assert not np.array_equal(drawn[1], drawn[2])
    np.testing.assert_array_equal(drawn, placements())


def test_fast_reset_leaves_the_state_that_robosuites_own_reset_leaves(env):
    workspace, parts = env.workspace, mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty((2, mujoco.mj_stateSize(env.model, parts)))
    for reset, row in zip((workspace.reset, super(Workspace, workspace).reset), state, strict=True):
        episode(env, 4)
        workspace.reseed(7)
        reset()
        mujoco.mj_getState(env.model, env.data, row, parts)
    np.testing.assert_array_equal(*state)


def test_patience_truncates_a_robot_that_is_stuck_and_spares_one_that_gets_on():
    env = PickPlaceEnv(horizon=200, patience=10)
    env.reset(seed=1)
    ends = [env.step(np.array([0, 0, 1, -1]))[2:4] for _ in range(12)]
    assert (False, True) in ends and not any(terminated for terminated, _ in ends)
    env.reset(seed=1)
    done = False
    while not done:
        *_, terminated, truncated, info = env.step(expert_action(env))
        done = terminated or truncated
    assert info["is_success"] and env.steps > 10


def test_horizon_truncates_and_does_not_terminate():
    env = PickPlaceEnv(horizon=5)
    _, terminated, truncated, metrics = episode(env, 0, lambda _: np.zeros(4))
    assert truncated and not terminated
    assert metrics["steps"] == 5 and metrics["success"] == 0


def test_expert_places_the_can_on_at_least_95_of_100_placements(env):
    results = [episode(env, seed) for seed in range(100)]
    metrics = [m for *_, m in results]
    assert sum(m["success"] for m in metrics) >= 95
    assert all(terminated for (_, terminated, _, m) in results if m["success"])
    placed = [m for m in metrics if m["success"]]
    assert np.mean([m["path_efficiency"] for m in placed]) > 0.85
    assert np.mean([m["path_deviation"] for m in placed]) < 0.03
    assert sum(m["collisions"] for m in placed) == 0


def test_can_knocked_off_the_table_ends_the_episode(env):
    env.reset(seed=0)
    address = env.workspace.qpos_address["can"]
    env.data.qpos[address : address + 3] = [0.0, 0.6, 0.84]
    *_, terminated, truncated, info = env.step(np.zeros(4))
    assert terminated and not truncated
    assert info["moment"].lost and not info["moment"].success


def test_pushing_the_can_to_the_goal_is_not_placing_it(env):
    env.reset(seed=0)
    address = env.workspace.qpos_address["can"]
    env.data.qpos[address : address + 2] = env.goal[:2]
    *_, terminated, _, info = env.step(np.zeros(4))
    assert not info["moment"].success and not terminated


def test_can_dropped_onto_the_goal_is_not_placed(env):
    env.reset(seed=0)
    while not (env.lifted and np.linalg.norm(env.body("can")[:2] - env.goal[:2]) < 0.01):
        env.step(expert_action(env))
    assert env.body("can")[2] > env.goal[2] + 0.05
    for _ in range(8):
        *_, terminated, _, info = env.step(np.array([0, 0, 0.5, -1.0]))
    assert np.linalg.norm(env.body("can")[:2] - env.goal[:2]) < 0.04
    assert not info["moment"].success and not terminated


def test_touching_an_obstacle_is_a_collision(env):
    env.reset(seed=0)
    address = env.workspace.qpos_address["bottle"]
    env.data.qpos[address : address + 2] = env.controller.hand[:2]
    moments = [env.step(np.array([0, 0, -1, 0]))[-1]["moment"] for _ in range(8)]
    assert not moments[0].collided and moments[0].clearance > 0
    assert any(m.collided for m in moments) and min(m.clearance for m in moments) == 0


def test_fast_control_moves_the_hand_as_robosuites_own_step_does(env):
    stock = PickPlaceEnv(workspace=Workspace(fast=False))
    env.reset(seed=3), stock.reset(seed=3)
    rng = np.random.default_rng(0)
    distances = []
    for step in range(60):
        if step % 10 == 0:
            action = np.append(rng.uniform(-1, 1, 3), -1)
        # Stay over the objects: contacts magnify the smallest difference.
        action[2] = np.clip((1.05 - env.controller.goal_pos[2]) * 10, -1, 1)
        env.controller.advance(action), stock.controller.advance(action)
        distances.append(np.linalg.norm(env.controller.hand - stock.controller.hand))
    assert np.ptp([env.controller.goal_pos, stock.controller.goal_pos], axis=0).max() < 0.005
    assert max(distances) < 0.004


def test_expert_succeeds_at_the_same_rate_with_robosuites_own_step(env):
    stock = PickPlaceEnv(horizon=120, workspace=Workspace(fast=False))
    placed = [[episode(e, seed)[-1]["success"] for seed in range(8)] for e in (env, stock)]
    assert min(np.sum(placed, axis=1)) >= 7


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


def test_remaining_path_falls_along_the_ideal_path():
    path = IdealPath(HAND, CAN, GOAL)
    reach = [path.remaining(p, np.array(CAN), False, 0.0) for p in _walk(path.reach)]
    carry = [path.remaining(p, p, True, 1.0) for p in _walk(path.carry)]
    assert np.diff(reach).max() < 1e-9 and np.diff(carry).max() < 1e-9
    assert reach[-1] > carry[0] and carry[-1] == pytest.approx(RELEASE_WORTH)
    end = path.carry[-1]
    opening = [path.remaining(end, end, True, c, delivered=True) for c in (1, 0.5, 0)]
    assert opening == pytest.approx([RELEASE_WORTH, RELEASE_WORTH / 2, 0])
    assert carry[0] == pytest.approx(path.carry_length + RELEASE_WORTH)


def test_ideal_path_itself_has_efficiency_one_and_deviation_zero():
    path = IdealPath(HAND, CAN, GOAL)
    walk = np.vstack([_walk(path.reach), _walk(path.carry)])
    assert path_efficiency(path.length, Polyline(walk).length, 1.0) == pytest.approx(1)
    assert max(path.deviation(p) for p in walk) < 1e-6


def test_closing_brings_nearer_where_it_grasps_and_squeezing_where_the_can_is_held():
    path, can = IdealPath(HAND, CAN, GOAL), np.array(CAN)

    def gain(height, grasped):
        hand = can + height * np.array([0, 0, 1])
        return np.subtract(*(path.remaining(hand, can, grasped, c) for c in (0.0, 1.0)))

    assert gain(0.03, grasped=False) == pytest.approx(0.05)
    assert gain(0.09, grasped=False) == pytest.approx(-0.05)
    assert gain(0.0, grasped=True) == pytest.approx(0.05)


def test_pushing_the_can_makes_the_way_longer_but_never_shorter():
    path, can, along = IdealPath(HAND, CAN, GOAL), np.array(CAN), np.array([0, 0.1, 0])
    here, on, off = (
        path.remaining(where, where, False, 1.0) for where in (can, can + along, can - along)
    )
    assert on == pytest.approx(here) and off > here + 0.1


def test_can_in_the_air_is_held_until_it_leaves_the_hand(env):
    env.reset(seed=0)
    while not env.lifted:
        env.step(expert_action(env))
    # Widened by a centimetre, the hand may lose a contact, not the can.
    assert env.step(np.array([0, 0, 0, 0.3]))[-1]["moment"].grasped
    address = env.workspace.qpos_address["can"]
    env.data.qpos[address : address + 3] += [0.15, 0, 0]
    assert not env.step(np.array([0, 0, 0, 1.0]))[-1]["moment"].grasped


def test_hand_is_open_and_closed_before_the_command_reaches_its_end(env):
    for command, closed in ((-0.7, 0), (0.7, 1)):
        env.reset(seed=0)
        for _ in range(5):
            env.step(np.array([0, 0, 0, command]))
        assert env.squeeze() == pytest.approx(closed)


def test_standing_still_and_detours_are_not_efficient():
    assert path_efficiency(1.0, 0.0, 0.0) == 0
    assert path_efficiency(1.0, 2.0, 1.0) == 0.5
    assert path_efficiency(1.0, 0.5, 0.1) == pytest.approx(0.2)


def test_straight_line_from_can_to_goal_is_longer_than_the_ideal_path_says():
    path = IdealPath(HAND, CAN, GOAL)
    middle = np.array([-0.07, 0.0, 0.84])
    assert path.remaining_carry(middle) > 0.9 * path.carry_length / 2


def _walk(vertices):
    """Points every 5 mm along a polyline."""
    return np.vstack(
        [np.linspace(a, b, 1 + int(np.linalg.norm(b - a) / 0.005)) for a, b in pairwise(vertices)]
    )
