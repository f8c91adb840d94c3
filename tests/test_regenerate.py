"""The command line and the execution of notebooks: what users see, above all when it fails."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import nbformat
import pandas as pd
import pytest

from rlihf_lib import regenerate
from rlihf_lib.__main__ import main
from rlihf_lib.execute import NotebookError, check_parameters, execute
from rlihf_lib.regenerate import select
from rlihf_lib.rl.runs import write_run
from rlihf_lib.study import REPOSITORY, Study


@pytest.fixture
def notebook(tmp_path):
    """Write a notebook from sources of code cells; the first is its parameters cell."""

    def write(*sources):
        nb = nbformat.v4.new_notebook()
        nb.metadata["kernelspec"] = {
            "name": "python3",
            "display_name": "Python 3",
            "language": "python",
        }
        nb.cells = [nbformat.v4.new_code_cell(source) for source in sources]
        nb.cells[0].metadata["tags"] = ["parameters"]
        path = tmp_path / "toy.ipynb"
        nbformat.write(nb, path)
        return path

    return write


@pytest.fixture
def idle(monkeypatch):
    """No notebook may be started."""
    monkeypatch.setattr(regenerate, "execute", lambda *_: pytest.fail("a notebook was started"))


def test_help_is_short_and_starts_without_heavy_imports():
    code = (
        "import sys; from rlihf_lib.__main__ import parser; print(parser().format_help()); "
        "assert not {'torch', 'mne', 'mujoco', 'distributed'} & set(sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert len(result.stdout.splitlines()) <= 25
    for option in ("--profile", "--eeg", "--only", "--workers", "--out", "--recompute", "--list"):
        assert option in result.stdout


def test_an_output_folder_that_cannot_be_written_is_an_error_before_any_work(idle, capsys):
    assert main(["--profile", "smoke", "--out", "/proc/rlihf"]) == 1  # nor can root write there
    message = capsys.readouterr().err
    assert "cannot write to /proc/rlihf" in message and "--out" in message


def test_feedback_that_is_missing_is_said_before_anything_is_trained(idle, tmp_path, capsys):
    assert main(["--profile", "smoke", "--out", str(tmp_path), "--only", "03"]) == 1
    assert "p_error.csv does not exist yet; run notebook 02" in capsys.readouterr().err


def test_runs_that_are_missing_are_said_before_anything_is_decoded(idle, tmp_path, capsys):
    assert main(["--profile", "smoke", "--out", str(tmp_path), "--only", "02", "04"]) == 1
    said = capsys.readouterr().err
    assert "7 runs of" in said and "would read are missing; train them, too: --only 03 04" in said


def test_a_cluster_that_does_not_answer_is_said_before_any_work(
    idle, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("rlihf_lib.rl.sweep.ANSWER", 0.5)
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "tcp://127.0.0.1:9")
    assert main(["--profile", "smoke", "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert "no Dask scheduler answers at DASK_SCHEDULER_ADDRESS=tcp://127.0.0.1:9" in said


def test_only_accepts_numbers_and_names():
    assert [step.title for step in select(["4", "03_policy_training"], Study("smoke"))] == [
        "03_policy_training-sparse",
        "03_policy_training-dense",
        "03_policy_training-rlihf",
        "04_metrics_tables",
    ]
    assert len(select([], Study("smoke"))) == 8
    titles = [step.title for step in select([], Study("pilots"))]
    assert len(titles) == 7 and "05_whf_ablation" not in titles, "there is one weight"


def test_of_a_table_of_p_error_what_reads_eeg_is_left_out(tmp_path):
    (tmp_path / "lab.csv").touch()
    study = Study("smoke", tmp_path / "lab.csv")
    assert {step.notebook[:2] for step in select([], study)} == {"03", "04", "05", "06"}
    with pytest.raises(ValueError, match="no notebook '2' to execute; choose from 03_"):
        select(["2"], study)


def test_notebooks_are_executed_at_once_where_none_trains_or_reads_what_another_writes(
    tmp_path, monkeypatch
):
    study, batches = Study("smoke", out=tmp_path), []
    missing = iter([("02", "03", "06"), ("02", "03", "06"), *3 * [("03", "06")], ("06",), ("06",)])

    def executed(_, jobs, workers):
        batches.append([output.stem[:2] for _, output, *_ in jobs])
        return []

    monkeypatch.setattr(regenerate, "in_processes", executed)
    monkeypatch.setattr(
        Study, "status", lambda self: pd.DataFrame({"stage": next(missing), "missing": 1})
    )
    regenerate.regenerate(study, select([], study))
    assert batches == [["01"], ["02"], ["03"], ["03"], ["03"], ["04", "05"], ["06"]]
    missing, batches[:] = iter([(), ()]), []
    regenerate.regenerate(study, select([], study), workers=8)
    assert batches == [["01", "03", "03", "03"], ["02", "04", "05", "06"]]


def test_events_and_dropped_channels_reach_the_notebooks_that_read_epochs(
    tmp_path, monkeypatch, capsys
):
    given = {}
    monkeypatch.setattr(
        regenerate,
        "execute",
        lambda path, _, parameters, bars: given.update({path.stem: parameters}),
    )
    (tmp_path / "mine").mkdir()
    for who in ("01", "02"):
        (tmp_path / "mine" / f"sub-{who}_epo.fif").write_text(who)
    where = ["--eeg", str(tmp_path / "mine"), "--out", str(tmp_path / "out")]
    options = ["--events", "hit", "miss", "--drop-channels", "label", "STI 014"]
    assert main([*where, *options]) == 1 and not given
    said = capsys.readouterr().err
    assert "mine holds recordings of 2 (01, 02), decoders need three people" in said
    assert main([*where, *options, "--only", "01"]) == 1 and not given
    (tmp_path / "mine" / "sub-03_epo.fif").write_text("03")
    assert main([*where, *options, "--only", "01", "02", "05"]) == 0
    dropped = {name: parameters.get("drop_channels") for name, parameters in given.items()}
    assert dropped == {
        "01_dataset_preprocessing": ["label", "STI 014"],
        "02_loso_decoder": ["label", "STI 014"],
        "05_whf_ablation": None,
    }
    events = {name: parameters.get("events") for name, parameters in given.items()}
    assert events == {
        "01_dataset_preprocessing": ["hit", "miss"],
        "02_loso_decoder": ["hit", "miss"],
        "05_whf_ablation": None,
    }


def test_list_counts_runs_and_says_how_long_the_rest_takes(tmp_path, capsys):
    study = Study("smoke", out=tmp_path)
    rows = study.status(workers=2).set_index("stage")
    assert rows.loc["02_loso_decoder", "missing"] == 3
    assert rows.loc["03_policy_training rlihf", "missing"] == 1
    assert rows.loc["05_whf_ablation", "missing"] == 3
    one, two = rows.loc[["03_policy_training rlihf", "05_whf_ablation"], "seconds"]
    assert one > 0 and two == pytest.approx(one), "two of three side by side, one counted already"
    assert main(["--profile", "smoke", "--out", str(tmp_path), "--list"]) == 0
    assert "everything takes about" in capsys.readouterr().out
    assert not list(tmp_path.iterdir()), "--list must not create anything"


def test_list_counts_runs_that_are_done(tmp_path):
    study = Study("smoke", out=tmp_path)
    (config,) = study.run_configs("dense")
    recorded = json.dumps({"hash": config.hash, "total_steps": config.total_steps})
    files = {"eval.csv": "", "config.json": recorded, "provenance.json": '{"wall_seconds": 30.0}'}
    write_run(config, study.runs, {name: text.encode() for name, text in files.items()})
    rows = study.status(workers=1).set_index("stage")
    assert rows.loc["03_policy_training dense", ["done", "missing"]].tolist() == [1, 0]
    assert rows.loc["03_policy_training sparse", "seconds"] == pytest.approx(30.0)


def test_an_unknown_parameter_is_an_error_not_a_warning(notebook, tmp_path):
    path = notebook("profile = 'quick'", "open('ran', 'w')")
    with pytest.raises(ValueError, match=r"toy.ipynb has no parameter 'profil'; it has profile"):
        execute(path, tmp_path / "out.ipynb", {"profil": "smoke"})
    assert not (tmp_path / "out.ipynb").exists()
    check_parameters(path, {"profile": "smoke"})


def test_an_error_names_notebook_cell_last_line_and_executed_copy(notebook, tmp_path):
    path = notebook(
        "n = 1", "m = n + 1", "value = f'no subject {m}'\nraise ValueError('x\\n' + value)"
    )
    output = tmp_path / "copies" / "toy.ipynb"
    with pytest.raises(NotebookError) as error:
        execute(path, output, {"n": 41})
    message = str(error.value)
    assert "toy.ipynb" in message and "In [4]" in message and "value = f'no subject {m}'" in message
    assert "ValueError: no subject 42" in message and str(output) in message
    assert "no subject 42" in output.read_text()


def test_executed_copies_hold_what_a_reader_sees_and_are_the_same_each_time(notebook, tmp_path):
    sliders = (
        "import matplotlib.pyplot as plt\nfrom rlihf_lib.interact import explore\n"
        "explore(lambda n: plt.subplots(figsize=(1, 1))[0], n=(0, 3, 1))"
    )
    path = notebook("seed = 0", sliders, "print(seed)")
    copies = [tmp_path / "a.ipynb", tmp_path / "b.ipynb"]
    for copy in copies:
        execute(path, copy, {"seed": 1})
    assert copies[0].read_bytes() == copies[1].read_bytes()
    _, injected, sliders, printed = nbformat.read(copies[0], as_version=4).cells
    assert (
        injected.source.split() == ["#", "Parameters", "seed", "=", "1"]
        and printed.outputs[0].text == "1\n"
    )
    (picture,) = sliders.outputs
    assert "image/png" in picture.data, "a picture without sliders"


ALL = ("profile", "eeg", "out", "workers", "recompute", "ship", "events", "drop_channels")
PARAMETERS = "\n".join(f"{name} = None" for name in ALL)
MEET = """
import time
from pathlib import Path
(Path(out) / "{me}").touch()
until = time.monotonic() + 60
while not (Path(out) / "{other}").exists():
    assert time.monotonic() < until, "nobody came"
    time.sleep(0.05)
