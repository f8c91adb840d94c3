"""Work spread over processes of this machine, which end at once when it is stopped or killed."""

import contextlib
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, connection, get_context, parent_process

ATTEMPTS = 3
# Workers fill the cores; with more threads each, they wait for one another.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


def in_processes(
    run: Callable, jobs: Iterable[tuple], workers: int, initializer: Callable | None = None
) -> Iterator:
    """Give what `run(*job)` returns, in the order in which jobs finish.

    In `workers` processes of one thread, each begun by `initializer`; of one worker or none: here.
    If a process dies, what is left is tried twice more, then a RuntimeError says so.
    """
    if workers <= 1:
        yield from (run(*job) for job in jobs)
        return
    left = dict(enumerate(jobs))
    for _ in range(ATTEMPTS):
        with contextlib.suppress(BrokenProcessPool):
            for number, result in _in_pool(run, dict(left), workers, initializer):
                del left[number]
                yield result
            return
    raise RuntimeError(
        f"{ATTEMPTS} times a process died at work, killed or for want of memory; try again with "
        f"fewer --workers than {workers}"
    )


def _in_pool(run, jobs, workers, initializer):
    """Number of each job, as it finishes, and its result."""
    # Spawned, because a forked process inherits the locks of PyTorch's and MNE's threads.
    others = set(active_children())
    with ProcessPoolExecutor(workers, get_context("spawn"), _begin, (initializer,)) as executor:
        try:
            futures = {executor.submit(run, *job): number for number, job in jobs.items()}
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:  # stopped, too: jobs that have begun would take their time
            for worker in set(active_children()) - others:
                worker.terminate()
            raise


def _begin(initializer):
    """Begin a worker, which ends when its parent does, even if that is killed."""
    os.environ.update(ONE_THREAD)  # of what it starts or imports
    threading.Thread(target=_end_with, args=[parent_process()], daemon=True).start()
    if initializer:
        initializer()


def _end_with(parent):
    connection.wait([parent.sentinel])
    os._exit(1)
