"""The notebooks as they are committed, and one smoke run of all of them from nothing."""

import ast
import inspect
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import nbformat
import pandas as pd
import pytest

from rlihf_lib.beyond import Beyond
from rlihf_lib.files import SUMS, canonical_json
from rlihf_lib.regenerate import NOTEBOOKS, READ_EPOCHS, STEPS
from rlihf_lib.report.saving import stale
from rlihf_lib.rl.runs import is_done, write_run
from rlihf_lib.study import REPOSITORY, STAGES, Study
from rlihf_lib.vary import vary
from tests.eeg.conftest import planted_epochs

NAMES = list(dict.fromkeys(step.notebook for step in STEPS))
PARAMETERS = {
    "profile": "paper",
    "eeg": "simulated",
    "out": "",
    "workers": 0,
    "recompute": False,
    "ship": False,
}
VARIED = {
    "01_dataset_preprocessing": ["subject"],
    "02_loso_decoder": ["subject"],
    "03_policy_training": [*inspect.signature(vary).parameters][1:-1],
    "04_metrics_tables": ["subject", "w_hf", "seeds", "total_steps"],
    "05_whf_ablation": ["subject", "weights", "seeds", "total_steps", "observer", "sac"],
    "06_beyond_the_paper": [],
}

# Nobody's feedback trains by sparse and dense reward: their notebooks need not be seen twice.
WITHOUT_BASELINES = """
import sys
from rlihf_lib import regenerate
from rlihf_lib.__main__ import main
steps = regenerate.STEPS
regenerate.STEPS = [s for s in steps if s.parameters.get("condition", "rlihf") == "rlihf"]
sys.exit(main())
"""


def read(name):
    return nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_are_committed_without_outputs(name):
    nb = read(name)
    nbformat.validate(nb)
    assert (nb.nbformat, nb.nbformat_minor) == (4, 5)
    for cell in nb.cells:
        assert cell.get("id")
        if cell.cell_type == "code":
            assert cell.outputs == [] and cell.execution_count is None, cell.source
        assert "papermill" not in cell.metadata
    assert "papermill" not in nb.metadata


def test_only_the_six_notebooks_are_committed():
    assert sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb")) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_each_notebook_has_one_parameters_cell_with_the_common_literals(name):
    tagged = [c for c in read(name).cells if "parameters" in c.metadata.get("tags", [])]
    assert len(tagged) == 1
    assignments = ast.parse(tagged[0].source).body
    values = {node.targets[0].id: ast.literal_eval(node.value) for node in assignments}
    assert values.pop("condition", None) == ("rlihf" if name.startswith("03") else None)
    assert values.pop("live", None) == (False if name.startswith("03") else None)
    assert values.pop("events", None) == (["correct", "error"] if name in READ_EPOCHS else None)
    assert values.pop("drop_channels", None) == ([] if name in READ_EPOCHS else None)
    empty = [values.pop(parameter) for parameter in VARIED[name]]
    assert not any(empty), "the profile's, until a reader gives another"
    assert values == PARAMETERS


@pytest.mark.parametrize("name", NAMES)
def test_each_notebook_opens_with_the_paper_and_ends_with_its_own_check(name):
    cells = read(name).cells
    assert cells[0].cell_type == "markdown" and "paper says" in cells[0].source
    code = [cell.source for cell in cells if cell.cell_type == "code"]
    assert "assert " in code[-1] and "expected" in code[-1]


def cells_with(name, *parts):
    """Source of the cells of a notebook that hold these words, each of which one does."""
    sources = [cell.source for cell in read(name).cells if cell.cell_type == "code"]
    found = [[source for source in sources if part in source] for part in parts]
    assert [len(each) for each in found] == [1] * len(parts)
    return [source for (source,) in found]


def test_a_kept_table_of_other_people_or_recordings_is_made_again(tmp_path):
    (tmp_path / "mine").mkdir()
    parts = "use_style()", 'find_table("latency.csv")'
    imports, latency = cells_with("02_loso_decoder", *parts)

    def shown(**recorded):
        """AUROC of each person in the shortest window, and when its table was made."""
        for number, seed in recorded.items():
            epochs = planted_epochs(seed, amplitude=3e-6)
            epochs.save(tmp_path / "mine" / f"sub-{number}_epo.fif", overwrite=True)
        folders = {"eeg": tmp_path / "mine", "out": tmp_path / "out"}
        told = {"profile": "quick", "events": ["correct", "error"], "drop_channels": []}
        cell = {**folders, **told, "ship": False, "subject": "", "recompute": False}
        with plt.rc_context():
            exec(imports, cell)
            cell["save_figure"] = lambda *_: None
            exec(latency, cell)
        shortest = cell["latency"].drop_duplicates("subject").set_index("subject")["auroc"]
        return shortest.to_dict(), cell["latency_csv"].stat().st_mtime_ns

    three = shown(n1=1, n2=2, n3=3)
    assert shown() == three, "the same people: it is kept"
    four = shown(n4=4)
    assert list(four[0]) == ["n1", "n2", "n3", "n4"]
    assert shown(n4=5)[0] != four[0]


