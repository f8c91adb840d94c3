"""Figures of what policies reach: every run is shown, and what decides is told with its luck."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_late, people, tables
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


def decided(runs, scores):
    """Figure of what decides, and its correlations."""
    table = people.subject_table(runs, scores)
    correlations = people.correlation_table(table)
    told = table, correlations, people.threshold_table(table)
    return figures_late.decoder_policy_figure(runs, *told), correlations


def test_decoder_against_policy_says_how_far_they_go_together(runs, scores):
    fig, correlations = decided(runs, scores)
    known = correlations.set_index("metric").loc[["success", "return", "success_early"]]
    for ax, row in zip(fig.axes, known.itertuples(), strict=True):
        spread = f"{row.rho:.2f} [{row.ci_low:.2f}, {row.ci_high:.2f}]"
        assert spread in ax.get_title() and "(least 0.0008)" in ax.get_title(), "after Holm"
        dots = [len(line.get_xdata()) for line in ax.lines if line.get_marker() == "o"]
        assert dots == [5] * 12, "every run"
        assert {text.get_text() for text in ax.texts} == {"s02", "s03", "s04"}, (
            "below half of dense"
        )


def test_controls_stand_where_their_decoders_would(runs, scores, supplement):
    fig, *_ = decided(pd.concat([runs, supplement]), scores)
    marks = {line.get_label(): line for line in fig.axes[0].lines if line.get_marker() == "D"}
    at = {name: line.get_xdata()[0] for name, line in marks.items() if ", " in name}
    assert at == {
        "RLIHF, ideal p": 1.0, "RLIHF, constant p": 0.494, "RLIHF, shuffled p": 0.506,
        "RLIHF, a person each": 0.7,
    }  # fmt: skip
    ideal = supplement.query("group == 'rlihf-ideal' and phase == 'Late'")["success"].mean()
    assert marks["RLIHF, ideal p"].get_ydata()[0] == pytest.approx(ideal)


def test_a_band_says_how_good_a_decoder_must_be_for_half_of_dense(runs, scores):
    half = runs["subject"].isin(["s02", "s03", "s04"])
    fig, _ = decided(runs.assign(success=runs["success"].where(~half, 0)), scores)
    auroc = scores.set_index("subject")["auroc"]
    (band,) = fig.axes[0].patches
    assert auroc["s04"] <= band.get_x() < band.get_x() + band.get_width() < auroc["s13"]
    nobody = runs.assign(success=runs["success"].where(runs["group"] != "rlihf", 0))
    assert not decided(nobody, scores)[0].axes[0].patches


def test_who_is_equal_to_dense_reward_lies_between_the_margins(runs, scores):
    table, by_person = tables.comparison_table(runs), people.subject_table(runs, scores)
    (ax,) = figures_late.equivalence_figure(by_person, table).axes
    names = [tick.get_text() for tick in ax.get_yticklabels()]
    assert names[0] == "s02 (0.70)" and names[12:] == ["all people"]
    overall = table.set_index(["comparison", "metric"]).loc[("RLIHF - RL dense", "success")]
    drawn = ax.lines[0].get_xdata()
    assert drawn[:12] == pytest.approx(by_person["difference"].to_numpy())
    assert drawn[12] == pytest.approx(overall["difference"])
    arm = ax.collections[0].get_segments()[12][:, 0]
    assert arm == pytest.approx([overall["ci_low"], overall["ci_high"]])
    assert [line.get_xdata()[0] for line in ax.lines[1:]] == [-0.1, 0.1]
