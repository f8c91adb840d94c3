"""The scripted expert."""

import pandas as pd

from rlihf_lib.rl.evaluation import evaluate
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.scripted import expert_action
from rlihf_lib.task.workspace import Workspace


def test_expert_places_the_can_on_at_least_95_of_100_placements(env):
    metrics = pd.DataFrame(evaluate(env, expert_action, range(100)))
    placed = metrics[metrics["success"] == 1]
    assert len(placed) >= 95
    assert placed["path_efficiency"].mean() > 0.85
    assert placed["path_deviation"].mean() < 0.03
    assert placed["collisions"].sum() == 0


def test_expert_succeeds_at_the_same_rate_with_robosuites_own_step(env):
    stock = PickPlaceEnv(horizon=120, workspace=Workspace(fast=False))
    for e in (env, stock):
        assert sum(row["success"] for row in evaluate(e, expert_action, range(8))) >= 7
