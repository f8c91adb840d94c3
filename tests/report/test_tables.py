"""Tables from small hand-made runs."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import paper, people, tables
from rlihf_lib.report.evaluations import load_runs, phase_scores
from rlihf_lib.report.saving import typeset
from rlihf_lib.report.style import ordered


def test_table_1_holds_our_means_beside_the_papers(study):
    table = tables.table_1(load_runs(study)).set_index(["phase", "group", "metric"])
    assert len(table) == 27
    assert table.loc[("Late", "dense", "success"), "mean"] == 1.0
    assert table.loc[("Late", "rlihf", "success"), "mean"] == 0.5
    assert table.loc[("Early", "dense", "success"), "mean"] == 0.0
    assert table.loc[("Late", "rlihf", "success"), "paper_mean"] == 0.39
    assert table.loc[("Early", "sparse", "path_deviation"), "paper_sd"] == 0.26
    assert table.loc[("Late", "rlihf", "success"), "n_runs"] == 1
    shown = tables.show_table_1(table.reset_index())
    assert list(shown["method"][:3]) == [
        f"{m} (1 seed)" for m in ("RL sparse", "RL dense", "RLIHF")
    ]
    assert shown["paper"].iloc[-1, 0] == "0.39 ± 0.39"
    assert not shown["success rate ↑"].str.contains("[", regex=False).any()


def test_summary_of_the_papers_size_is_of_runs_by_hand(runs):
    table = tables.late_table(runs).set_index(["group", "metric"])
    assert table.index.get_level_values("group").unique().tolist() == ["sparse", "dense", "rlihf"]
    row = table.loc[("rlihf", "success")]
    points = runs.query("group == 'rlihf' and step == 3000")["success"]
    assert row["mean"] == pytest.approx(points.mean())
    assert row["sd"] == pytest.approx(np.std(points, ddof=1)), "sample standard deviation"
    assert row["ci_low"] < row["mean"] < row["ci_high"]
    assert row["iqm_low"] < row["iqm"] < row["iqm_high"]
    assert (row["n"], row["n_runs"], row["n_points"]) == ("12 people x 5 seeds", 60, 60)
    shown = tables.show_summary(table.reset_index(), ["group"], ["success", "iqm success"])
    assert shown["method"].tolist() == ["RL sparse", "RL dense", "RLIHF"]
    assert shown["success"].str.fullmatch(r"0\.\d\d ± 0\.\d\d \[0\.\d\d, 0\.\d\d\]").all()


def test_clearance_is_of_the_people_who_place_the_can(runs):
    never = (runs["subject"] == "s02") | ((runs["subject"] == "s03") & (runs["seed"] > 0))
    some = runs.assign(clearance=np.where(never, np.nan, runs["min_clearance"]))
    row = tables.late_table(some).set_index(["group", "metric"]).loc[("rlihf", "clearance")]
    placed = phase_scores(some).query("group == 'rlihf'").dropna(subset="clearance")
    assert row["mean"] == pytest.approx(placed.groupby("subject")["clearance"].mean().mean())
    assert row["ci_low"] < row["mean"] < row["ci_high"] and row["iqm_low"] < row["iqm_high"]
    assert (row["n"], row["n_runs"]) == ("11 people x 1 to 5 seeds", 51)
    assert row["n_points"] == 51


def test_an_interval_without_width_claims_nothing(runs):
    equal = runs.assign(success=runs["success"].where(runs["group"] != "sparse", 0))
    table = tables.late_table(equal)
    shown = tables.show_summary(table, ["group"], ["success"])["success"]
    assert shown[0] == "0.00 ± 0.00 [=]" and shown[1].endswith("]") and "=" not in shown[1]


def test_supplementary_conditions_stand_below_a_line_without_the_papers_numbers(runs, supplement):
    table = tables.table_1(pd.concat([runs, supplement]))
    assert len(table) == 27 + 4 * 9
    assert table["paper_mean"].iloc[:27].notna().all() and table["paper_mean"][27:].isna().all()
    shown = tables.show_table_1(table)
    blocks = [f"{p}{more}" for more in ("", ", supplementary") for p in paper.PHASES]
    assert list(dict.fromkeys(shown.index)) == blocks and len(shown) == 9 + 12
    assert [name.partition(" (")[0] for name in shown["method"].tolist()[9:13]] == [
        "RL sparse, tuned", "RLIHF, ideal p", "RLIHF, constant p", "RLIHF, shuffled p",
    ]  # fmt: skip
    assert set(shown["paper"].iloc[9:].to_numpy().ravel()) == {""}
    texts = typeset(shown, "five seeds", "table1")
    lines = texts[".md"].splitlines()
    assert lines[4] == "| *Early* |  |  |  |  |  |  |" and lines[4 + 12] == lines[4].replace(
        "Early", "Early, supplementary"
    )
    assert texts[".tex"].count(r"\midrule") == 6 and r"\label{tab:table1}" in texts[".tex"]
    assert {line.count("|") for line in lines[2:]} == {len(shown.columns) + 1}


def test_rlihf_is_compared_with_baselines_over_people_and_seeds(runs):
    table = tables.comparison_table(runs).set_index(["comparison", "metric"])
    row = table.loc[("RLIHF - RL dense", "success")]
    late = phase_scores(runs).groupby("group")["success"].mean()
    assert row["difference"] == pytest.approx(late["rlihf"] - late["dense"])
    assert row["n"] == "12 people x 5 seeds and 5 seeds"
    assert row["smallest_p"] == pytest.approx(2 / 6188)
    assert row["smallest_p_holm"] == pytest.approx(8 * 2 / 6188) and len(table) == 8
    assert (table["p"] >= table["smallest_p"]).all() and (table["p_holm"] >= table["p"]).all()
    assert row["ci_low"] <= row["difference"] <= row["ci_high"] < 0
    assert row["p_equivalent"] > 0.9 and table["p_equivalent"].notna().sum() == 1
    sparse = table.loc[("RLIHF - RL sparse", "success")]
    assert sparse["p"] == sparse["smallest_p"] and sparse["improvement"] == 1
    deviation = table.loc[("RLIHF - RL sparse", "path_deviation")]
    assert deviation["difference"] < 0 and deviation["improvement"] == 1, "less is better"
    shown = tables.show_comparison(table.reset_index())
    assert shown.loc[1, "compared, late phase"] == "RLIHF - RL dense"
    assert shown.loc[1, "p"].endswith(" (0.00032)") and shown.loc[0, "p, equivalent"] == ""


def test_controls_are_compared_with_the_same_persons_runs(runs, supplement):
    everything = pd.concat([runs, supplement])
    others = ordered(supplement["group"])
    table = tables.comparison_table(everything, others, ("success",)).set_index("comparison")
    row = table.loc["RLIHF s08 - RLIHF, constant p"]
    own = phase_scores(runs).query("subject == 's08'")["success"].mean()
    control = phase_scores(supplement).query("subject == 's08-mean'")["success"].mean()
    assert row["difference"] == pytest.approx(own - control)
    assert row["n"] == "5 seeds and 5 seeds" and row["smallest_p"] == 2 / 252
    assert table.loc["RLIHF - RLIHF, ideal p", "n"] == "12 people x 5 seeds and 5 seeds"


def test_weights_are_paired_over_people(weighed):
    table = tables.weight_comparison(weighed).set_index(["metric", "comparison"])
    row = table.loc[("success", "RLIHF 0.7 - 0.1")]
    means = phase_scores(weighed).groupby("w_hf")["success"].mean()
    assert row["difference"] == pytest.approx(means[0.7] - means[0.1])
    assert row["n"] == "12 people, paired" and row["smallest_p"] == 2 / 4096
    assert row["p"] == 2 / 4096 and row["p_holm"] <= 6 * 2 / 4096
    one = tables.weight_comparison(weighed.query("subject == 's05'"))
    assert set(one["smallest_p"].dropna()) == {2 / 252}


def test_the_order_of_the_weights_is_tested_in_every_phase(weighed):
    table = tables.order_table(weighed)
    assert list(table["phase"]) == ["Early", "Mid", "Late", "Late"]
    late = table.iloc[2]
    means = phase_scores(weighed).groupby("w_hf")["success"].mean()
    words = " < ".join(f"{w:g} ({means[w]:.2f})" for w in (0.1, 0.4, 0.7))
    assert (late["paper"], late["ours"], late["n"]) == ("0.1 < 0.4 < 0.7", words, "12 people")
    assert late["p"] < 0.001 and (table["p_holm"] >= table["p"]).all()
    turned = tables.order_table(weighed.assign(w_hf=0.8 - weighed["w_hf"])).iloc[2]
    assert turned["ours"].startswith("0.1") is False and turned["p"] > 0.999
    one = tables.order_table(weighed.query("subject == 's05'"))
    assert set(one["n"]) == {"5 seeds"}
    tied = tables.order_table(weighed.assign(success=0.5)).iloc[2]["ours"]
    assert tied == "0.1 (0.50) ≈ 0.4 (0.50) ≈ 0.7 (0.50)"
    two = tables.order_table(weighed.query("w_hf > 0.2"))
    assert two["p"].isna().all(), "two weights have no order to test"


def test_a_study_of_one_run_each_proves_nothing_and_says_so(study):
    runs = load_runs(study, ("sparse", "dense", "ablation"))
    late = tables.late_table(runs, ["group", "w_hf"]).query("metric == 'return'")
    assert late["w_hf"].tolist() == [0.0, 0.0, 0.1, 0.4, 0.7]
    assert set(late["mean"]) == {30.0} and late["ci_low"].isna().all()
    main = load_runs(study)
    by_subject = people.subject_table(main, study.scores())
    assert by_subject["subject"].tolist() == ["s04"]
    assert by_subject["difference"].tolist() == [-0.5]
    comparison = tables.comparison_table(main).set_index(["comparison", "metric"])
    assert comparison.loc[("RLIHF - RL sparse", "success"), "difference"] == 0.5
    weights = tables.weight_comparison(runs)
    for table in (by_subject, comparison, weights):
        assert set(table["p"]) == set(table["smallest_p"]) == {1.0}
        assert table["ci_low"].isna().all() and table["n"].str.endswith("no interval").all()


def test_the_policy_subject_of_smoke_is_the_median_decoder(study):
    assert study.policy_subjects() == ["s04"]
    assert [config.subject for config in study.run_configs("rlihf")] == ["s04"]


def test_the_papers_table_is_complete():
    table = paper.table_1()
    assert len(table) == 27 and not table.duplicated(["phase", "group", "metric"]).any()
