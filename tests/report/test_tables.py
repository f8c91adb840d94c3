"""Tables from small hand-made runs."""

import json

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import paper, tables
from rlihf_lib.report.evaluations import (
    add_phase,
    described,
    group_of,
    late_scores,
    load_runs,
    load_training,
    person_of,
    size,
    units,
)  # fmt: skip
from rlihf_lib.report.saving import save_table, typeset
from rlihf_lib.report.style import label, ordered
from rlihf_lib.rl.config import RunConfig, SACSettings


def test_phases_are_the_thirds_of_training():
    steps = pd.DataFrame({"step": [0, 1, 50_000, 50_001, 100_000, 100_001, 150_000]})
    phases = add_phase(steps)["phase"].astype(str).tolist()
    assert phases == ["Early", "Early", "Early", "Mid", "Mid", "Late", "Late"]


@pytest.mark.parametrize(
    ("condition", "subject", "other", "group", "shown"),
    [
        ("sparse", "", {}, "sparse", "RL sparse"),
        ("dense", "", {}, "dense", "RL dense"),
        ("rlihf", "s02", {"w_hf": 0.4}, "rlihf", "RLIHF"),
        ("rlihf", "ideal", {"w_hf": 0.7}, "rlihf-ideal", "RLIHF, ideal p"),
        ("rlihf", "s02-mean", {"w_hf": 0.7}, "rlihf-mean", "RLIHF, constant p"),
        ("rlihf", "s02-shuffled", {"w_hf": 0.7}, "rlihf-shuffled", "RLIHF, shuffled p"),
        ("rlihf", "s02", {"w_hf": 0.7, "observer": "lay"}, "rlihf-lay", "RLIHF, lay observer"),
        (
            "sparse", "", {"patience": 1000, "sac": SACSettings(discount=0.99)},
            "sparse-patience1000-discount0.99", "RL sparse, tuned (0.99)",
        ),
        ("dense", "", {"patience": 50}, "dense-patience50", "dense-patience50"),
    ],
)  # fmt: skip
def test_a_run_is_compared_as_what_its_config_says(condition, subject, other, group, shown):
    config = RunConfig(condition, 3, 3000, 1000, subject=subject, **other)
    assert group_of(config) == group
    assert label(group) == shown


def test_whose_feedback_a_run_drew_on():
    subjects = ("s02", "s02-mean", "s02-shuffled", "ideal", "", "sub-01")
    assert [person_of(s) for s in subjects] == ["s02", "s02", "s02", "", "", "sub-01"]


def test_units_are_people_or_else_seeds(runs):
    late = late_scores(runs)
    assert units(late.query("group == 'rlihf'"), "success").shape == (12, 5)
    assert units(late.query("subject == 's05'"), "success").shape == (5, 1)
    assert units(late.query("group == 'dense'"), "success").shape == (5, 1)
    assert size(late.query("group == 'rlihf'")) == "12 people x 5 seeds"
    assert size(late.query("subject == 's05' and seed == 0")) == "1 seed"
    unequal = late.query("subject in ('s05', 's06')").iloc[:-1]
    assert np.isnan(units(unequal, "success")).sum() == 1
    assert described(runs).startswith("RL sparse 5 seeds, RL dense 5 seeds, RLIHF 12 people x 5")


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
    assert list(shown["method"][:3]) == ["RL sparse", "RL dense", "RLIHF"]
    assert shown["success, paper"].iloc[-1] == "0.39 ± 0.39"
    assert set(shown["n"]) == {"1 seed, no interval"}
    assert not shown["success"].str.contains("[", regex=False).any()


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


def test_supplementary_conditions_stand_below_a_line_without_the_papers_numbers(runs, supplement):
    table = tables.table_1(pd.concat([runs, supplement]))
    assert len(table) == 27 + 4 * 9
    assert table["paper_mean"].iloc[:27].notna().all() and table["paper_mean"][27:].isna().all()
    shown = tables.show_table_1(table)
    assert shown.index.tolist() == ["as in the paper"] * 9 + ["supplementary"] * 12
    assert shown["method"].tolist()[9:13] == [
        "RL sparse, tuned (0.98)", "RLIHF, ideal p", "RLIHF, constant p", "RLIHF, shuffled p",
    ]  # fmt: skip
    assert shown["success, paper"].tolist()[9:] == [""] * 12
    texts = typeset(shown, "five seeds")
    lines = texts[".md"].splitlines()
    assert lines[4 + 9].startswith("| *supplementary* |")
    assert {line.count("|") for line in lines[2:]} == {len(shown.columns) + 1}


def test_latex_is_escaped_and_has_booktabs_lines(study):
    shown = pd.DataFrame({"a_b": ["1 ± 2", None], "p": [0.5, 1]}, index=["in", "out"])
    save_table(study, "small", shown, says="95 % of n")
    tex = (study.tables / "small.tex").read_text()
    assert r"a\_b & p \\" in tex and r"1 ± 2 & 0.5 \\" in tex and r" & 1.0 \\" in tex
    assert tex.startswith("\\begin{table*}[t]\n\\centering")
    assert [tex.count(rf"\{line}rule") for line in ("top", "mid", "bottom")] == [1, 2, 1]
    assert r"\caption{simulated EEG $\cdot$ profile smoke $\cdot$ 95 \% of n}" in tex
    assert r"\multicolumn{2}{l}{\emph{out}}" in tex
    markdown = (study.tables / "small.md").read_text()
    assert markdown.startswith("simulated EEG · profile smoke · 95 % of n\n\n| a_b | p |\n| --- |")
    assert pd.read_csv(study.tables / "small.csv")["p"].tolist() == [0.5, 1]


