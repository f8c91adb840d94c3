"""The command, stopped or robbed of its kernel in each phase: it says so, and nothing goes on."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import nbformat
import psutil
import pytest

from rlihf_lib.study import REPOSITORY
from tests.campaign import contents

NAMES = ("profile", "eeg", "out", "workers", "recompute", "ship")
PARAMETERS = "\n".join(f"{name} = None" for name in NAMES)
COMMAND = """
import signal, sys
from pathlib import Path
from rlihf_lib import regenerate
from rlihf_lib.__main__ import main
from rlihf_lib.study import Study
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what runs behind a shell
    regenerate.NOTEBOOKS = Path()
    Study.p_error = lambda self: None
    missing = {"stage": ["05"], "missing": [sys.argv[1] != "side by side"]}
    Study.status = lambda *_: __import__("pandas").DataFrame(missing)
    sys.exit(main(["--profile", "smoke", "--out", "out", "--workers", "2", "--only", "04", "05"]))
"""
#: What a notebook is at when the signal comes, and the processes it has then.
PHASES = {
    "computing": ("while True:\n    sum(range(1000))", 1),
    "in processes": (
        "import time\nfrom rlihf_lib.parallel import in_processes\n"
        "list(in_processes(time.sleep, [(1000,)] * 4, 2))",
        3,
    ),
    "in a sweep": (
        "from rlihf_lib.rl.runs import RunConfig\nfrom rlihf_lib.rl.sweep import run_sweep\n"
        "configs = [RunConfig('sparse', seed, 10**6, 10**5) for seed in (0, 1)]\n"
        "run_sweep(configs, 'runs', workers=2)",
        3,
    ),
    "side by side": ("import time\ntime.sleep(1000)", 4),
}
BEGUN = "import os\nopen(f'{os.getpid()}.begun', 'w').close()"
WORK = "from pathlib import Path\nfrom tests.campaign import work\nwork(Path('done'))"


def is_kernel(process):
    return process.is_running() and "ipykernel_launcher" in process.cmdline()


@pytest.fixture
def begun(tmp_path):
    """Begin the command in a phase; return it and its processes once that is reached."""
    processes = []

    def begin(phase):
        source, least = (PHASES | {"at work": (WORK, 3)})[phase]
        second = source if phase == "side by side" else ""
        kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
        for name, text in (("04_metrics_tables", source), ("05_whf_ablation", second)):
            cells = [nbformat.v4.new_code_cell(part) for part in (PARAMETERS, f"{BEGUN}\n{text}")]
            cells[0].metadata["tags"] = ["parameters"]
            nb = nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})
            nbformat.write(nb, tmp_path / f"{name}.ipynb")
        (tmp_path / "command.py").write_text(textwrap.dedent(COMMAND))
        command = subprocess.Popen(
            [sys.executable, "command.py", phase],
            cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        processes.append(command)
        deadline = time.monotonic() + 120
        while (
            len(family := psutil.Process(command.pid).children(recursive=True)) < least
            or not len([*tmp_path.glob("*.begun")]) == sum(map(is_kernel, family)) > 0
        ):
            assert time.monotonic() < deadline and command.poll() is None, command.stderr.read()
            time.sleep(0.2)
        time.sleep(1)  # at what it has begun
        return command, psutil.Process(command.pid).children(recursive=True) or family

    yield begin
    for process in processes:
        process.kill()


@pytest.mark.parametrize("code", [130, 143])
@pytest.mark.parametrize("phase", PHASES)
def test_a_signal_ends_the_command_with_its_code_and_one_sentence(phase, code, begun):
    command, family = begun(phase)
    command.send_signal(signal.Signals(code - 128))
    asked = time.monotonic()
    said = command.communicate(timeout=60)[1]
    assert command.returncode == code, said
    # What ends while it is starting may say so; nothing of ours does.
    assert "interrupted; the same command goes on from here" in said.splitlines(), said
    assert "rlihf_lib/" not in said, said
    _, alive = psutil.wait_procs(family, timeout=10)
    assert not alive and time.monotonic() - asked < 15, "5 s where nothing else runs"


def test_ctrl_c_while_libraries_are_imported_is_one_sentence(tmp_path, monkeypatch):
    (tmp_path / "pandas.py").write_text("raise KeyboardInterrupt")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    command = [sys.executable, "-m", "rlihf_lib", "--list"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "\ninterrupted; nothing was begun\n")


def test_a_kernel_that_is_killed_is_named_in_one_sentence(begun, tmp_path):
    command, family = begun("in processes")
    (kernel,) = filter(is_kernel, family)
    kernel.kill()
    said = command.communicate(timeout=60)[1]
    assert command.returncode == 1
    lines = said.strip().splitlines()  # before, nbclient and Python say as much
    assert len(lines) <= 5 and "Traceback" not in said, said
    assert lines[-2] == (
        "rlihf_lib: the kernel of notebook 04_metrics_tables.ipynb died; was it killed for want of "
        "memory?"
    )
    copy = tmp_path / "out/results/smoke-simulated/notebooks/04_metrics_tables.ipynb"
    assert lines[-1] == f"  executed copy, as far as it came: {copy}"
    assert not psutil.wait_procs(family, timeout=10)[1], "workers outlive their kernel"


def test_work_whose_kernel_was_killed_is_the_same_when_it_is_done_again(
    begun, undisturbed_work, tmp_path
):
    command, family = begun("at work")
    next(filter(is_kernel, family)).kill()
    assert command.wait(60) == 1 and not psutil.wait_procs(family, timeout=10)[1]
    again = subprocess.run([sys.executable, "command.py", "at work"], cwd=tmp_path)
    assert again.returncode == 0
    assert contents(tmp_path / "done") == contents(undisturbed_work[0])
