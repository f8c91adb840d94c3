"""Who watches: what looks wrong, and which epochs answer."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from sklearn.metrics import roc_auc_score

from rlihf_lib.rl.evaluation import rollout
from rlihf_lib.rl.feedback import perfect_table, synthetic_table
from rlihf_lib.rl.observer import Observer, comfort, lay_observer, path_observer
from rlihf_lib.rl.runs import RunConfig
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.scripted import expert_action
from tests.rl.conftest import moment


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({}, 0),
        ({"remaining": 0.52}, 1),  # no progress
        ({"remaining": 0.52 - 0.006}, 0.6),  # a fifth of the full speed
        ({"remaining": 0.5, "best": 0.45}, 1),  # making up for lost ground
        ({"clearance": 0.02}, 1),
        ({"clearance": 0.035}, 0.5),
        ({"clearance": 0.035, "remaining": 0.52 - 0.006}, 0.8),
        ({"clearance": 0.05}, 0),
        ({"collided": True}, 1),
        ({"lost": True}, 1),
        ({"success": True, "remaining": 0.0}, 0),
    ],
)
def test_observer_sees_standing_still_lost_ground_and_closeness_as_wrong(changes, wrong):
    assert path_observer(moment(**changes)) == pytest.approx(wrong)


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({}, 0),
        ({"remaining": 0.9, "best": 0.1, "deviation": 0.5}, 0),  # knows no ideal path
        ({"nearer": 0.0}, 1),
        ({"nearer": 0.006}, 0.6),
        ({"clearance": 0.035}, 0.5),
        ({"tilt": 0.6}, 1),
        ({"dropped": True}, 1),
        ({"collided": True}, 1),
        ({"lost": True}, 1),
        ({"success": True, "nearer": 0.0}, 0),
    ],
)
def test_lay_observer_sees_what_comes_nearer_tilts_drops_or_comes_too_close(changes, wrong):
    assert lay_observer(moment(**changes)) == pytest.approx(wrong)


def test_comfort_grows_from_2_to_5_centimetres():
    assert [comfort(c) for c in (0.0, 0.02, 0.035, 0.05, 0.15)] == pytest.approx([0, 0, 0.5, 1, 1])


def test_observer_answers_with_epochs_of_the_class_it_saw():
    table = pd.DataFrame(
        {"epoch": range(4), "label": [0, 0, 1, 1], "p_error": [0.1, 0.2, 0.8, 0.9]}
    )
    observer = Observer(table, np.random.default_rng(0))
    assert set(observer.watch(moment(), 30)) == {0.1, 0.2}
    assert set(observer.watch(moment(lost=True), 30)) == {0.8, 0.9}
    assert observer.errors_seen == 1


def test_observer_draws_from_the_part_of_the_session_that_is_on():
    table = pd.DataFrame({"epoch": range(8), "label": [0, 1] * 4, "p_error": np.arange(8) / 10})
    observer = Observer(table, np.random.default_rng(0), lambda moment: 1.0, parts=2)
    for share, expected in (
        (0.01, {0.1, 0.3}),
        (0.49, {0.1, 0.3}),
        (0.5, {0.5, 0.7}),
        (1.0, {0.5, 0.7}),
    ):
        observer.share = share
        assert set(observer.watch(moment(), 50)) == expected
    with pytest.raises(ValueError, match="no epoch of class 'correct'"):
        Observer(table, np.random.default_rng(0), parts=8)


def test_observer_notices_slow_progress_as_often_as_the_rule_says():
    observer = Observer(perfect_table(), np.random.default_rng(0))
    seen = [observer.watch(moment(remaining=0.52 - 0.006))[0] for _ in range(2000)]
    assert np.mean(seen) == pytest.approx(0.6, abs=0.03)


def test_observer_needs_both_classes():
    table = pd.DataFrame({"epoch": [0], "label": [0], "p_error": [0.1]})
    with pytest.raises(ValueError, match="class 'error'"):
        Observer(table, np.random.default_rng(0))


@pytest.mark.parametrize(("observer", "share"), [(path_observer, 0.1), (lay_observer, 0.25)])
def test_expert_mostly_looks_right(observer, share):
    env = PickPlaceEnv(200, RunConfig.patience)
    wrong = [
        observer(info["moment"])
        for seed in range(25)
        for *_, info in rollout(env, expert_action, seed)
    ]
    assert np.mean(wrong) < share


@pytest.mark.parametrize("d_prime", [0.0, 1.0, 2.5])
def test_synthetic_decoder_is_as_good_as_asked_for_and_calibrated(d_prime):
    table, prior = synthetic_table(d_prime, 0.2), 0.2
    known = norm.cdf(d_prime / np.sqrt(2))
    assert roc_auc_score(table["label"], table["p_error"]) == pytest.approx(known, abs=0.005)
    right, wrong = table.groupby("label")["p_error"].mean()
    assert (1 - prior) * right + prior * wrong == pytest.approx(prior, abs=0.005)
    assert len(table) == table["epoch"].nunique() and table["p_error"].between(0, 1).all()
