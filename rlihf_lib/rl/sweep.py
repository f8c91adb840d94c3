"""Many runs: skip what is done, spread the rest over worker processes with Dask.

A run that is killed leaves nothing behind, a run that is finished is a folder renamed into place:
so skipping finished runs is also how an interrupted sweep goes on, and how shipped results are
used.
"""

import contextlib
import json
import os
import shutil
import tempfile
import time
from pathlib import Path

import dask
from distributed import Client, LocalCluster, as_completed, get_worker

from rlihf_lib.progress import FILE_NAME, Progress, duration
from rlihf_lib.rl.observer import check_feedback, rows_of

TOPIC = "rlihf-progress"
# Dask looks at what each worker does every 10 ms, which costs a run an eighth of its time, and at
# itself every 20 ms.
QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    # A laptop that slept for five minutes has not lost its workers.
    "distributed.scheduler.worker-ttl": None,
}


def is_done(config, runs_dir):
    """Tell whether the run's folder is there and was made from this very config.

    Parameters
    ----------
    config : RunConfig
    runs_dir : Path

    Returns
    -------
    bool
    """
    folder = Path(runs_dir) / config.run_id
    try:
        recorded = json.loads((folder / "config.json").read_text(encoding="utf-8"))["hash"]
    except (OSError, ValueError, KeyError):
        return False
    return recorded == config.hash and (folder / "eval.csv").is_file()


def run_sweep(
    configs, runs_dir, p_error=None, workers=0, recompute=False, train=None, progress=print
):
    """Train every run that is not done yet.

    Parameters
    ----------
    configs : list of RunConfig
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
        `train(config, folder, p_error, progress)` writes the run's files and calls
        `progress(step)` now and then; `rl.training.train_run` if None.
    progress : callable
        Gets a line of text per finished run.

    Returns
    -------
    int
        How many runs were trained.

    Raises
    ------
    RuntimeError
        If a run failed. The others are finished and kept first.
    ValueError
        If a config names other p(error) rows than the table has; nothing is trained then.

    Notes
    -----
    A worker that dies takes only its run with it: Dask starts another worker, which trains the run
    from its beginning (three times at most). Files travel through Dask, so that workers need no
    disk in common with this machine.
    """
    runs_dir = Path(runs_dir)
    configs = list(dict.fromkeys(configs))
    check_feedback(configs, p_error)
    missing = [config for config in configs if recompute or not is_done(config, runs_dir)]
    if not missing:
        progress(f"all {len(configs)} runs are done already")
        return 0
    # A folder that cannot be written to should be known before hours of training.
    runs_dir.mkdir(parents=True, exist_ok=True)
    n_workers = min(workers or n_cores(), len(missing))
    failures = []
    with (
        _client(n_workers) as client,
        Progress(
            runs_dir.parent / FILE_NAME,
            total=len(configs),
            missing=len(missing),
            n_workers=sum(client.nthreads().values()),
        ) as status,
    ):
        client.subscribe_topic(TOPIC, lambda event: status.advance(*event[1]))
        futures = {
            client.submit(
                _train_on_worker,
                config,
                rows_of(p_error, config.subject) if config.subject else None,
                train,
                key=f"{config.run_id}-{config.hash[:16]}",
                priority=-position,
                pure=False,
            ): config
            for position, config in enumerate(missing)
        }
        for future in as_completed(futures):
            config = futures[future]
            try:
                # Waits for a run that is trained again, its files having died with their worker.
                files, seconds = future.result()
            except Exception as error:
                failures.append((config, error))
                outcome = "failed"
            else:
                write_run(config, runs_dir, files)
                outcome = f"took {duration(seconds)}"
            status.finished(config.run_id)
            progress(f"{config.run_id} {outcome} ({status})")
            future.release()
    if failures:
        config, error = failures[0]
        raise RuntimeError(
            f"{len(failures)} of {len(missing)} runs failed, the others are kept; first "
            f"{config.run_id}: {type(error).__name__}: {error}"
        ) from error
    return len(missing)


def write_run(config, runs_dir, files):
    """Put a run's files in place: into a temporary folder first, then renamed.

    Parameters
    ----------
    config : RunConfig
    runs_dir : Path
    files : dict of str to bytes
        Content by file name.
    """
    target = Path(runs_dir) / config.run_id
    temporary = target.with_name(f".{config.run_id}.{os.getpid()}.partial")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    try:
        for name, content in files.items():
            (temporary / name).write_bytes(content)
        # A folder cannot be renamed over another: the old one goes only once the new is complete.
        shutil.rmtree(target, ignore_errors=True)
        temporary.rename(target)
    except OSError as error:
        raise OSError(
            error.errno, f"cannot write the run {target} ({error.strerror}); is the disk full?"
        ) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def n_cores():
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _train_on_worker(config, p_error, train):
    """Train one run in a temporary folder of the worker; return its files and the seconds."""
    if train is None:
        # Only workers need PyTorch and MuJoCo.
        from rlihf_lib.rl.training import train_run as train
    worker = get_worker()

    def report(step):
        worker.log_event(TOPIC, (config.run_id, step / config.total_steps))

    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="rlihf-run-") as folder:
        folder = Path(folder)
        train(config, folder, p_error, progress=report)
        files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    return files, time.perf_counter() - start


@contextlib.contextmanager
def _client(n_workers):
    """Connect to DASK_SCHEDULER_ADDRESS, or start workers on this machine."""
    address = os.environ.get("DASK_SCHEDULER_ADDRESS")
    if address:
        with Client(address) as client:
            client.wait_for_workers(1, timeout=120)
            yield client
        return
    # More than one thread per process is slower: the workers fill the cores.
    one_thread = {
        name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    }
    with (
        dask.config.set(QUIET),
        LocalCluster(
            n_workers=n_workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # its default port may be taken
            memory_limit=0,
            env=one_thread,
            silence_logs="CRITICAL",
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client
