"""Figures of the decoder, from the tables that are shipped."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_decoder
from rlihf_lib.study import Study

STUDY = Study()


@pytest.fixture
def scores():
    return STUDY.scores()


def test_figure_5_is_a_pair_of_bars_a_subject_and_their_mean(scores):
    (ax,) = figures_decoder.figure_5(scores).axes
    pretrain, online = ax.containers[:2]
    heights = [bar.get_height() for bar in online]
    assert heights == pytest.approx([*scores["accuracy_online"], scores["accuracy_online"].mean()])
    assert pretrain[0].get_x() < online[0].get_x() < pretrain[1].get_x()
    (arms,) = ax.containers[2][2]
    ends = np.array([segment[:, 1] for segment in arms.get_segments()])
    of_people = scores[["accuracy_online_low", "accuracy_online_high"]]
    np.testing.assert_allclose(ends[:-1], of_people)
    assert ends[-1, 0] < scores["accuracy_online"].mean() < ends[-1, 1], "over people"
    two = figures_decoder.figure_5(scores.iloc[:2]).axes[0].containers[2][2][0].get_segments()
    assert len([ends for ends in two if ends.size]) == 2, "two people's mean has none"


def test_subjects_are_ranked_by_how_well_they_are_decoded(scores):
    for ax in figures_decoder.scores_figure(scores).axes:
        names = [tick.get_text() for tick in ax.get_xticklabels()]
        assert names == scores.sort_values("auroc")["subject"].tolist()


def test_a_line_a_subject_and_their_mean_with_its_interval():
    updates = pd.read_csv(STUDY.tables / "online_update.csv")
    ax = figures_decoder.online_update_figure(updates).axes[2]
    n_people = updates["subject"].nunique()
    mean = updates.groupby("n_events")["auroc"].mean()
    assert (np.ptp([line.get_ydata()[0] for line in ax.lines[:n_people]])) > 0.2
    ((drawn, _, (arms,)),) = ax.containers
    np.testing.assert_allclose(drawn.get_ydata().astype(float), mean)
    for segment, value in zip(arms.get_segments(), mean, strict=True):
        assert segment[0, 1] < value < segment[1, 1]
    one = updates[updates["n_events"] == 0]
    (ax,) = figures_decoder.channels_figure({"EEG": one, "EOG only": one}).axes
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["EEG", "EOG only"]
    few = one[one["subject"].isin(["s02", "s03"])]
    (ax,) = figures_decoder.channels_figure({"EEG": few}).axes
    assert not ax.containers[0][2][0].get_segments()[0].size, "two people have no interval"


def test_reliability_shows_all_epochs_before_and_after_scaling():
    upper, lower = figures_decoder.reliability_figure(STUDY.p_error()).axes
    assert upper.get_legend_handles_labels()[1] == ["Perfect", "Raw", "Temperature-scaled"]
    assert [patch.get_data().values.sum() for patch in lower.patches] == pytest.approx([1, 1])


def test_each_filter_has_a_panel_of_auroc_against_latency():
    people = [(f"s{i}", end, 0.6 + 0.02 * i + 0.1 * end) for i in range(6) for end in (0.4, 1.0)]
    causal = pd.DataFrame(people, columns=["subject", "window", "auroc"])
    tables = {"both ways": causal, "causal": causal.assign(auroc=causal["auroc"] - 0.02)}
    left, right = figures_decoder.latency_figure(tables).axes
    assert (left.get_title(), right.get_title()) == ("both ways", "causal")
    drawn = [np.asarray(ax.containers[0][0].get_ydata(), float) for ax in (left, right)]
    np.testing.assert_allclose(drawn, [[0.69, 0.75], [0.67, 0.73]])
