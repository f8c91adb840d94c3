"""Tables and figures from small hand-made runs."""

import json

import matplotlib
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_policy, paper, tables
from rlihf_lib.report.evaluations import add_phase, load_runs
from rlihf_lib.report.style import save_figure
from rlihf_lib.study import Study

matplotlib.use("agg")


@pytest.fixture
def study(tmp_path):
    """A smoke study whose runs are made by hand: success 0, 1 and 0.5 after the first third."""
    study = Study("smoke", out=tmp_path)
    study.decoder.mkdir(parents=True)
    scores = pd.DataFrame({"subject": ["s02", "s03", "s04"], "auroc": [0.9, 0.7, 0.8]})
    scores = scores.assign(accuracy_online=0.8, balanced_accuracy=0.75)
    scores.to_csv(study.decoder / "scores.csv", index=False)
    table = pd.DataFrame({"subject": ["s02", "s03", "s04"], "epoch": 0, "label": 1, "p_error": 0.6})
    table.to_csv(study.decoder / "p_error.csv", index=False)
    level = {"sparse": 0.0, "dense": 1.0, "rlihf": 0.5}
    for stage in ("sparse", "dense", "ablation"):
        for config in study.run_configs(stage):
            rows = [
                {
                    "step": step,
                    "rollout": rollout,
                    "return": 10.0 * step / 1000,
                    "success": float(step > 1000 and rollout < 2 * level[config.condition]),
                    "path_efficiency": 0.5,
                    "path_deviation": 0.25,
                    "collisions": rollout,
                    "min_clearance": 0.03,
                }
                for step in (0, 1000, 2000, 3000)
                for rollout in (0, 1)
            ]
            folder = study.runs / config.run_id
            folder.mkdir(parents=True)
            pd.DataFrame(rows).to_csv(folder / "eval.csv", index=False)
            (folder / "config.json").write_text(json.dumps({"hash": config.hash}))
    return study


def test_phases_are_the_thirds_of_training():
    steps = pd.DataFrame({"step": [0, 1, 50_000, 50_001, 100_000, 100_001, 150_000]})
    phases = add_phase(steps, 150_000)["phase"].astype(str).tolist()
    assert phases == ["Early", "Early", "Early", "Mid", "Mid", "Late", "Late"]


def test_table_1_holds_our_means_beside_the_papers(study):
    table = tables.table_1(load_runs(study), 3000).set_index(["phase", "condition", "metric"])
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


def test_the_policy_subject_of_smoke_is_the_median_decoder(study):
    assert study.policy_subjects() == ["s04"]
    assert [config.subject for config in study.run_configs("rlihf")] == ["s04"]


def test_companion_tables(study):
    runs = load_runs(study, ("sparse", "dense", "ablation"))
    weights = tables.weight_table(runs, 3000).query("metric == 'return'")
    assert sorted(weights["w_hf"]) == [0.0, 0.0, 0.1, 0.4, 0.7]
    assert set(weights["mean"]) == {30.0}
    main = load_runs(study)
    scores = pd.read_csv(study.decoder / "scores.csv")
    by_subject = tables.subject_table(main, scores, 3000)
    assert by_subject["subject"].tolist() == ["s04"]
    assert by_subject["success_minus_dense"].tolist() == [-0.5]
    comparison = tables.comparison_table(main, 3000).set_index(["comparison", "metric"])
    assert comparison.loc[("RLIHF - RL sparse", "success"), "difference"] == 0.5
    assert set(comparison["p"]) == {1.0}, "one pair proves nothing"


def test_figure_4_has_a_panel_per_subject_and_says_where_nothing_was_run(study):
    runs = load_runs(study)
    fig = figures_policy.figure_4(runs, ["s02", "s03", "s04"], 3000)
    panels = {ax.get_title(): ax for ax in fig.axes}
    assert set(panels) == {"s02", "s03", "s04"}
    lines = {line.get_label(): line for line in panels["s04"].lines}
    assert {"RL sparse", "RL dense", "RLIHF"} <= set(lines)
    assert np.allclose(lines["RLIHF"].get_ydata(), [0, 10, 20, 30])
    assert np.allclose(lines["RLIHF"].get_xdata(), [0, 1, 2, 3])
    assert "not run" in panels["s02"].texts[0].get_text()


def test_figure_6_draws_every_weight_and_the_baselines(study):
    runs = load_runs(study, ("sparse", "dense", "ablation"))
    ax = figures_policy.figure_6(runs, study.profile.weights, 3000)
    labels = [text for text in ax.get_legend_handles_labels()[1]]
    assert labels[:2] == ["RL sparse", "RL dense"] and len(labels) == 5
    assert "(thousands)" in ax.get_xlabel()


def test_saved_figures_say_what_they_were_drawn_from(study):
    fig = figures_policy.safety_figure(load_runs(study), 3000)
    save_figure(fig, study, "safety", "04_metrics_tables", ["dense-seed0"])
    before = (study.figures / "safety.pdf").read_bytes()
    save_figure(fig, study, "safety", "04_metrics_tables", ["dense-seed0"])
    assert (study.figures / "safety.pdf").read_bytes() == before, "equal data, equal file"
    assert (study.figures / "safety.png").stat().st_size > 1000
    entry = json.loads((study.figures / "manifest.json").read_text())["safety"]
    assert entry["notebook"] == "04_metrics_tables"
    assert list(entry["sources"]) == ["results/smoke-simulated/runs/dense-seed0/eval.csv"]
    with pytest.raises(FileNotFoundError, match="no-such-run"):
        save_figure(fig, study, "safety", "04_metrics_tables", ["no-such-run"])


def test_the_papers_table_is_complete():
    table = paper.table_1()
    assert len(table) == 27 and not table.duplicated(["phase", "condition", "metric"]).any()
