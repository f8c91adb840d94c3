"""Work in processes."""

import os
import signal
import threading
import time
from multiprocessing import active_children

import psutil
import pytest

from rlihf_lib.parallel import in_processes


@pytest.mark.parametrize("workers", [1, 2])
def test_every_job_is_done_once(workers):
    assert sorted(in_processes(divmod, [(7, 2), (9, 4)], workers)) == [(2, 1), (3, 1)]


def test_workers_have_one_thread_each(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert list(in_processes(os.getenv, [("OMP_NUM_THREADS",)] * 2, workers=2)) == ["1", "1"]


def die_twice(folder, number):
    """Note the attempt; a process that gets the first job dies with its first two attempts."""
    tries = len(list(folder.glob(f"{number}-*")))
    (folder / f"{number}-{tries}").touch()
    if number == 0 and tries < 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_work_of_a_process_that_dies_is_done_by_another(tmp_path):
    jobs = [(tmp_path, number) for number in range(4)]
    assert sorted(in_processes(die_twice, jobs, workers=2)) == [0, 1, 2, 3]
    assert {"0-0", "0-1", "0-2"} <= {path.name for path in tmp_path.iterdir()}


def test_work_that_kills_its_process_every_time_is_given_up_with_a_remedy():
    with pytest.raises(RuntimeError, match=r"3 times a process died .* fewer --workers than 2"):
        list(in_processes(os._exit, [(9,)] * 2, workers=2))


def test_jobs_that_have_begun_end_when_somebody_stops_them():
    # Ignored in what a shell runs in the background, tests too.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(4, os.kill, [os.getpid(), signal.SIGINT]).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            for _ in in_processes(time.sleep, [(1_000,)] * 8, workers=2):
                raise AssertionError("none finishes")
    finally:
        signal.signal(signal.SIGINT, before)
    _, alive = psutil.wait_procs([psutil.Process(p.pid) for p in active_children()], timeout=5)
    assert not alive
