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
