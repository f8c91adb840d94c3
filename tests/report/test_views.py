"""What a reader plays with: each picture tells the numbers of the person or value chosen."""

import numpy as np
import pytest

from rlihf_lib.eeg.preprocessing import Cohort, Preprocessing
from rlihf_lib.report import views
from rlihf_lib.report.evaluations import load_runs
from rlihf_lib.rl.evaluation import EVALUATION_SEEDS, load_policy, record
from rlihf_lib.study import Study
from rlihf_lib.task.gym_env import PickPlaceEnv

STUDY = Study()


@pytest.fixture(scope="module")
def runs():
    return load_runs(STUDY)


@pytest.fixture(scope="module")
def epochs():
    return Cohort("simulated", ["s02"], Preprocessing())["s02"]


def words(ax):
    return [text.get_text() for text in ax.texts]


def test_a_persons_waves_and_map_meet_at_the_largest_difference(epochs):
    waves, scalp = views.person_view(epochs, "Cz").axes[:2]
    labels = [line.get_label() for line in waves.lines[:2]]
    assert labels == [f"{name} ({len(epochs[name])} epochs)" for name in ("correct", "error")]
    (at,) = set(waves.lines[2].get_xdata())
    assert scalp.get_title().endswith(f"{at:.0f} ms")
    correct, error = (line.get_ydata() for line in waves.lines[:2])
    times = waves.lines[0].get_xdata()
    assert times[np.abs(error - correct).argmax()] == pytest.approx(at)
    with pytest.raises(ValueError, match="channel is 'Xz'; choose one of Fp1"):
        views.person_view(epochs, "Xz")


@pytest.mark.parametrize("threshold", [0.25, 0.5])
def test_a_thresholds_confusion_is_counted_from_the_table(threshold):
    table = STUDY.p_error().query("subject == 's11'")
    confusion = views.threshold_view(table, threshold).axes[1]
    said = table["p_error"] > threshold
    for text, (label, answer) in zip(
        words(confusion), [(0, False), (0, True), (1, False), (1, True)], strict=True
    ):
        count = ((table["label"] == label) & (said == answer)).sum()
        assert text.startswith(f"{count}\n")


def test_a_phases_table_holds_the_means_of_the_person_chosen(runs):
    table = views.phase_view(runs, "s11", "Late").axes[1]
    (cells,) = table.tables
    late = runs[(runs["phase"] == "Late") & (runs["subject"] == "s11")]
    assert cells[1, 2].get_text().get_text() == f"{late['success'].mean():.2f}"


def test_a_weights_paths_and_clearance_are_drawn_beside_those_of_dense_reward():
    runs = load_runs(STUDY, ["dense", "ablation"])
    env = PickPlaceEnv(60)
    paths = {
        key: [record(env, load_policy(STUDY.runs / run, env), EVALUATION_SEEDS)]
        for key, run in (("dense", "dense-seed0"), (0.4, "rlihf-w0.4-s11-seed0"))
    }
    env.reset(seed=EVALUATION_SEEDS)
    top, clearance = views.weight_view(env, paths, runs, 0.4).axes
    drawn = [line.get_xydata().shape for line in top.lines]
    assert (len(paths[0.4][0].hand), 2) in drawn
    late = runs[(runs["phase"] == "Late") & (runs["w_hf"] == 0.4) & (runs["group"] == "rlihf")]
    mean = 100 * late.groupby("run")["clearance"].mean().mean()
    assert clearance.lines[-1].get_ydata()[0] == pytest.approx(mean)
