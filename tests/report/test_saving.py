"""What is saved says what it is and what it was drawn from."""

import json
import re
import shutil
import subprocess

import matplotlib.pyplot as plt
import pandas as pd
import pytest

from rlihf_lib.report import figures_late
from rlihf_lib.report.evaluations import load_runs
from rlihf_lib.report.saving import manifest, save_figure, save_table, typeset

PAGE = r"""\documentclass[twocolumn]{article}\usepackage{booktabs,graphicx}\begin{document}
%s
\end{document}
"""


def test_saved_figures_say_what_they_were_drawn_from(study):
    fig = figures_late.safety_figure(load_runs(study))
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


@pytest.mark.parametrize(
    ("width", "points", "told"),
    [(7.2, 8, "18.3 cm wide"), (7, 6.9, "'too small' has 6.9 pt")],
)
def test_what_print_cannot_show_is_not_saved(study, width, points, told):
    fig = plt.figure(figsize=(width, 2))
    fig.text(0.5, 0.5, "too small", fontsize=points)
    with pytest.raises(ValueError, match=told):
        save_figure(fig, study, "small", "04_metrics_tables")
    assert not study.figures.exists()


def test_what_is_not_seen_may_be_small_and_fonts_are_embedded(study):
    fig, (shown, hidden) = plt.subplots(1, 2, figsize=(7, 2))
    hidden.set_visible(False)
    hidden.text(0, 0, "small", fontsize=5)
    shown.set_title("", fontsize=5)
    save_figure(fig, study, "small", "04_metrics_tables")
    pdf = (study.figures / "small.pdf").read_bytes()
    assert b"/FontFile2" in pdf and b"/Type3" not in pdf


def test_no_letter_is_cut_at_the_border(study):
    fig, ax = plt.subplots(figsize=(3.4, 2))
    ax.set_yticks([0, 1], ["event, weight 0.07, late", "x"])
    save_figure(fig, study, "wide", "04_metrics_tables")
    picture = plt.imread(study.figures / "wide.png")[..., :3]
    assert fig.dpi == 95 and picture[:, :6].min() == 1, "white"
    assert picture[:, :20].min() < 0.5, "and no room is lost"


def test_latex_is_escaped_and_has_booktabs_lines(study):
    cells = ["RLIHF - -0.42 ± 1e-05", None]
    shown = pd.DataFrame({"a_b": cells, "p < 1": [0.5, 1]}, index=["in", "k&r"])
    save_table(study, "small", shown, says=r"95 % of {n} #1 $2 ~^\ two-sided")
    tex = (study.tables / "small.tex").read_text()
    assert r"a\_b & p $<$ 1 \\" in tex and r" & 1.0 \\" in tex
    assert r"RLIHF $-$ $-$0.42 $\pm$ 1e-05 & 0.5 \\" in tex
    assert "\\begin{table*}\n\\centering" in tex and tex.isascii()
    assert [tex.count(rf"\{line}rule") for line in ("top", "mid", "bottom")] == [1, 2, 1]
    caption = r"simulated EEG $\cdot$ profile smoke $\cdot$ 95 \% of \{n\} \#1 \$2 "
    caption += r"\textasciitilde{}\textasciicircum{}\textbackslash{} two-sided"
    assert rf"\caption{{{caption}}}" in tex
    assert r"\multicolumn{2}{l}{\emph{k\&r}}" in tex
    without = re.sub(r"\\[{}]", "", tex)
    assert without.count("{") == without.count("}")
    markdown = (study.tables / "small.md").read_text()
    assert markdown.startswith("simulated EEG · profile smoke · 95 % of {n}")
    assert "two-sided\n\n| a_b | p < 1 |\n| --- |" in markdown
    assert pd.read_csv(study.tables / "small.csv")["p < 1"].tolist() == [0.5, 1]


@pytest.mark.skipif(not shutil.which("pdflatex"), reason="no TeX here")
def test_latex_compiles_and_is_not_wider_than_the_page(tmp_path):
    wide = pd.DataFrame([["RLIHF - -0.42 ± 0.1"] * 9] * 2, columns=[*r"#$%&_{~^\<"[:9]])
    page = PAGE % typeset(wide, r"#$%&_{}~^\<>±·")[".tex"]
    (tmp_path / "page.tex").write_text(page)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "page.tex"]
    done = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True)
    assert done.returncode == 0 and "Overfull" not in done.stdout, done.stdout[-500:]


@pytest.mark.parametrize("text", ["", "[]", '{"fig": {}}', '{"fig": 1}', '{"fig": {"note'])
def test_a_damaged_manifest_is_named_with_a_remedy(text, tmp_path):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(ValueError, match=r"manifest.json is damaged .*; delete it"):
        manifest(tmp_path)
