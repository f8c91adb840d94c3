"""Figures of what policies reach: every run is shown, and what decides is told with its luck."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_late, people, tables
from rlihf_lib.report.style import ordered


def diamonds(ax):
    """Means, in the order in which they are drawn."""
    return [line for line in ax.lines if line.get_marker() == "D"]


def hollow(ax):
    """Which means are drawn as having no interval."""
    return [line.get_markerfacecolor() == "white" for line in diamonds(ax)]


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
    known = table[table["metric"] == "success"]["improvement"]
    assert [mark.get_xdata()[0] for mark in diamonds(right)] == pytest.approx([*known[::-1]])


def test_supplementary_conditions_are_drawn_like_the_others(runs, supplement, legend):
    both = pd.concat([runs[runs["group"] == "rlihf"], supplement])
    table = tables.comparison_table(both, ordered(supplement["group"]), ("success",))
    left, right = figures_late.comparison_figure(both, table).axes
    assert len(legend(left)) == 5 and len(right.get_yticklabels()) == 4


def test_profiles_that_coincide_lie_side_by_side(runs, supplement):
    both = pd.concat([runs[runs["group"] == "rlihf"], supplement])
    none = both["group"].isin(["rlihf-mean", "rlihf-shuffled"])
    both = both.assign(success=both["success"].where(~none, 0))
    table = tables.comparison_table(both, ordered(supplement["group"]), ("success",))
    fig = figures_late.comparison_figure(both, table)
    fig.canvas.draw()
    heights = {}
    for line in fig.axes[0].lines:
        name = line.get_label().split(" (")[0]
        heights[name] = line.get_transform().transform(line.get_xydata())[0, 1]
        if name in ("RLIHF, constant p", "RLIHF, shuffled p"):
            assert not line.get_ydata().any()
    apart = heights["RLIHF, shuffled p"] - heights["RLIHF, constant p"]
    assert 1 < 72 / fig.dpi * apart < 3, "points"


def test_means_without_an_interval_are_hollow(runs):
    few = runs[runs["seed"] < 2]
    few = few[few["subject"].isin(["", "s02", "s05"])]
    *_, right = figures_late.comparison_figure(few, tables.comparison_table(few)).axes
    assert hollow(right) == [True, True]
    *_, right = figures_late.comparison_figure(runs, tables.comparison_table(runs)).axes
    assert hollow(right) == [False, False]
    few = runs[(runs["seed"] < 2) | (runs["group"] == "rlihf")]
    assert hollow(figures_late.safety_figure(few).axes[0]) == [True, True, False]


def test_safety_counts_the_runs_that_collide_and_that_place_the_can(runs):
    free = (runs["group"] == "rlihf") & (runs["seed"] > 0)
    runs = runs.assign(collisions=runs["collisions"].where(~free, 0))
    sparse = runs["group"] == "sparse"
    runs["clearance"] = runs["min_clearance"].where(~sparse)
    collisions, clearance = figures_late.safety_figure(runs).axes
    counted = [
        [tick.get_text().split("\n") for tick in ax.get_xticklabels()]
        for ax in (collisions, clearance)
    ]
    assert counted == [
        [["sparse", "5/5"], ["dense", "5/5"], ["RLIHF", "12/60"]],
        [["sparse", "0/5"], ["dense", "5/5"], ["RLIHF", "60/60"]],
    ]
    dots = [line.get_ydata() for line in clearance.lines if line.get_marker() == "o"]
    assert [len(run) for run in dots] == [5, 60], "of sparse reward nothing"
    late = runs.query("phase == 'Late' and group == 'dense'")["min_clearance"]
    assert sorted(dots[0]) == pytest.approx(sorted(100 * late))


def decided(runs, scores):
    """Figure of what decides, and its correlations."""
    table = people.subject_table(runs, scores)
    correlations = people.correlation_table(table)
    told = table, correlations, people.threshold_table(table)
    return figures_late.decoder_policy_figure(runs, *told), correlations


def test_decoder_against_policy_says_how_far_they_go_together(runs, scores):
    fig, correlations = decided(runs, scores)
    known = correlations.set_index("metric").loc[["success_early", "success", "return"]]
    assert [ax.get_ylabel() for ax in fig.axes[:3]] == [
        "Early success rate", "Late success rate", "Late return"
    ]  # fmt: skip
    assert fig.axes[3].get_ylabel().startswith("Clearance")
    assert not fig.axes[3].get_title(), "nothing is known of clearance"
    for ax, row in zip(fig.axes, known.itertuples(), strict=False):
        spread = f"{row.rho:.2f}\n[{row.ci_low:.2f}, {row.ci_high:.2f}]"
        assert spread in ax.get_title()
        assert rf"$p_\mathrm{{Holm}}$ = {row.p_holm:#.2g}" in ax.get_title()
        dots = [len(line.get_xdata()) for line in ax.lines if line.get_marker() == "o"]
        assert dots == [5] * 12, "every run"
        assert {text.get_text() for text in ax.texts} == {"s02", "s03", "s04"}, (
            "below half of dense"
        )


def test_clearance_is_drawn_against_auroc_where_cans_are_placed(runs, scores):
    near = runs.assign(clearance=runs["subject"].map(scores.set_index("subject")["auroc"]) / 20)
    near.loc[near["group"] == "dense", "clearance"] = 0.04
    near.loc[near["subject"] == "s02", "clearance"] = np.nan
    fig, correlations = decided(near, scores)
    last = correlations.iloc[-1]
    assert last["metric"] == "clearance" and f"{last['rho']:.2f}" in fig.axes[3].get_title()
    means = [mark.get_ydata()[0] for mark in diamonds(fig.axes[3])]
    assert means == pytest.approx(5 * scores["auroc"].to_numpy()[1:]), "in cm, without s02"


def test_controls_stand_where_their_decoders_would(runs, scores, supplement):
    fig, *_ = decided(pd.concat([runs, supplement]), scores)
    marks = {line.get_label(): line for line in fig.axes[1].lines if line.get_marker() == "D"}
    at = {name: line.get_xdata()[0] for name, line in marks.items() if ", " in name}
    assert at == {
        "RLIHF, ideal p": 1.0, "RLIHF, constant p": 0.494, "RLIHF, shuffled p": 0.506,
        "RLIHF, a person each": 0.7,
    }  # fmt: skip
    ideal = supplement.query("group == 'rlihf-ideal' and phase == 'Late'")["success"].mean()
    assert marks["RLIHF, ideal p"].get_ydata()[0] == pytest.approx(ideal)


def test_the_gap_is_shaded_between_the_people_round_half_of_dense(runs, scores):
    half = runs["subject"].isin(["s02", "s03", "s04"])
    fig, _ = decided(runs.assign(success=runs["success"].where(~half, 0)), scores)
    auroc = scores.set_index("subject")["auroc"]
    (band,) = fig.axes[1].patches
    ends = band.get_x(), band.get_x() + band.get_width()
    assert ends == pytest.approx((auroc["s04"], auroc["s05"])), "the last below, the first above"
    assert band.get_label() == f"half of dense: AUROC {ends[0]:.2f} to {ends[1]:.2f}"
    nobody = runs.assign(success=runs["success"].where(runs["group"] != "rlihf", 0))
    assert not decided(nobody, scores)[0].axes[1].patches
    everybody = runs.assign(success=runs["success"].where(runs["group"] != "rlihf", 1))
    assert not decided(everybody, scores)[0].axes[1].patches


def test_who_is_equal_to_dense_reward_lies_between_the_margins(runs, scores):
    table, by_person = tables.comparison_table(runs), people.subject_table(runs, scores)
    (ax,) = figures_late.equivalence_figure(by_person, table, runs).axes
    names = [tick.get_text() for tick in ax.get_yticklabels()]
    assert names[0] == "s02 (0.70)" and names[12:] == ["all people"]
    overall = table.set_index(["comparison", "metric"]).loc[("RLIHF - RL dense", "success")]
    drawn = [mark.get_xdata()[0] for mark in diamonds(ax)]
    assert drawn[:12] == pytest.approx(by_person["difference"].to_numpy())
    assert drawn[12] == pytest.approx(overall["difference"])
    arm = ax.collections[0].get_segments()[12][:, 0]
    assert arm == pytest.approx([overall["ci_low"], overall["ci_high"]])
    *_, zero, low, high, border = ax.lines
    assert [line.get_xdata()[0] for line in (zero, low, high)] == [0, -0.1, 0.1]
    assert {text.get_text(): text.xy[0] for text in ax.texts} == {"−0.10": -0.1, "+0.10": 0.1}
    assert border.get_ydata()[0] == 11.5, "between the last person and all of them"


def test_each_persons_runs_are_dots_about_their_distance_from_dense(runs, scores):
    few = runs[(runs["seed"] < 2) | (runs["group"] == "dense")]
    told = people.subject_table(few, scores), tables.comparison_table(few)
    (ax,) = figures_late.equivalence_figure(*told, few).axes
    dots = [line for line in ax.lines if line.get_marker() == "o"]
    assert [line.get_ydata().tolist() for line in dots] == [[place] * 2 for place in range(12)]
    means = [line.get_xdata().mean() for line in dots]
    assert means == pytest.approx([mark.get_xdata()[0] for mark in diamonds(ax)[:12]])
    assert hollow(ax) == [True] * 12 + [False], "two seeds, but twelve people"
