"""The environment: interface, seeding, and how a step is judged."""

import numpy as np
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

from rlihf_lib.rl.evaluation import rollout
from rlihf_lib.task.gym_env import N_OBSERVATIONS, PickPlaceEnv
from rlihf_lib.task.scripted import expert_action, sit_still


def test_environment_passes_both_checkers(env):
    gymnasium_check(env, skip_render_check=True)
    sb3_check(env)


def test_observation_has_the_documented_size(env):
    observation, _ = env.reset(seed=0)
    assert observation.shape == (N_OBSERVATIONS,)
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


def test_patience_truncates_a_robot_that_is_stuck_and_spares_one_that_gets_on():
    env = PickPlaceEnv(horizon=200, patience=10)
    env.reset(seed=1)
    ends = [env.step(np.array([0, 0, 1, -1]))[2:4] for _ in range(12)]
    assert (False, True) in ends and not any(terminated for terminated, _ in ends)
    *_, (*_, info) = rollout(env, expert_action, 1)
    assert info["is_success"] and env.steps > 10


def test_horizon_truncates_and_does_not_terminate():
    env = PickPlaceEnv(horizon=5)
    *_, (*_, terminated, truncated, info) = rollout(env, sit_still, 0)
    assert truncated and not terminated
    assert info["metrics"]["steps"] == 5 and info["metrics"]["success"] == 0


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


def test_can_in_the_air_is_held_until_it_leaves_the_hand(env):
    env.reset(seed=0)
    while not env.lifted:
        env.step(expert_action(env))
    # Widened by a centimetre, the hand may lose a contact, not the can.
    assert env.step(np.array([0, 0, 0, 0.3]))[-1]["moment"].grasped
    address = env.workspace.qpos_address["can"]
    env.data.qpos[address : address + 3] += [0.15, 0, 0]
    assert not env.step(np.array([0, 0, 0, 1.0]))[-1]["moment"].grasped
