"""Many runs: skip what is done, spread the rest over worker processes with Dask.

A run that is killed leaves nothing behind, one that is finished is a folder renamed into place: so
skipping finished runs is also how an interrupted sweep goes on, and how shipped results are used.
"""

import contextlib
import os
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import dask
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster, Security, as_completed, get_worker

from rlihf_lib.files import one_at_a_time
from rlihf_lib.parallel import ONE_THREAD
from rlihf_lib.progress import Progress
from rlihf_lib.rl.feedback import check_feedback, rows_of
from rlihf_lib.rl.runs import is_done, write_run

TOPIC = "rlihf-progress"
ANSWER = 5  # s, within which the scheduler of a cluster answers
# Dask looks at what each worker does every 10 ms, which costs a run an eighth of its time, and at
# itself every 20 ms.
QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.scheduler.allowed-failures": 2,
    # A laptop that slept for five minutes has not lost its workers.
    "distributed.scheduler.worker-ttl": None,
    # Nothing is served to browsers.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}


def run_sweep(
    configs, runs_dir, p_error=None, workers: int = 0, recompute: bool = False, train=None
) -> int:
    """Train every run that is not done yet, showing how far they are.

    Parameters
    ----------
    configs : iterable of RunConfig
    runs_dir : Path
        Gets one folder per run, named by its `run_id`.
    p_error : DataFrame or None
        The p(error) table of held-out epochs; None where no run needs feedback.
    workers : int
        Worker processes on this machine; 0 = one per core. Ignored when the environment variable
        DASK_SCHEDULER_ADDRESS names a running cluster, which is used instead.
    recompute : bool
        Train runs anew that are done.
    train : callable, optional
        `train(config, p_error, progress)` returns the run's files and calls
        `progress(step, success)` now and then; `rl.training.train_run` if None.

    Returns
    -------
    int
        How many runs were trained.

    Raises
    ------
    RuntimeError, ValueError
        If a run failed, once the others are finished and kept; if a config names other p(error)
        rows than the table has, before anything is trained.

    Notes
    -----
    A worker that dies takes only its run with it: Dask starts another, which trains the run from
    its beginning, twice at most. Files travel through Dask: workers need no common disk.
    On this machine they know one another by keys made for the sweep. Whoever reaches the ports of a
    cluster of your own runs code as you, unless it uses TLS, as Dask's manual explains
    (https://distributed.dask.org/en/stable/tls.html).
    """
    runs_dir, configs = Path(runs_dir), list(dict.fromkeys(configs))
    check_feedback(configs, p_error)
    if not recompute and all(is_done(config, runs_dir) for config in configs):
        return 0
    with one_at_a_time(runs_dir):
        # Another command may have trained some meanwhile.
        missing = [config for config in configs if recompute or not is_done(config, runs_dir)]
        return _train_all(missing, len(configs), runs_dir, p_error, workers, train)


def _train_all(missing, n_runs, runs_dir, p_error, workers, train):
    """Train the missing ones of so many runs; return how many."""
    if not missing:
        return 0
    n_workers = min(workers or CPU_COUNT, len(missing))
    # Dask blames what waits on a worker for its death. A cluster may grow by what waits.
    at_once = len(missing) if os.environ.get("DASK_SCHEDULER_ADDRESS") else n_workers
    failures = []
    with (
        _client(n_workers) as client,
        Progress(n_runs, n_runs - len(missing), "runs") as progress,
    ):
        client.subscribe_topic(TOPIC, lambda event: progress.advance(*event[1]))
        waiting, running, results = iter(enumerate(missing)), {}, as_completed()

        def begin(n):
            for position, config in islice(waiting, n):
                rows = rows_of(p_error, config.subject) if config.subject else None
                key = f"{config.run_id}-{config.hash[:16]}"
                how = {"key": key, "priority": -position, "pure": False}
                future = client.submit(_train_on_worker, config, rows, train, **how)
                running[future] = config
                results.add(future)

        begin(at_once)
        for future in results:
            config = running.pop(future)
            try:
                # Waits for a run that is trained again, its files having died with their worker.
                files = future.result()
            except Exception as failed:
                failures.append((config, failed))
            else:
                write_run(config, runs_dir, files)
            progress.finished(config.run_id)
            future.release()
            begin(1)
    if failures:
        config, error = failures[0]
        raise RuntimeError(
            f"{len(failures)} of {len(missing)} runs failed, the others are kept; first "
            f"{config.run_id}: {type(error).__name__}: {error}"
        ) from error
    return len(missing)


def _train_on_worker(config, p_error, train):
    """Train one run; return its files."""
    if train is None:
        # Only workers need PyTorch and MuJoCo.
        from rlihf_lib.rl.training import train_run as train
    worker = get_worker()

    def report(step, success):
        note = f", success {success:.2f}"
        worker.log_event(TOPIC, (config.run_id, step / config.total_steps, note))

    return train(config, p_error, report)


def check_cluster() -> None:
    """Raise an OSError unless a scheduler answers at DASK_SCHEDULER_ADDRESS."""
    address = os.environ["DASK_SCHEDULER_ADDRESS"]
    try:
        Client(address, timeout=ANSWER).close()
    except (OSError, TimeoutError, ValueError) as error:
        raise OSError(
            f"no Dask scheduler answers at DASK_SCHEDULER_ADDRESS={address} ({error}); start it, "
            "or unset the variable to train on this machine"
        ) from error


@contextlib.contextmanager
def _client(n_workers) -> Iterator[Client]:
    """Connect to DASK_SCHEDULER_ADDRESS, or start workers on this machine."""
    if address := os.environ.get("DASK_SCHEDULER_ADDRESS"):
        with Client(address) as client:
            client.wait_for_workers(1, timeout=120)
            yield client
        return
    settings = {
        # Keys made for this cluster, in memory: other users of the machine reach its ports, too.
        "security": Security.temporary(),
        "n_workers": n_workers,
        "threads_per_worker": 1,
        "dashboard_address": "127.0.0.1:0",  # none, but by default the port for it is everybody's
        "scheduler_kwargs": {"dashboard": False},
        "memory_limit": 0,
        "env": ONE_THREAD,
        "silence_logs": "CRITICAL",
    }
    with dask.config.set(QUIET), LocalCluster(**settings) as cluster, Client(cluster) as client:
        yield client
