"""Figures of learning: what is drawn, and that few runs are shown as runs."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_policy


def thin(ax):
    """Lines of single runs."""
    return [line for line in ax.lines if line.get_linewidth() == 0.5]


@pytest.mark.parametrize(("n", "bands"), [(1, 0), (4, 0), (5, 1)])
def test_below_five_seeds_the_runs_are_drawn_and_no_band(runs, n, bands):
    ax = plt.figure().subplots()
    dense = runs[(runs["group"] == "dense") & (runs["seed"] < n)]
    figures_policy.learning_curve(dense, ax, "success")
    assert len(ax.collections) == bands
    assert len(thin(ax)) == (0 if bands else n)
    mean = dense.groupby("step")["success"].mean()
    np.testing.assert_allclose(ax.lines[0].get_ydata(), mean)


def test_three_people_have_no_band_however_many_runs(runs):
    ax = plt.figure().subplots()
    figures_policy.learning_curve(runs[runs["subject"].isin(["s02", "s05", "s13"])], ax)
    assert not ax.collections and len(thin(ax)) == 15


def test_figure_4_has_a_panel_per_person_with_the_auroc_and_one_of_the_mean(runs, scores, legend):
    fig = figures_policy.figure_4(runs, scores)
    panels = {ax.get_title(): ax for ax in fig.axes if ax.get_visible()}
    assert len(panels) == 13
    titles = list(panels)
    assert titles[0] == "s13, AUROC 0.98" and titles[11:] == ["s02, AUROC 0.70", "mean over people"]
    for title, ax in panels.items():
        assert list(legend(ax)) == ["RL sparse", "RL dense", "RLIHF"]
        assert len(ax.collections) == 3, title
    drawn = legend(panels["mean over people"])["RLIHF"].get_ydata()
    np.testing.assert_allclose(
        drawn, runs[runs["group"] == "rlihf"].groupby("step")["return"].mean()
    )


@pytest.mark.parametrize("n", [1, 2, 7])
def test_figure_4_takes_any_number_of_people(runs, scores, n):
    chosen = runs[runs["subject"].isin(["", *scores["subject"][:n]])]
    fig = figures_policy.figure_4(chosen, scores)
    assert sum(ax.get_visible() for ax in fig.axes) == n + 1
    fig.canvas.draw()


@pytest.mark.parametrize("weights", [(0.7,), (0.1, 0.4, 0.7), (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)])
def test_figure_6_draws_any_weights_and_the_baselines(runs, weighed, weights, legend):
    some = [weighed.assign(w_hf=w)[weighed["w_hf"] == 0.7] for w in weights]
    both = pd.concat([runs[runs["group"] != "rlihf"], *some])
    (ax,) = figures_policy.figure_6(both).axes
    lines = legend(ax)
    assert list(lines)[:2] == ["RL sparse", "RL dense"] and len(lines) == 2 + len(weights)
    assert len({tuple(line.get_color()) for line in list(lines.values())[2:]}) == len(weights)
    assert "(thousands)" in ax.get_xlabel()


@pytest.mark.parametrize("learnt", [True, False])
def test_a_run_is_drawn_as_soon_as_it_has_windows_learnt_or_not(learnt):
    values = [np.nan, 0.5] if learnt else [np.nan, np.nan]
    columns = ("critic_loss", "ent_coef", "mean_q", "judged_wrong")
    window = pd.DataFrame({"step": [1000, 2000]} | dict.fromkeys(columns, values))
    fig = figures_policy.learner_figure(window, "rlihf")
    fig.canvas.draw()
    assert [ax.get_yscale() for ax in fig.axes[:2]] == ["log" if learnt else "linear"] * 2


def test_training_is_a_line_per_run_beside_its_evaluation(runs):
    dense = runs[runs["group"] == "dense"]
    training = dense.assign(episodes=1)
    training.loc[training["step"] == 1000, "return"] = np.nan
    fig = figures_policy.training_figure(dense, training, "dense")
    assert [len(line.get_xdata()) for line in fig.axes[0].lines[:5]] == [3] * 5
    assert len(fig.axes[1].collections) == 1