"""


def test_notebooks_that_only_draw_are_executed_side_by_side(notebook, tmp_path, monkeypatch):
    names = "04_metrics_tables", "05_whf_ablation"
    for me, other in (names, names[::-1]):
        notebook(PARAMETERS, MEET.format(me=me, other=other)).rename(tmp_path / f"{me}.ipynb")
    monkeypatch.setattr(regenerate, "NOTEBOOKS", tmp_path)
    monkeypatch.setattr(Study, "p_error", lambda self: None)
    status = pd.DataFrame({"stage": ["03_policy_training dense"], "missing": [0]})
    monkeypatch.setattr(Study, "status", lambda self: status)
    study = Study("smoke", out=tmp_path)
    regenerate.regenerate(study, select(["04", "05"], study), workers=2)
    assert {path.stem for path in study.notebooks.iterdir()} == set(names)
    notebook(PARAMETERS, "1 / 0").rename(tmp_path / "05_whf_ablation.ipynb")
    with pytest.raises(NotebookError, match=r"05_whf_ablation.ipynb, cell In \[3\]"):
        regenerate.regenerate(study, select(["04", "05"], study), workers=2)


def test_notebooks_in_somebodys_output_are_replaced_not_executed(notebook, tmp_path, monkeypatch):
    study = Study("smoke", out=tmp_path / "theirs")
    study.notebooks.mkdir(parents=True)
    evil = notebook(PARAMETERS, "open('executed', 'w')")
    for place in (study.notebooks, study.out / "notebooks", study.out):
        place.mkdir(exist_ok=True)
        shutil.copy(evil, place / "01_dataset_preprocessing.ipynb")
    notebook(PARAMETERS, "n = 1").rename(tmp_path / "01_dataset_preprocessing.ipynb")
    monkeypatch.setattr(regenerate, "NOTEBOOKS", tmp_path)
    monkeypatch.chdir(study.out)
    regenerate.regenerate(study, select(["01"], study), workers=1)
    assert not list(tmp_path.rglob("executed"))
    assert "n = 1" in (study.notebooks / "01_dataset_preprocessing.ipynb").read_text()


def test_a_kernel_heeds_and_leaves_nothing_at_home(notebook, tmp_path, monkeypatch):
    startup = tmp_path / "home/.ipython/profile_default/startup"
    startup.mkdir(parents=True)
    (startup / "mine.py").write_text("n = 2")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("MPLCONFIGDIR", raising=False)  # CI's own
    before = {*(tmp_path / "home").rglob("*")}
    path = notebook(
        "m = 1", "import matplotlib.pyplot as plt; plt.figure(); assert 'n' not in dir()"
    )
    execute(path, tmp_path / "out.ipynb", {})
    assert {*(tmp_path / "home").rglob("*")} == before and "MPLCONFIGDIR" not in os.environ
    assert list((tmp_path / "cache/matplotlib").glob("fontlist*"))


def test_compiled_code_is_taken_from_where_only_its_user_can_write(notebook, tmp_path, monkeypatch):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    path = notebook("m = 1", "import os; print(os.environ['NUMBA_CACHE_DIR'])")

    def place():
        execute(path, tmp_path / "out.ipynb", {})
        return nbformat.read(tmp_path / "out.ipynb", 4).cells[-1].outputs[0].text.strip()

    numba = tmp_path / "cache" / "numba"
    assert place() == str(numba) and numba.stat().st_mode & 0o077 == 0
    numba.chmod(0o777)
    assert not place().startswith(str(tmp_path))


def test_nothing_of_ours_unpickles():
    sources = "\n".join(path.read_text() for path in (REPOSITORY / "rlihf_lib").rglob("*.py"))
    for word in ("import pickle", "allow_pickle", "torch.load(", "read_pickle", "joblib"):
        assert word not in sources


def test_a_disk_that_fills_up_under_a_copy_is_named(notebook, full_disk):
    disk, _ = full_disk
    path = notebook("n = 1", "print('x' * 2**16)")
    with pytest.raises(OSError, match=r"cannot write .*out.ipynb .* another folder: --out"):
        execute(path, disk / "out.ipynb", {})


def test_full_places_are_named_before_any_work(idle, full_disk, tmp_path, monkeypatch, capsys):
    disk, _ = full_disk
    (disk / "filled").write_bytes(bytes(4096))
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(disk))
    assert main(["--profile", "smoke", "--out", str(tmp_path / "out"), "--only", "01"]) == 1
    assert f"cannot write to {disk} (No space left" in capsys.readouterr().err


@pytest.mark.parametrize("variable", ["RLIHF_CACHE", "TMPDIR"])
def test_places_that_cannot_be_written_are_named_before_any_work(
    variable, idle, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv(variable, "/proc/rlihf")
    # Python would look for another place, and then name them all.
    monkeypatch.setattr("tempfile.gettempdir", lambda: os.environ.get("TMPDIR", str(tmp_path)))
    assert main(["--profile", "smoke", "--out", str(tmp_path / "out"), "--only", "01"]) == 1
    said = capsys.readouterr().err
    assert "cannot write to /proc/rlihf" in said and f"another folder with {variable}" in said


def test_a_user_without_a_home_is_told_to_give_one(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("os.getuid", lambda: 54_321)
    for name in ("RLIHF_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    assert main(["--profile", "smoke", "--out", str(tmp_path / "out"), "--only", "01"]) == 1
    assert "has no home folder; set HOME to a folder" in capsys.readouterr().err


def test_the_command_exits_1_on_an_error_in_a_notebook(notebook, tmp_path, monkeypatch, capsys):
    notebook(PARAMETERS, "1 / 0").rename(tmp_path / "01_dataset_preprocessing.ipynb")
    monkeypatch.setattr("rlihf_lib.regenerate.NOTEBOOKS", tmp_path)
    assert main(["--profile", "smoke", "--only", "01", "--out", str(tmp_path / "out")]) == 1
    message = capsys.readouterr().err
    assert (
        "01_dataset_preprocessing.ipynb" in message
        and "ZeroDivisionError: division by zero" in message
    )


def test_piped_progress_is_a_line_now_and_then(notebook, tmp_path, capsys):
    execute(notebook("n = 1", "n"), tmp_path / "out.ipynb", {"n": 2})
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["out: started", "out: finished"]


def test_kill_9_of_the_command_takes_the_kernel_with_it(notebook, tmp_path):
    path = notebook(
        "n = 1", "import os, time\nopen('kernel.pid', 'w').write(str(os.getpid()))\ntime.sleep(60)"
    )
    code = (
        "from pathlib import Path; from rlihf_lib.execute import execute; "
        f"execute(Path({str(path)!r}), Path('out.ipynb'), {{}})"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.DEVNULL
    )
    pid_file = tmp_path / "kernel.pid"
    deadline = time.time() + 60
    while not (pid_file.exists() and pid_file.read_text()):
        assert time.time() < deadline and process.poll() is None
        time.sleep(0.1)
    kernel = int(pid_file.read_text())
    process.send_signal(signal.SIGKILL)
    process.wait()
    while _alive(kernel):
        assert time.time() < deadline, "the kernel outlived the command"
        time.sleep(0.2)


def _alive(pid):
    try:
        os.kill(pid, 0)
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rsplit(")", 1)[1].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False
