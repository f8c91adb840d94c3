"""The benchmark runs; how fast it finds things to be is not a test's business."""

from tests.benchmarks import policies


def test_environment_benchmark_gives_a_ratio_and_a_share():
    assert policies.env_speedup(repeats=1, steps=5) > 0
    assert 0 < policies.mujoco_share(repeats=1, steps=20) < 1


def test_learner_benchmark_trains_and_updates_both_learners():
    training, updating = policies.train_and_update_speedup(repeats=1, steps=5, updates=2)
    assert training > 0 and updating > 0


def test_feedback_benchmark_gives_a_ratio():
    assert policies.feedback_cost(repeats=1, steps=5) > 0
