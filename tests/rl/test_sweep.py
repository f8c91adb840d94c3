"""Sweeps: finished runs are skipped, deaths cost only the runs in flight."""

import hashlib
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

import dask
import pandas as pd
import psutil
import pytest
from distributed import Client, LocalCluster, Security

from rlihf_lib import progress
from rlihf_lib.rl import sweep
from rlihf_lib.rl.feedback import p_error_sha256, perfect_table
from rlihf_lib.rl.runs import RunConfig, is_done, write_run
from rlihf_lib.rl.sweep import run_sweep

# A training function in a module of its own, as workers must be able to import it.
FAKE_TRAINING = '''
import json, os, time
from pathlib import Path

from distributed import get_worker


def train(config, p_error, progress):
    """Return what a run returns; a pure function of the config and the p(error) rows."""
    control = Path(os.environ["FAKE_CONTROL"])
    with open(control / "log", "a") as log:
        log.write(config.run_id + "\\n")
    if "profile" in get_worker().periodic_callbacks:
        (control / "profiled").touch()
    progress(config.total_steps // 2, 0.25)
    if (control / "slow").exists():
        time.sleep(0.7)
    if config.seed == 3 and (control / "die-once").exists():
        (control / "die-once").unlink()
        os.kill(os.getpid(), 9)
    if config.seed == 3 and (control / "die").exists():
        os.kill(os.getpid(), 9)
    if config.seed == 1 and (control / "fail").exists():
        raise FloatingPointError("the critic is NaN")
    mean = float(p_error["p_error"].mean()) if p_error is not None else 0.0
    recorded = json.dumps({**config.to_dict(), "hash": config.hash})
    rows = f"step,return\\n0,{config.seed + mean!r}\\n"
    return {"eval.csv": rows.encode(), "config.json": recorded.encode()}
'''


