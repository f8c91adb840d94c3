"""Figures of the weight of human feedback: any weights, the same people, a dot a person."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_weights
from rlihf_lib.report.evaluations import phase_scores
from rlihf_lib.report.style import shades


@pytest.mark.parametrize("weights", [(0.7,), (0.1, 0.4, 0.7), (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)])
def test_figure_6_draws_any_weights_and_the_baselines(runs, weighed, weights, legend):
    some = [weighed.assign(w_hf=w)[weighed["w_hf"] == 0.7] for w in weights]
    both = pd.concat([runs[runs["group"] != "rlihf"], *some])
    figure = figures_weights.figure_6(both)
    for ax, metric in zip(figure.axes, ("return", "success"), strict=False):
        lines = legend(ax)
        assert list(lines)[:2] == ["RL sparse", "RL dense"] and len(lines) == 2 + len(weights)
        own = [line for name, line in lines.items() if name.startswith("RLIHF")]
        assert [line.get_color() for line in own] == [shades(weights)[w] for w in weights]
        assert len({line.get_marker() for line in own}) == min(len(weights), 5)
        drawn = runs[runs["group"] == "dense"].groupby("step")[metric].mean()
        np.testing.assert_allclose(lines["RL dense"].get_ydata(), drawn)
        assert "(thousands)" in ax.get_xlabel()
    assert len(figure.legends) == 1


def test_figure_6_has_the_differences_of_the_same_people(runs, weighed):
    both = pd.concat([runs[runs["group"] != "rlihf"], weighed])
    ax = figures_weights.figure_6(both).axes[2]
    assert [tick.get_text() for tick in ax.get_xticklabels()] == [
        "0.4\n− 0.1", "0.7\n− 0.1", "0.7\n− 0.4"
    ]  # fmt: skip
    late = phase_scores(weighed).pivot_table("return", "subject", "w_hf")
    people, mean = ax.lines[2:4]
    np.testing.assert_allclose(people.get_ydata(), late[0.7] - late[0.1])
    assert mean.get_ydata()[0] == pytest.approx((late[0.7] - late[0.1]).mean())
    assert len(ax.collections) == 3, "an interval each"


def test_the_inside_is_told_in_units_of_the_weight():
    steps = np.arange(1000, 30_001, 1000)
    training = pd.concat(
        pd.DataFrame(
            {
                "w_hf": w,
                "step": steps,
                "ent_coef": 0.2 * w,
                "critic_loss": (3 * w) ** 2,
                "subject": "s02",
                "run": f"seed0 at {w}",
            }
        )
        for w in (0.0, 0.1, 0.7)  # 0 is dense reward's
    )
    fig = figures_weights.weights_figure(training)
    for ax, ratio in zip(fig.axes, (0.2, 3), strict=True):
        curves = [line for line in ax.lines if line.get_marker() in tuple("s^")]
        assert len(curves) == 2
        for line in curves:
            np.testing.assert_allclose(line.get_ydata(), ratio)
            np.testing.assert_allclose(line.get_xdata(), [5, 15, 25])


def test_time_and_clearance_are_those_of_late_successes(runs, weighed):
    runs = pd.concat([runs[runs["group"] == "dense"], weighed])
    runs = runs.assign(steps=np.where(runs["success"] > 0.5, 80, 1000))
    runs["success"] = (runs["success"] > 0.5).astype(int)
    fig = figures_weights.trade_off_figure(runs)
    (ax,) = fig.axes
    placed = runs.query("phase == 'Late' and success == 1").groupby("w_hf")["run"].nunique()
    names = "RL dense", *(f"RLIHF, $w_{{hf}}$ = {w:g}" for w in (0.1, 0.4, 0.7))
    told = [f"{name} (n = {n})" for name, n in zip(names, placed, strict=True)]
    assert ax.get_legend_handles_labels()[1] == told
    assert {text.get_text().strip(): text.get_position()[1] for text in ax.texts} == {
        "too close": 2, "at ease": 5
    }  # fmt: skip
    dots = [line.get_xdata() for line in ax.lines if line.get_alpha()]
    people = runs.query("phase == 'Late' and success == 1").groupby("w_hf")["subject"].nunique()
    assert [len(line) for line in dots] == [5, *people[1:]], "runs of dense, people at each weight"
    assert {x for line in dots for x in line} == {8.0}


def test_large_marks_compare_the_people_who_place_the_can_at_every_weight(weighed):
    own = weighed.assign(success=1, steps=80)
    own.loc[own["subject"] == "s02", "steps"] = 800
    own.loc[(own["subject"] == "s02") & (own["w_hf"] == 0.1), "success"] = 0
    (ax,) = figures_weights.trade_off_figure(own).axes
    small = [max(line.get_xdata()) for line in ax.lines if line.get_alpha()]
    assert small == [8, 80, 80], "s02 is seen"
    large = [bars.lines[0].get_xdata() for bars in ax.containers]
    assert [list(x) for x in large] == [[8], [8], [8]], "and doesn't count"
