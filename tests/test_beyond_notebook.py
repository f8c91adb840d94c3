"""Notebook 06 draws every experiment: here of runs made by hand, each case as good as its place."""

import dataclasses
import json
import shutil

import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.beyond import Beyond
from rlihf_lib.experiments import EXPERIMENTS
from rlihf_lib.files import canonical_json
from rlihf_lib.profiles import PROFILES
from rlihf_lib.regenerate import NOTEBOOKS
from rlihf_lib.report.evaluations import load_runs
from rlihf_lib.report.people import taught
from rlihf_lib.rl.runs import ACTOR, is_done, write_run
from rlihf_lib.study import Study


def evaluations(config, level):
    """Rollouts of which a share places the can, with what depends on it."""
    points = range(0, config.total_steps + 1, config.eval_every)
    table = pd.DataFrame([(p, n) for p in points for n in range(5)], columns=["step", "rollout"])
    success = (table["rollout"] < round(5 * level)).astype(int)
    return table.assign(**{
        "return": 100.0 * success, "success": success, "path_efficiency": 0.5, "collisions": 0,
        "path_deviation": 0.1, "min_clearance": 0.05, "completed": level, "steps": 100,
    })  # fmt: skip


@pytest.fixture
def made_by_hand(tmp_path, monkeypatch):
    paper = dataclasses.replace(PROFILES["paper"], experiments=tuple(EXPERIMENTS))
    monkeypatch.setitem(PROFILES, "paper", paper)
    shipped, study = Study(), Study(out=tmp_path)
    shutil.copytree(shipped.decoder, study.decoder)
    beyond_folder = shipped.results / "beyond"
    shutil.copytree(beyond_folder, study.results / "beyond", ignore=lambda *_: ["runs"])
    beyond = Beyond(study)
    actor = (shipped.runs / "dense-seed0" / ACTOR).read_bytes()
    for name in EXPERIMENTS:
        cases = beyond.cases(name)
        for place, runs in enumerate(cases.values()):
            for config in runs:
                if is_done(config, beyond.runs):
                    continue  # of an earlier experiment, too
                table = evaluations(config, 1 - place / len(cases))
                texts = {
                    "eval.csv": table.to_csv(index=False),
                    "config.json": canonical_json({**config.to_dict(), "hash": config.hash}),
                    "provenance.json": json.dumps({"asked": 1000 * (place + 1)}),
                }
                files = {file: text.encode() for file, text in texts.items()}
                write_run(config, beyond.runs, files | {ACTOR: actor})
    return study


def test_every_experiment_has_a_section_a_table_and_a_figure(made_by_hand, capsys):
    study = made_by_hand
    nb = nbformat.read(NOTEBOOKS / "06_beyond_the_paper.ipynb", as_version=4)
    sources = [cell.source for cell in nb.cells if cell.cell_type == "code"]
    cell = {"profile": "paper", "eeg": "simulated", "out": str(study.out), "ship": True}
    cell |= {"workers": 1, "recompute": False, "display": lambda *_: None}
    reached = pd.DataFrame({"success": [1.0, 0.0], "completed": [1.0, 0.1]}, ["dense", "sparse"])
    shipped = load_runs(Study(), ["rlihf"]).query("step <= 60_000")
    people = {"simulated EEG": taught(shipped, study.scores(), 60_000)}
    cell |= {"people": people, "references": reached, "own_runs": shipped}  # of 6.1
    with plt.rc_context():
        for source in sources:
            if (
                "use_style()" in source
                or "def learnt" in source
                or "learnt(" in source
                or "draw_cases(" in source
            ):
                exec(source.replace("from IPython.display import display\n", ""), cell)
    plt.close("all")
    for name in EXPERIMENTS:
        assert (study.figures / f"{name}.pdf").is_file(), name
        assert (study.tables / f"{name}.md").is_file(), name
    ladder = pd.read_csv(study.tables / "ladder.csv").query("metric == 'success'")
    assert list(ladder["case"][:3]) == ["ideal", "constant", "shuffled"]
    assert (ladder["n"] == 3).all() and np.isnan(ladder["apart"].iloc[0])
    assert (ladder["apart"].iloc[2:] == "down").all()
    labels = pd.read_csv(study.tables / "labels.csv").query("metric == 'answers'")
    assert sorted(labels["mean"])[:2] == [2000, 3000], "as the runs' provenance says"
    assert "written back to its event: 67% of the path at once" in capsys.readouterr().out
