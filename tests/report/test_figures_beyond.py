"""Figures of notebook 06 show what is in their tables."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_beyond


def test_every_person_is_a_point_and_every_study_a_marker(runs):
    own = pd.DataFrame({"auroc": [0.7, 0.9], "success": [0.1, 0.8], "completed": [0.3, 0.9]})
    own["subject"] = ["s02", "s13"]
    other = pd.DataFrame({"auroc": [0.8], "success": [0.5], "completed": [0.6]})
    reached = pd.DataFrame({"success": [0.9, 0.0], "completed": [1.0, 0.1]}, ["dense", "sparse"])
    fig = figures_beyond.people_figure({"simulated EEG": own, "lab": other}, reached, runs)
    assert [text.get_text() for text in fig.legends[0].texts] == [
        "RL dense",
        "RL sparse",
        "simulated EEG (n = 2)",
        "lab (n = 1)",
    ]
    *_, first, second = fig.axes[0].lines
    assert first.get_xydata().tolist() == [[0.7, 0.1], [0.9, 0.8]]
    assert second.get_xydata().tolist() == [[0.8, 0.5]]
    assert fig.axes[1].lines[-1].get_xydata().tolist() == [[0.8, 0.6]]
    assert first.get_marker() != second.get_marker()


def test_runs_of_the_first_study_are_dots_joined_person_by_person(runs):
    chosen = runs[runs["seed"] < 2]
    own = pd.DataFrame({"subject": ["s02", "s13"], "auroc": [0.7, 0.9]})
    own = own.assign(success=[0.1, 0.8], completed=[0.3, 0.9])
    reached = pd.DataFrame({"success": [0.9], "completed": [1.0]}, ["dense"])
    people = {"simulated EEG": own, "ner2015": own}
    (ax, _) = figures_beyond.people_figure(people, reached, chosen).axes
    late = chosen.query("phase == 'Late' and group == 'rlihf'")
    known = late[late["subject"].isin(["s02", "s13"])].groupby("subject")["success"]
    (dots,) = [line for line in ax.lines if line.get_alpha()]
    assert sorted(dots.get_ydata()) == pytest.approx(
        sorted([*known.get_group("s02"), *known.get_group("s13")])
    )
    (joined,) = ax.collections
    ends = np.array([segment[:, 1] for segment in joined.get_segments()])
    np.testing.assert_allclose(ends, known.agg(["min", "max"]))
    assert ax.get_ylabel() == "Success rate,\n2 to 3 thousand steps"
    assert ax.lines[-1].get_label() == "recorded, NER 2015 (n = 2)"


@pytest.fixture
def late():
    cases = pd.Categorical(["at once", "late", "at once", "late"], ["at once", "late"])
    table = pd.DataFrame({"case": cases, "interval": [1, 10, 1, 10], "delay": [0, 8, 0, 8]})
    return table.assign(success=[0.9, 0.1, 0.7, 0.3], clearance=[0.05, None, 0.03, 0.02])


def test_a_case_is_a_row_with_its_runs_and_their_mean(late):
    fig = figures_beyond.cases_figure(late, ("success", "clearance"))
    success, clearance = fig.axes
    assert [label.get_text() for label in success.get_yticklabels()] == ["late", "at once"]
    runs, mean, *_ = success.lines
    assert runs.get_xdata().tolist() == [0.1, 0.3] and mean.get_xdata() == pytest.approx([0.2])
    assert clearance.lines[0].get_xdata().tolist() == [2.0], "runs that place nothing keep none"


def test_a_grid_shows_the_mean_of_each_interval_and_delay(late):
    fig = figures_beyond.grid_figure(late, ("success",))
    (ax,) = fig.axes
    words = [text.get_text() for text in ax.texts if "nan" not in text.get_text()]
    assert words == ["0.80", "0.70 to 0.90", "0.20", "0.10 to 0.30"]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["0", "0.8"]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["0.1", "1"]


def test_labels_are_drawn_by_who_fills_in_at_how_many_were_asked():
    late = pd.DataFrame({"case": pd.Categorical(["few", "few", "all"], ["few", "all"])})
    late = late.assign(told="no model", answers=[400, 500, 60_000], success=[0.1, 0.3, 0.9])
    (ax,) = figures_beyond.labels_figure(late, ("success",)).axes
    runs, means = ax.lines
    assert runs.get_xdata().tolist() == [400, 500, 60_000]
    assert means.get_xydata().tolist() == [[450, pytest.approx(0.2)], [60_000, 0.9]]
    assert ax.get_xscale() == "log" and means.get_label() == "no model"