SWEEP = """
from fake_training import train
from rlihf_lib.rl.runs import RunConfig
from rlihf_lib.rl.sweep import run_sweep
if __name__ == "__main__":
    configs = [RunConfig("dense", seed, total_steps=10, eval_every=5) for seed in range(8)]
    run_sweep(configs, {runs!r}, train=train, workers=2)
"""


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """The fake training function, and the folder whose files say how it behaves."""
    (tmp_path / "fake_training.py").write_text(FAKE_TRAINING)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setenv("FAKE_CONTROL", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    sys.modules.pop("fake_training", None)
    import fake_training

    return fake_training.train, tmp_path


def configs(n):
    return [RunConfig(condition="dense", seed=i, total_steps=10, eval_every=5) for i in range(n)]


def feedback_config(p_error):
    return RunConfig(
        condition="rlihf", seed=0, total_steps=10, eval_every=5, eeg="x", subject="s02", w_hf=0.7,
        p_error_sha256=p_error_sha256(p_error, "s02"),
    )  # fmt: skip


def trained(folder):
    log = folder / "log"
    return log.read_text().split() if log.exists() else []


def contents(runs_dir):
    """Hash of every file of every run; hidden leftovers would show up, too, but for the lock."""
    return {
        str(path.relative_to(runs_dir)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(runs_dir.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


def test_dask_does_not_sample_the_workers(fake):
    train, folder = fake
    run_sweep(configs(1), folder / "study" / "runs", train=train, workers=1)
    assert trained(folder) == ["dense-seed0"] and not (folder / "profiled").exists()


def test_finished_runs_are_skipped_and_changed_or_recomputed_ones_are_not(fake):
    train, folder = fake
    runs = folder / "study" / "runs"
    assert run_sweep(configs(2), runs, train=train, workers=1) == 2
    assert all(is_done(config, runs) for config in configs(2))
    assert run_sweep(configs(2), runs, train=train, workers=1) == 0
    longer = RunConfig(condition="dense", seed=0, total_steps=20, eval_every=5)
    assert longer.run_id == configs(1)[0].run_id
    assert not is_done(longer, runs)
    assert run_sweep([longer], runs, train=train, workers=1) == 1
    assert is_done(longer, runs)
    run_sweep([longer], runs, train=train, workers=1, recompute=True)
    assert len(trained(folder)) == 4


def test_a_run_gets_the_rows_of_its_own_subject_only(fake):
    train, folder = fake
    table = pd.DataFrame(
        {"subject": ["s02", "s03", "s02"], "epoch": 0, "label": 0, "p_error": [0.25, 0.9, 0.5]}
    )
    config = feedback_config(table)
    run_sweep([config], folder / "runs", p_error=table, workers=1, train=train)
    assert "0,0.375" in (folder / "runs" / config.run_id / "eval.csv").read_text()


def test_feedback_without_a_table_is_refused(fake):
    train, folder = fake
    config = feedback_config(perfect_table().assign(subject="s02"))
    with pytest.raises(ValueError, match=r"'s02' is not in the p\(error\) table \(there: none\)"):
        run_sweep([config], folder / "runs", workers=1, train=train)


def test_a_worker_that_dies_costs_only_its_run_which_is_retried(fake):
    train, folder = fake
    (folder / "die-once").touch()
    run_sweep(configs(4), folder / "runs", train=train, workers=2)
    assert not (folder / "die-once").exists(), "no worker died: the test tested nothing"
    assert all(is_done(config, folder / "runs") for config in configs(4))
    assert trained(folder).count("dense-seed3") == 2
    assert trained(folder).count("dense-seed0") == 1


def test_a_run_that_kills_every_worker_is_named_and_the_others_are_kept(fake):
    train, folder = fake
    (folder / "die").touch()
    with pytest.raises(RuntimeError, match=r"1 of 4 runs failed.*dense-seed3: KilledWorker"):
        run_sweep(configs(4), folder / "runs", train=train, workers=2)
    assert [is_done(config, folder / "runs") for config in configs(4)] == [True] * 3 + [False]
    assert trained(folder).count("dense-seed3") == 3, "once, and twice more"


def test_results_that_die_with_a_worker_before_they_are_fetched_are_made_again(fake, monkeypatch):
    train, folder = fake
    killed = []

    def busy(*run):
        """While the first is written, kill the workers: one of them holds the second, finished."""
        if not killed:
            time.sleep(2)
            workers = psutil.Process().children(recursive=True)
            killed.extend(p for p in workers if any("spawn_main" in word for word in p.cmdline()))
            for worker in killed:
                worker.kill()
            time.sleep(2)
        write_run(*run)

    monkeypatch.setattr(sweep, "write_run", busy)
    run_sweep(configs(3), folder / "runs", train=train, workers=2)
    counts = [trained(folder).count(config.run_id) for config in configs(3)]
    assert max(counts) == 2, "no result was lost: nothing was tested"
    assert all(is_done(config, folder / "runs") for config in configs(3))


def test_a_failing_run_is_named_and_the_others_are_kept(fake):
    train, folder = fake
    (folder / "fail").touch()
    with pytest.raises(RuntimeError, match=r"1 of 3 runs failed.*dense-seed1.*critic is NaN"):
        run_sweep(configs(3), folder / "runs", train=train, workers=1)
    assert [is_done(config, folder / "runs") for config in configs(3)] == [True, False, True]


def test_kill_9_in_the_middle_then_resume_equals_an_uninterrupted_sweep(fake):
    train, folder = fake
    (folder / "slow").touch()
    runs = folder / "killed" / "runs"
    (folder / "sweep_script.py").write_text(SWEEP.format(runs=str(runs)))
    process = subprocess.Popen(
        [sys.executable, "sweep_script.py"], cwd=folder, stdout=subprocess.DEVNULL
    )
    deadline = time.time() + 60
    while sum(is_done(config, runs) for config in configs(8)) < 2:
        assert time.time() < deadline and process.poll() is None
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    done = [config for config in configs(8) if is_done(config, runs)]
    assert 2 <= len(done) < 8
    time.sleep(2)
    before = len(trained(folder))
    time.sleep(2)
    assert len(trained(folder)) == before, "workers went on after their sweep was killed"

    (folder / "slow").unlink()
    (folder / "log").unlink()
    run_sweep(configs(8), runs, train=train, workers=2)
    assert sorted(trained(folder)) == sorted(
        config.run_id for config in configs(8) if config not in done
    )
    whole = folder / "whole" / "runs"
    run_sweep(configs(8), whole, train=train, workers=2)
    assert contents(runs) == contents(whole)


def test_two_sweeps_at_once_train_no_run_twice(fake):
    _, folder = fake
    (folder / "slow").touch()
    runs = folder / "runs"
    (folder / "twice.py").write_text(SWEEP.format(runs=str(runs)))
    both = [subprocess.Popen([sys.executable, "twice.py"], cwd=folder) for _ in range(2)]
    assert [process.wait(120) for process in both] == [0, 0]
    assert sorted(trained(folder)) == [config.run_id for config in configs(8)]
    assert all(is_done(config, runs) for config in configs(8))


def test_strangers_reach_neither_scheduler_nor_workers(fake):
    with sweep._client(1) as client:
        workers = client.scheduler_info()["workers"]
        nannies = [worker["nanny"] for worker in workers.values()]
        addresses = [client.scheduler.address, *workers, *nannies]
        (port,) = client.scheduler_info()["services"].values() or [0]
        for page in ("", "status", "health", "info/main/workers.html"):
            with pytest.raises(urllib.error.URLError):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}")
        assert all(address.startswith("tls://127.0.0.1:") for address in addresses)
        for address in addresses:
            for other in (None, Security.temporary()):
                scheme = "tls" if other else "tcp"
                with pytest.raises((OSError, TimeoutError)):
                    Client(address.replace("tls", scheme), security=other, timeout=3).close()
        own = [psutil.Process(), *psutil.Process().children(recursive=True)]
        listening = [c.laddr.ip for p in own for c in p.net_connections() if c.status == "LISTEN"]
        assert len(listening) >= 3 and set(listening) == {"127.0.0.1"}


def test_runs_of_a_worker_that_leaves_a_cluster_go_to_another(fake, monkeypatch):
    train, folder = fake
    (folder / "slow").touch()
    layout = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**layout, silence_logs="CRITICAL") as cluster, Client(cluster) as client:
        leaving = next(iter(client.scheduler_info()["workers"]))
        leaves = threading.Timer(1.0, client.retire_workers, [[leaving]], {"close_workers": True})
        leaves.start()
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", cluster.scheduler_address)
        run_sweep(configs(6), folder / "runs", train=train)
        leaves.join()
        assert leaving not in client.scheduler_info()["workers"]
    assert all(is_done(config, folder / "runs") for config in configs(6))


def test_a_scheduler_named_in_the_environment_is_used(fake, monkeypatch):
    train, folder = fake
    with LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs="CRITICAL"
    ) as cluster:
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", cluster.scheduler_address)
        run_sweep(configs(1), folder / "runs", train=train)
        assert is_done(configs(1)[0], folder / "runs")
        assert cluster.scheduler.transition_counter > 0


LENT = """
import time
from distributed import LocalCluster
layout = {"n_workers": 1, "processes": False, "protocol": "tcp://", "dashboard_address": ":0"}
with LocalCluster(**layout) as cluster:
    print(cluster.scheduler_address, flush=True)
    time.sleep(1_000)
"""


def test_a_scheduler_that_vanishes_is_named_and_what_is_finished_kept(fake, monkeypatch):
    train, folder = fake
    (folder / "slow").touch()
    lent = subprocess.Popen([sys.executable, "-c", LENT], stdout=subprocess.PIPE, text=True)
    address = lent.stdout.readline().strip()
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", address)
    monkeypatch.setattr(sweep, "write_run", lambda *run: (write_run(*run), lent.kill()))
    with pytest.raises(RuntimeError, match=r"[1-3] of 4 runs failed, the others are kept; first "):
        run_sweep(configs(4), folder / "runs", train=train)
    lent.wait()
    assert 1 <= sum(is_done(config, folder / "runs") for config in configs(4)) < 4
    with dask.config.set({"distributed.comm.timeouts.connect": "1s"}):
        with pytest.raises(OSError, match=f"connect to {address}"):
            run_sweep(configs(4), folder / "runs", train=train)


def test_progress_tells_runs_and_halves_of_runs_and_the_time_to_go(fake, monkeypatch):
    train, folder = fake
    (folder / "slow").touch()
    runs, told = folder / "study" / "runs", folder / "progress"
    monkeypatch.setenv(progress.VARIABLE, str(told))
    run_sweep(configs(1), runs, train=train, workers=1)
    seen = set()
    thread = threading.Thread(
        target=run_sweep, args=(configs(4), runs), kwargs={"train": train, "workers": 2}
    )
    thread.start()
    while thread.is_alive():
        seen.add(progress.read(told))
        time.sleep(0.02)
    assert {"runs: 1.0 of 4", "runs: 2.0 of 4"} <= {text[:14] for text in seen}
    # Both workers are half-way at nearly the same moment.
    halves = [
        text for text in seen if text[6:9] in ("1.5", "2.0", "2.5") and "success 0.25" in text
    ]
    assert any("?" not in text for text in halves), "no estimate before the first run ended"
    assert not told.exists()