def test_waves_of_other_people_are_not_drawn_beside_p_error(tmp_path, capsys):
    (source,) = cells_with("04_metrics_tables", 'find_table("difference_waves.csv")')
    study = Study("smoke", out=tmp_path)
    study.tables.mkdir(parents=True)
    (study.tables / "difference_waves.csv").write_text("s02,s03,channel,time\n0,0,Cz,0\n")
    scores = pd.DataFrame({"subject": ["s02", "s03", "s04"]})
    exec(source, {"study": study, "scores": scores, "pd": pd})
    assert "Notebook 01 has not drawn these people's waves" in capsys.readouterr().out


@pytest.fixture(scope="session")
def smoke(tmp_path_factory):
    """All notebooks, from nothing, by the command a user types; takes minutes, so it runs once."""
    out = tmp_path_factory.mktemp("smoke")
    command = [sys.executable, "-m", "rlihf_lib", "--profile", "smoke", "--out", str(out)]
    for name in ("home", "temporary", "here"):
        (out / name).mkdir()
    places = {"RLIHF_CACHE": "cache", "HOME": "home", "TMPDIR": "temporary"}
    environment = {**os.environ, **{key: str(out / name) for key, name in places.items()}}
    environment.pop("MPLCONFIGDIR", None)  # so that who imports Matplotlib unawares is seen
    before = held(REPOSITORY)
    result = subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=out / "here"
    )
    assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-4000:]
    assert held(REPOSITORY) == before
    return Study("smoke", out=out), result


def held(folder):
    """Files of the repository that a study could overwrite, and when each was changed."""
    places = (folder / name for name in ("rlihf_lib", "notebooks", "results", "figures"))
    compiled = (".pyc", ".nbi", ".nbc")  # by Python, and by Numba
    files = (path for place in places for path in place.rglob("*") if path.suffix not in compiled)
    return {path: path.stat().st_mtime_ns for path in files if path.is_file()}


def test_nothing_is_written_outside_out_the_cache_and_temporary_files(smoke):
    study, _ = smoke
    assert not [*(study.out / "home").iterdir(), *(study.out / "here").iterdir()]
    left = {path.name.split("_")[0] for path in (study.out / "temporary").iterdir()}
    assert left <= {"dask-scratch-space", "torchinductor"}, "theirs, and empty"
    assert {path.name for path in study.out.iterdir()} == {
        "results", "figures", "cache", "home", "temporary", "here"
    }  # fmt: skip


def test_what_is_done_is_told_without_libraries_that_write_to_the_home_folder(smoke):
    study, _ = smoke
    told = (
        "import sys; from rlihf_lib.__main__ import main; main(sys.argv[1:]); print(*sys.modules)"
    )
    command = [sys.executable, "-c", told, "--list", "--profile", "smoke", "--out", str(study.out)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    *_, modules = said.strip().split("\n")
    assert "06_beyond_the_paper" in said and not {"matplotlib", "mne"} & {*modules.split()}


def test_every_notebook_runs_in_smoke(smoke):
    study, result = smoke
    assert sorted(p.stem for p in study.notebooks.glob("*.ipynb")) == sorted(s.title for s in STEPS)
    for step in STEPS:
        assert f"{step.title}: finished" in result.stdout
        nb = nbformat.read(study.notebooks / f"{step.title}.ipynb", as_version=4)
        code = [cell for cell in nb.cells if cell.cell_type == "code"]
        assert all(cell.execution_count for cell in code), step.title


def test_another_decoders_table_trains_and_is_drawn_under_its_name(smoke, tmp_path):
    study, _ = smoke
    shutil.copy(study.decoder / "p_error.csv", tmp_path / "lab.csv")
    other = Study("smoke", tmp_path / "lab.csv", tmp_path)
    (trained,) = other.run_configs("rlihf")
    for config in {config for stage in STAGES for config in other.run_configs(stage)} - {trained}:
        as_if_trained(config, study.runs, other.runs)
    for config in Beyond(other).run_configs("observers"):
        as_if_trained(config, Beyond(study).runs, Beyond(other).runs)
    command = [sys.executable, "-c", WITHOUT_BASELINES, "--profile", "smoke"]
    command += ["--out", str(tmp_path), "--p-error", str(tmp_path / "lab.csv")]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-4000:]
    assert "02_loso" not in result.stdout and "05_whf_ablation: finished" in result.stdout
    first, again = (one.runs / trained.run_id / "eval.csv" for one in (study, other))
    assert again.read_bytes() == first.read_bytes(), "the same p(error), whoever has decoded it"
    tables = {path: path.read_text() for path in other.tables.glob("*.md")}
    assert len(tables) > 10
    for path, table in tables.items():
        assert table.startswith("p(error) of lab · profile smoke"), path
    assert stale(other) == []


