"""Figures of what policies do late: what is drawn, and that few runs prove nothing."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_late, figures_policy, tables
from rlihf_lib.report.evaluations import load_runs
from rlihf_lib.report.style import ordered


def test_the_profile_is_the_share_of_runs_above(runs, legend):
    table = tables.comparison_table(runs)
    left, right = figures_late.comparison_figure(runs, table).axes
    late = runs[(runs["step"] == 3000) & (runs["group"] == "rlihf")]["success"].to_numpy()
    line = legend(left)["RLIHF (12 people x 5 seeds)"]
    for tau, share in zip(line.get_xdata()[::10], line.get_ydata()[::10], strict=True):
        assert share == pytest.approx(np.mean(late > tau))
    assert len(left.collections) == 3, "a band each"
    names = [tick.get_text() for tick in right.get_yticklabels()]
    assert names == ["RLIHF > RL dense", "RLIHF > RL sparse"]
    dots = right.lines[0].get_xdata()
    known = table[table["metric"] == "success"]["improvement"]
    assert dots == pytest.approx(known.to_numpy()[::-1])


def test_supplementary_conditions_are_drawn_like_the_others(runs, supplement, legend):
    both = pd.concat([runs[runs["group"] == "rlihf"], supplement])
    table = tables.comparison_table(both, ordered(supplement["group"]), ("success",))
    left, right = figures_late.comparison_figure(both, table).axes
    assert len(legend(left)) == 5 and len(right.get_yticklabels()) == 4


def test_decoder_against_policy_says_how_far_they_go_together(runs, scores):
    table = tables.subject_table(runs, scores)
    (ax,) = figures_late.decoder_policy_figure(runs, table).axes
    known = tables.correlation_table(table).iloc[0]
    title = ax.get_title()
    assert f"{known['rho']:.2f}, [{known['ci_low']:.2f}, {known['ci_high']:.2f}], n = 12" in title
    assert "smallest possible: 0.0002" in title
    assert len(ax.lines[0].get_xdata()) == 60, "every run is a dot"
    behind = {text.get_text() for text in ax.texts}
    assert "s02" in behind and "s13" not in behind


def test_time_and_clearance_are_those_of_late_successes(runs, weighed):
    runs = pd.concat([runs[runs["group"] == "dense"], weighed])
    runs = runs.assign(steps=np.where(runs["success"] > 0.5, 80, 1000))
    runs["success"] = (runs["success"] > 0.5).astype(int)
    fig = figures_late.trade_off_figure(runs)
    (ax,) = fig.axes
    assert ax.get_legend_handles_labels()[1] == [
        "RL dense", *(f"RLIHF, $w_{{hf}}$ = {w:g}" for w in (0.1, 0.4, 0.7))
    ]  # fmt: skip
    assert {x for line in ax.lines if line.get_marker() == "o" for x in line.get_xdata()} == {8.0}


def test_a_single_run_each_can_be_drawn(study):
    runs = load_runs(study)
    table = tables.subject_table(runs, study.scores())
    figures = [
        figures_policy.figure_4(runs, study.scores()),
        figures_policy.success_figure(runs),
        figures_late.safety_figure(runs),
        figures_late.comparison_figure(runs, tables.comparison_table(runs)),
        figures_late.decoder_policy_figure(runs, table),
        figures_policy.figure_6(load_runs(study, ("sparse", "dense", "ablation"))),
    ]
    assert "no interval, n = 1" in figures[-2].axes[0].get_title()
    for fig in figures:
        bands = [c for ax in fig.axes for c in ax.collections if "Fill" in type(c).__name__]
        assert not sum(len(path.vertices) for band in bands for path in band.get_paths())
        fig.canvas.draw()