def test_rlihf_is_compared_with_baselines_over_people_and_seeds(runs):
    table = tables.comparison_table(runs).set_index(["comparison", "metric"])
    row = table.loc[("RLIHF - RL dense", "success")]
    late = late_scores(runs).groupby("group")["success"].mean()
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
    assert shown.loc[1, "p"].endswith(" (0.00032)") and shown.loc[0, "p, equivalent"] == ""


def test_controls_are_compared_with_the_same_persons_runs(runs, supplement):
    everything = pd.concat([runs, supplement])
    others = ordered(supplement["group"])
    table = tables.comparison_table(everything, others, ("success",)).set_index("comparison")
    row = table.loc["RLIHF - RLIHF, constant p"]
    own = late_scores(runs).query("subject == 's08'")["success"].mean()
    control = late_scores(supplement).query("subject == 's08-mean'")["success"].mean()
    assert row["difference"] == pytest.approx(own - control)
    assert row["n"] == "5 seeds and 5 seeds" and row["smallest_p"] == 2 / 252
    assert table.loc["RLIHF - RLIHF, ideal p", "n"] == "12 people x 5 seeds and 5 seeds"


def test_weights_are_paired_over_people(weighed):
    table = tables.weight_comparison(weighed).set_index(["metric", "comparison"])
    row = table.loc[("success", "0.7 - 0.1")]
    means = late_scores(weighed).groupby("w_hf")["success"].mean()
    assert row["difference"] == pytest.approx(means[0.7] - means[0.1])
    assert row["n"] == "12 people, paired" and row["smallest_p"] == 2 / 4096
    assert row["p"] == 2 / 4096 and row["p_holm"] <= 6 * 2 / 4096
    one = tables.weight_comparison(weighed.query("subject == 's05'"))
    assert set(one["smallest_p"]) == {2 / 252}


def test_every_person_is_compared_with_dense_reward(runs, scores):
    table = tables.subject_table(runs, scores)
    assert table["subject"].tolist() == scores["subject"].tolist()
    first = table.iloc[0]
    late = late_scores(runs)
    own = late.query("subject == 's02'")["success"].mean()
    dense = late.query("group == 'dense'")["success"].mean()
    assert first["difference"] == pytest.approx(own - dense)
    assert first["p"] == first["smallest_p"] == 2 / 252
    assert set(table["smallest_p_holm"]) == {12 * 2 / 252}, "cannot reach .05 after correction"
    assert set(table["smallest_p_equivalent"]) == {1 / 252}
    correlation = tables.correlation_table(table).set_index("metric")
    assert correlation.loc["success", "rho"] > 0.9 and correlation.loc["success", "p"] < 0.001


def test_a_study_of_one_run_each_proves_nothing_and_says_so(study):
    runs = load_runs(study, ("sparse", "dense", "ablation"))
    late = tables.late_table(runs, ["group", "w_hf"]).query("metric == 'return'")
    assert late["w_hf"].tolist() == [0.0, 0.0, 0.1, 0.4, 0.7]
    assert set(late["mean"]) == {30.0} and late["ci_low"].isna().all()
    main = load_runs(study)
    by_subject = tables.subject_table(main, study.scores())
    assert by_subject["subject"].tolist() == ["s04"]
    assert by_subject["difference"].tolist() == [-0.5]
    comparison = tables.comparison_table(main).set_index(["comparison", "metric"])
    assert comparison.loc[("RLIHF - RL sparse", "success"), "difference"] == 0.5
    weights = tables.weight_comparison(runs)
    for table in (by_subject, comparison, weights):
        assert set(table["p"]) == set(table["smallest_p"]) == {1.0}
        assert table["ci_low"].isna().all() and table["n"].str.endswith("no interval").all()


def test_a_missing_or_foreign_run_is_named(study):
    (config,) = study.run_configs("dense")
    folder = study.runs / config.run_id
    (folder / "config.json").write_text(json.dumps({"hash": "another"}))
    with pytest.raises(FileNotFoundError, match=r"dense-seed0 is missing .* another config"):
        load_runs(study)


def test_a_run_with_an_empty_number_is_named_with_its_line(study):
    path = study.runs / "sparse-seed0" / "eval.csv"
    frame = pd.read_csv(path)
    frame.loc[3, "return"] = np.nan
    frame.to_csv(path, index=False)
    with pytest.raises(ValueError, match=r"sparse-seed0/eval.csv, line 5"):
        load_runs(study)


def test_windows_of_training_in_which_no_episode_ended_are_empty_not_broken(study):
    path = study.runs / "dense-seed0" / "train.csv"
    windows = pd.DataFrame({"step": [1000, 2000, 3000], "episodes": [0, 1, 2]})
    windows.assign(**{"return": [np.nan, 3, 4], "success": [np.nan, 0, 1]}).to_csv(path)
    training = load_training(study, ["dense"])
    assert training["return"].tolist()[1:] == [3, 4] and training["group"].unique() == ["dense"]
    windows.assign(**{"return": [1, np.nan, 4], "success": 0}).to_csv(path)
    with pytest.raises(ValueError, match=r"dense-seed0/train.csv, line 3"):
        load_training(study, ["dense"])


def test_the_policy_subject_of_smoke_is_the_median_decoder(study):
    assert study.policy_subjects() == ["s04"]
    assert [config.subject for config in study.run_configs("rlihf")] == ["s04"]


def test_the_papers_table_is_complete():
    table = paper.table_1()
    assert len(table) == 27 and not table.duplicated(["phase", "group", "metric"]).any()
