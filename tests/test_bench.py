"""The benchmark runs; how fast it finds things to be is not a test's business."""

from rlihf_lib import bench


def test_environment_benchmark_gives_a_ratio_and_a_share():
    assert bench.env_speedup(repeats=1, steps=5) > 0
    assert 0 < bench.mujoco_share(repeats=1, steps=20) < 1


def test_learner_benchmark_trains_and_updates_both_learners():
    training, updating = bench.train_and_update_speedup(repeats=1, steps=5, updates=2)
    assert training > 0 and updating > 0


def test_feedback_benchmark_gives_a_ratio():
    assert bench.feedback_cost(repeats=1, steps=5) > 0