def as_if_trained(config, source, runs_dir):
    """Write a run that differs from one of another folder in the name of its EEG only."""
    kept = (path for path in (source / config.run_id).iterdir() if path.name != SUMS)
    files = {path.name: path.read_bytes() for path in kept}
    files["config.json"] = canonical_json({**config.to_dict(), "hash": config.hash}).encode()
    write_run(config, runs_dir, files)
    assert is_done(config, runs_dir)


def test_the_smoke_run_leaves_plain_tables(smoke):
    study, _ = smoke
    scores = pd.read_csv(study.decoder / "scores.csv")
    assert {
        "subject", "accuracy_pretrain", "accuracy_online", "balanced_accuracy", "auroc", "ece",
        "n_epochs", "n_errors",
    } <= set(scores.columns)  # fmt: skip
    assert len(scores) == 3
    table = study.p_error()
    assert set(table["subject"]) == set(scores["subject"])
    configs = {config for stage in STAGES for config in study.run_configs(stage)}
    assert len(configs) == 3 + 1 + 3 + 2
    for config in configs:
        assert is_done(config, study.runs)
        frame = pd.read_csv(study.runs / config.run_id / "eval.csv")
        assert {
            "step", "rollout", "return", "success", "path_efficiency", "path_deviation",
            "collisions", "min_clearance",
        } <= set(frame.columns)  # fmt: skip
        assert frame["step"].max() == study.profile.total_steps
        recorded = json.loads((study.runs / config.run_id / "config.json").read_text())
        assert {"condition", "w_hf", "subject", "seed", "eeg", "observer"} <= set(recorded)
    table_1 = pd.read_csv(study.tables / "table1_phases.csv")
    beside = table_1.dropna(subset="paper_mean")
    assert len(beside) == 27 and table_1["mean"].notna().all()
    assert set(table_1["group"]) - set(beside["group"]) == {
        "sparse-patience1000-discount0.98", "rlihf-ideal", "rlihf-mean", "rlihf-shuffled",
    }  # fmt: skip


def test_every_figure_is_pdf_and_png_and_its_sources_are_unchanged(smoke):
    study, _ = smoke
    manifest = json.loads((study.figures / "manifest.json").read_text())
    for start in ("fig3", "fig4", "fig5", "fig6"):
        assert any(name.startswith(start) for name in manifest), start
    for name, entry in manifest.items():
        assert entry["notebook"] in NAMES
        starts = {"pdf": b"%PDF", "png": b"\x89PNG"}
        if name.startswith("film"):
            starts = {"gif": b"GIF89a", "mp4": b"\x00\x00\x00\x20ftyp"}
            assert all((study.figures / f"{name}.{end}").stat().st_size < 1.5e6 for end in starts)
        for suffix, start in starts.items():
            assert (study.figures / f"{name}.{suffix}").read_bytes().startswith(start)
    assert not stale(study)
    assert {Path(s).name for s in manifest["paths"]["sources"]} == {"actor.safetensors"}
    run = study.run_configs("dense")[0].run_id
    table = study.runs / run / "train.csv"
    content = table.read_bytes()
    table.write_bytes(content + b"\n")
    assert set(stale(study)) == {"training_dense", "learner_dense"}, "tampered with"
    table.write_bytes(content)


def test_the_simulated_eeg_is_owned_up_to(smoke):
    study, _ = smoke
    for table in study.tables.glob("*.md"):
        assert "simulated EEG" in table.read_text(encoding="utf-8"), table


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.title)
def test_shipped_copies_are_in_step_with_their_sources(step):
    path = Study().notebooks / f"{step.title}.ipynb"
    copy, text = nbformat.read(path, as_version=4), path.read_text(encoding="utf-8")
    cells = [c for c in copy.cells if "injected-parameters" not in c.metadata.get("tags", [])]
    assert [c.source for c in cells] == [c.source for c in read(step.notebook).cells]
    outputs = [o for c in cells if c.cell_type == "code" for o in c.outputs]
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]
    assert any("image/png" in o.get("data", {}) for o in outputs), "pictures, for the web"
    assert len(text) < 1_600_000
    for word in ("PosixPath", str(REPOSITORY), "/root/", "/home/", "Warning", "papermill"):
        assert word not in text, "only what tells a reader something"
