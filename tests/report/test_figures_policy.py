"""Figures of policies: what is drawn, that few runs are shown as runs and prove nothing."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_late, figures_policy, figures_weights, people, tables
from rlihf_lib.report.evaluations import load_runs


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
    assert titles[0] == "s02, AUROC 0.70" and titles[11:] == ["s13, AUROC 0.98", "mean over people"]
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


@pytest.mark.parametrize("learnt", [True, False])
def test_a_run_is_drawn_as_soon_as_it_has_windows_learnt_or_not(learnt):
    values = [np.nan, 0.5] if learnt else [np.nan, np.nan]
    columns = ("critic_loss", "ent_coef", "mean_q", "judged_wrong")
    window = pd.DataFrame({"step": [1000, 2000]} | dict.fromkeys(columns, values))
    fig = figures_policy.learner_figure(window, "rlihf")
    fig.canvas.draw()
    assert [ax.get_yscale() for ax in fig.axes[:2]] == ["log" if learnt else "linear"] * 2


@pytest.mark.parametrize(("least", "ticks"), [(0.1, "0.5"), (1e-4, "$\\mathdefault{10^{-2}}$")])
def test_losses_over_many_decades_have_powers_of_ten(least, ticks):
    window = pd.DataFrame({"step": [1000, 2000], "critic_loss": [least, 1.0]})
    window = window.assign(ent_coef=0.1, mean_q=1.0)
    ax = figures_policy.learner_figure(window, "dense").axes[0]
    ax.figure.canvas.draw()
    assert ticks in [tick.get_text() for tick in ax.get_yticklabels()]


def test_training_is_a_line_per_run_beside_its_evaluation(runs):
    dense = runs[runs["group"] == "dense"]
    training = dense.assign(episodes=1)
    training.loc[training["step"] == 1000, "return"] = np.nan
    fig = figures_policy.training_figure(dense, training, "dense", 1000)
    assert [len(line.get_xdata()) for line in fig.axes[0].lines[:5]] == [3] * 5
    earned = training.groupby("step")["return"].mean().dropna()
    np.testing.assert_allclose(fig.axes[0].lines[5].get_ydata(), earned)
    assert [line.get_alpha() for line in fig.axes[0].lines[:6]] == [0.3] * 5 + [None]
    assert len(fig.axes[1].collections) == 1
    assert "reward of RL dense" in fig.axes[0].get_ylabel()
    sparse = runs[runs["group"] == "sparse"].assign(**{"return": 0.0})
    other = figures_policy.training_figure(sparse, training, "sparse", 1000)
    for ax, same in zip(fig.axes[1:], other.axes[1:], strict=True):
        assert ax.get_ylim() == same.get_ylim() and ax.get_xlim() == same.get_xlim()
    lost = figures_policy.training_figure(sparse.assign(**{"return": -400.0}), training, "s", 1000)
    assert lost.axes[1].get_ylim()[0] <= -400, "nothing is cut off"


def test_a_single_run_each_can_be_drawn(study):
    runs = load_runs(study)
    table = people.subject_table(runs, study.scores())
    figures = [
        figures_policy.figure_4(runs, study.scores()),
        figures_policy.success_figure(runs),
        figures_late.safety_figure(runs),
        figures_late.comparison_figure(runs, tables.comparison_table(runs)),
        figures_late.decoder_policy_figure(
            runs, table, people.correlation_table(table), people.threshold_table(table)
        ),
        figures_weights.figure_6(load_runs(study, ("sparse", "dense", "ablation"))),
    ]
    assert "[" not in figures[-2].axes[0].get_title(), "no interval"
    for fig in figures:
        bands = [c for ax in fig.axes for c in ax.collections if "Fill" in type(c).__name__]
        assert not sum(len(path.vertices) for band in bands for path in band.get_paths())
        fig.canvas.draw()
