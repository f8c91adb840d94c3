"""Files and folders that survive kills, full disks and two commands at once."""

import errno
import fcntl
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import psutil
import pytest

from rlihf_lib.files import atomic_path, check_sums, one_at_a_time, sums, write_sums
from rlihf_lib.report.saving import enter, manifest
from rlihf_lib.study import Study

HOLD = """
import sys, time
from rlihf_lib.files import one_at_a_time
with one_at_a_time(sys.argv[1]):
    print("in", flush=True)
    time.sleep(float(sys.argv[2]))
    print(time.monotonic(), file=sys.stderr)
"""
POOL = """
import time
from rlihf_lib.parallel import in_processes
if __name__ == "__main__":
    list(in_processes(time.sleep, [(1_000,)] * 4, workers=2))
"""


def start(folder, seconds):
    command = [sys.executable, "-c", HOLD, str(folder), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_second_process_waits_for_the_first_and_says_for_whom(tmp_path):
    first = start(tmp_path / "runs", 2)
    assert first.stdout.readline() == "in\n"
    second = start(tmp_path / "runs", 0)
    out, err = second.communicate(timeout=30)
    left = first.communicate(timeout=30)[1]
    assert first.returncode == 0
    came_too_early = "the second came in before the first had left"
    assert float(err.split()[-1]) > float(left.split()[-1]), came_too_early
    assert out == "in\n" and f"waiting for process {first.pid} on" in err


def test_a_killed_process_holds_no_lock_and_leaves_nothing_half_written(tmp_path):
    first = start(tmp_path, 100)
    assert first.stdout.readline() == "in\n"
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    (tmp_path / f".dense-seed0.{first.pid}.partial").mkdir()
    (tmp_path / f".eval.{first.pid}.partial.csv").write_text("half")
    (tmp_path / "dense-seed1").mkdir()
    started = time.time()
    with one_at_a_time(tmp_path):
        assert time.time() - started < 1
        assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", "dense-seed1"]


def test_workers_end_when_their_parent_is_killed(tmp_path):
    (tmp_path / "pool.py").write_text(POOL)
    parent = subprocess.Popen([sys.executable, "pool.py"], cwd=tmp_path)
    deadline = time.time() + 60
    while len(workers := psutil.Process(parent.pid).children(recursive=True)) < 3:  # and a tracker
        assert time.time() < deadline and parent.poll() is None
        time.sleep(0.1)
    time.sleep(2)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    _, alive = psutil.wait_procs(workers, timeout=10)
    assert not alive


def test_a_write_that_fails_leaves_the_file_as_it_was(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("whole")
    with pytest.raises(OSError, match=r"cannot write .*table.csv .*; is the disk full"):
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            raise OSError(28, "No space left on device")
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"] and path.read_text() == "whole"


def test_what_was_left_half_written_goes_when_nobody_can_be_at_it_any_more(tmp_path):
    for pid, age in ((1, 7200), (2, 60)):
        left = tmp_path / f".table.{pid}.partial.csv"
        left.write_text("half")
        os.utime(left, (time.time() - age,) * 2)
    with atomic_path(tmp_path / "table.csv") as temporary:
        temporary.write_text("whole")
    assert sorted(p.name for p in tmp_path.iterdir()) == [".table.2.partial.csv", "table.csv"]


def test_sums_name_what_has_changed_and_what_is_gone(tmp_path):
    assert not check_sums(tmp_path)
    for name in ("a", "b"):
        (tmp_path / name).write_text(name)
    write_sums(tmp_path, ["b", "a"])
    assert check_sums(tmp_path) and (tmp_path / "SHA256SUMS").read_text() == sums(
        {"a": b"a", "b": b"b"}
    )
    (tmp_path / "a").unlink()
    with pytest.raises(ValueError, match="a is gone"):
        check_sums(tmp_path)
    assert check_sums(tmp_path, may_lack=["a"])
    (tmp_path / "a").write_text("c")
    with pytest.raises(ValueError, match="a is not what was written"):
        check_sums(tmp_path, may_lack=["a"])


@pytest.mark.parametrize("left", ["", "\n", "\0\xff", "0" * 30])
def test_sums_that_were_cut_or_a_table_they_do_not_name_are_not_believed(left, tmp_path):
    for name in ("config.json", "eval.csv"):
        (tmp_path / name).write_text(name)
    write_sums(tmp_path, ["config.json"])
    with pytest.raises(ValueError, match=r"eval.csv is not what was written"):
        check_sums(tmp_path)
    (tmp_path / "SHA256SUMS").write_text(left, encoding="latin-1")
    with pytest.raises(ValueError, match=f"{tmp_path}.* is not what was written"):
        check_sums(tmp_path)


def test_a_place_that_cannot_be_locked_or_made_is_named(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"cannot create the folder .*file/runs .*; make its place"):
        with one_at_a_time(tmp_path / "file" / "runs"):
            pass

    def refuse(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(OSError, match=r"cannot lock .*\.lock \(No locks available\), as some"):
        with one_at_a_time(tmp_path / "runs"):
            pass


def test_entries_made_at_once_are_all_kept(tmp_path):
    study = Study("smoke", out=tmp_path)
    names = [f"figure_{i}" for i in range(40)]
    with ThreadPoolExecutor(8) as executor:
        list(executor.map(lambda name: enter(study, name, "04_metrics_tables", {}), names))
    assert sorted(manifest(study.figures)) == sorted(names)
