"""What is saved says what it is and what it was drawn from."""

import json

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import figures_policy, figures_task
from rlihf_lib.report.evaluations import load_runs
from rlihf_lib.report.saving import save_figure, save_table
from rlihf_lib.rl.evaluation import Recording


def test_saved_figures_say_what_they_were_drawn_from(study):
    fig = figures_policy.safety_figure(load_runs(study))
    save_figure(fig, study, "safety", "04_metrics_tables", ["dense-seed0"], "hand-made")
    before = (study.figures / "safety.pdf").read_bytes()
    save_figure(fig, study, "safety", "04_metrics_tables", ["dense-seed0"], "hand-made")
    assert (study.figures / "safety.pdf").read_bytes() == before, "equal data, equal file"
    assert (study.figures / "safety.png").stat().st_size > 1000
    assert fig.get_supxlabel() == "simulated EEG · profile smoke · hand-made"
    entry = json.loads((study.figures / "manifest.json").read_text())["safety"]
    assert entry["notebook"] == "04_metrics_tables"
    assert list(entry["sources"]) == ["results/smoke-simulated/runs/dense-seed0/eval.csv"]
    with pytest.raises(FileNotFoundError, match="no-such-run"):
        save_figure(fig, study, "safety", "04_metrics_tables", ["no-such-run"])


def test_a_film_is_rendered_anew_only_if_what_it_shows_has_changed(study, monkeypatch):
    rendered = []

    def render(path, qpos, seed):
        rendered.append(seed)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"GIF")
        return "egl"

    monkeypatch.setattr(figures_task, "film", render)
    recording = Recording(None, None, np.zeros((3, 9)), 7, True)
    source = study.decoder / "scores.csv"
    for text in ("subject,auroc\n", "subject,auroc\n", "subject,auroc\ns02,0.5\n"):
        source.write_text(text)
        figures_task.save_film(recording, study, "film_dense", "03_policy_training", [source])
    assert rendered == [7, 7]


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
