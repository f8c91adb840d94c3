"""Figures of the decoder, from the tables that are shipped."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.eeg.scores import reliability
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
    (majority,) = [c for c in ax.collections if c.get_label() == "Always the majority class"]
    for (start, end), bar, share in zip(
        majority.get_segments(), online, [*scores["majority"], scores["majority"].mean()],
        strict=True,
    ):  # fmt: skip
        assert [start[0], end[0]] == pytest.approx([bar.get_x(), bar.get_x() + bar.get_width()])
        assert start[1] == end[1] == pytest.approx(share)


def test_subjects_are_ranked_by_how_well_they_are_decoded(scores, legend):
    fig = figures_decoder.scores_figure(scores)
    ranked = scores.sort_values("auroc")
    luck = legend(fig.axes[1])["95th percentile of chance (permuted labels)"]
    np.testing.assert_array_equal(luck.get_ydata(), ranked["balanced_accuracy_chance"])
    for ax in fig.axes:
        assert set(legend(ax)["Chance"].get_ydata()) == {0.5}
        names = [tick.get_text() for tick in ax.get_xticklabels()]
        assert names == scores.sort_values("auroc")["subject"].tolist()


def test_updates_are_drawn_as_each_persons_change_and_its_mean_with_its_interval():
    updates = pd.read_csv(STUDY.tables / "online_update.csv")
    fig = figures_decoder.online_update_figure(updates)
    ax = fig.axes[2]
    auroc = updates.pivot(index="n_events", columns="subject", values="auroc")
    change = auroc - auroc.loc[0]
    drawn = np.array([line.get_ydata() for line in ax.lines[: len(auroc.columns)]])
    np.testing.assert_allclose(drawn.T, change)
    ((mean, _, (arms,)),) = ax.containers
    np.testing.assert_allclose(mean.get_ydata().astype(float), change.mean(axis=1))
    for segment, value in list(zip(arms.get_segments(), change.mean(axis=1), strict=True))[1:]:
        assert segment[0, 1] < value < segment[1, 1]
    assert ax.get_title() == f"AUROC ({auroc.loc[0].mean():.2f} at N = 0)"
    assert len({ax.get_ylim() for ax in fig.axes}) == 1


def test_channel_sets_are_joined_for_each_person_not_for_the_mean():
    updates = pd.read_csv(STUDY.tables / "online_update.csv")
    one = updates[updates["n_events"] == 0]
    (ax,) = figures_decoder.channels_figure({"EEG": one, "EOG only": one}).axes
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["EEG", "EOG only"]
    people, ((mean, *_),) = ax.lines[: len(one)], ax.containers
    assert {line.get_linestyle() for line in people} == {"-"} and mean.get_linestyle() == "None"
    np.testing.assert_allclose(np.asarray(mean.get_ydata(), float), [one["auroc"].mean()] * 2)
    assert mean.get_color() != figures_decoder.COLORS["online"], "LDA, not EEGNet"
    few = one[one["subject"].isin(["s02", "s03"])]
    (ax,) = figures_decoder.channels_figure({"EEG": few}).axes
    assert not ax.containers[0][2][0].get_segments()[0].size, "two people have no interval"


def test_reliability_shows_people_and_all_epochs_before_and_after_scaling(legend):
    table = STUDY.p_error()
    upper, lower = figures_decoder.reliability_figure(table).axes
    assert upper.get_legend_handles_labels()[1] == [
        "Perfect", "A person, scaled", "Raw", "Temperature-scaled", "95 % interval over people"
    ]  # fmt: skip
    assert [patch.get_data().values.sum() for patch in lower.patches] == pytest.approx([1, 1])
    drawn = upper.lines[1:13]
    for line, (_, own) in zip(drawn, table.groupby("subject"), strict=True):
        _, observed, count = reliability(own["p_error"], own["label"])
        many = count >= figures_decoder.MIN_EPOCHS
        np.testing.assert_array_equal(np.isfinite(line.get_ydata()), many)
        np.testing.assert_allclose(line.get_ydata()[many], observed[many])
    assert not all(np.isfinite(line.get_ydata()).all() for line in drawn), "some bins are left out"
    promised, observed, _ = reliability(table["p_error"], table["label"])
    (band,) = upper.collections
    for x, y in zip(promised, observed, strict=True):
        ends = [at for where, at in band.get_paths()[0].vertices if where == x]
        assert min(ends) < y < max(ends)
    top = [line for line in upper.lines if line.get_label() == "Raw"]
    assert not top[0].get_clip_on(), "markers at the edge are whole"


def test_each_filter_has_a_panel_of_auroc_against_latency():
    people = [(f"s{i}", end, 0.6 + 0.02 * i + 0.1 * end) for i in range(6) for end in (0.4, 1.0)]
    causal = pd.DataFrame(people, columns=["subject", "window", "auroc"])
    tables = {"both ways": causal, "causal": causal.assign(auroc=causal["auroc"] - 0.02)}
    left, right = figures_decoder.latency_figure(tables).axes
    assert (left.get_title(), right.get_title()) == ("both ways", "causal")
    drawn = [np.asarray(ax.containers[0][0].get_ydata(), float) for ax in (left, right)]
    np.testing.assert_allclose(drawn, [[0.69, 0.75], [0.67, 0.73]])
