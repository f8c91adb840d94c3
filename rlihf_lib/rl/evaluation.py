"""Rollouts of the deterministic policy and the metrics of each episode."""

from rlihf_lib.rl.rewards import PLACED, evaluation_reward


def rollout(env, act, seed):
    """Run one episode and judge it by the unified evaluation reward.

    Parameters
    ----------
    env : PickPlaceEnv
    act : callable
        Observation (n,) -> action (4,).
    seed : int
        Of the placement.

    Returns
    -------
    dict
        return (sum over the horizon; steps left after success count `PLACED` each), success,
        path_efficiency, path_deviation (m), collisions, min_clearance (m), completed, steps.
    """
    observation, _ = env.reset(seed=seed)
    total, done = 0.0, False
    while not done:
        observation, _, terminated, truncated, info = env.step(act(observation))
        total += evaluation_reward(info["moment"], env.path)
        done = terminated or truncated
    metrics = info["metrics"]
    if metrics["success"]:
        total += PLACED * (env.horizon - metrics["steps"])
    return {"return": total, **metrics}


def evaluate(env, model, seeds):
    """Roll the deterministic policy out once per seed.

    Parameters
    ----------
    env : PickPlaceEnv
    model : stable_baselines3.SAC
    seeds : iterable of int
        Placements, none of which is used in training.

    Returns
    -------
    list of dict
        One per rollout, as `rollout` gives them, numbered by `rollout`.
    """

    def act(observation):
        return model.predict(observation, deterministic=True)[0]

    return [{"rollout": i, **rollout(env, act, seed)} for i, seed in enumerate(seeds)]
