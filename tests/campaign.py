"""Attacks on the store of results: killed, stopped, starved, lied to, and nothing is lost.

python -m tests.campaign --minutes 20

A small piece of real work, three decoders and four policies on two processes, is attacked at a
random moment and then done again by the same command. What it leaves must equal, byte for byte,
what undisturbed work leaves; no process may outlive the one that was attacked by more than 10 s.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

import pandas as pd
import psutil

TIMES = ("provenance.json", "SHA256SUMS")  # of a run: hold how long it took
GRACE = 10  # s
LIMIT = 600  # s, after which work hangs


def work(folder, workers=2) -> None:
    """Decode three people and train four policies, or what is left of it."""
    from rlihf_lib.eeg.fitting import DecoderSettings
    from rlihf_lib.eeg.loso import run_loso
    from rlihf_lib.rl.feedback import p_error_sha256, read_table
    from rlihf_lib.rl.runs import RunConfig, SACSettings
    from rlihf_lib.rl.sweep import run_sweep
    from tests.eeg.conftest import planted_epochs

    people = {f"s{i:02d}": planted_epochs(i, n=30) for i in range(6)}
    settings = DecoderSettings(max_epochs=2, ensemble=2, n_permutations=20, batch_size=16)
    run_loso(people, folder / "decoder", settings, workers)
    table = read_table(folder / "decoder" / "p_error.csv")
    sizes = {"total_steps": 300, "eval_every": 150, "horizon": 60, "eval_rollouts": 2}
    sac = SACSettings(learning_starts=200, batch_size=64)
    watched = {"subject": "s02", "w_hf": 0.7, "p_error_sha256": p_error_sha256(table, "s02")}
    configs = [
        RunConfig(condition, seed, sac=sac, **sizes, **told)
        for condition, told in (("dense", {}), ("rlihf", watched))
        for seed in (0, 1)
    ]
    run_sweep(configs, folder / "runs", table, workers)


def contents(folder) -> dict[str, bytes]:
    """Every file by name, hidden leftovers too, but for locks and what holds times."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != ".lock"
        and not (path.name in TIMES and "runs" in path.parts)
    }  # fmt: skip


def start(folder, workers=2, **environment) -> subprocess.Popen:
    """Begin the work as a user does, in a process of its own."""
    command = [sys.executable, "-m", "tests.campaign", "--work", str(folder), str(workers)]
    # A file, not a pipe: who waits for the end of a pipe waits for orphans that hold it.
    said = tempfile.TemporaryFile("w+")
    process = subprocess.Popen(
        command, start_new_session=True, env=os.environ | environment,
        stdout=subprocess.DEVNULL, stderr=said,
    )  # fmt: skip
    process.said = said
    return process


def finish(process) -> tuple[int, str]:
    """Wait for work; return its exit status and the last line it said."""
    code = process.wait(LIMIT)
    process.said.seek(0)
    lines = process.said.read().strip().splitlines()
    return code, lines[-1] if lines else ""


def family(process) -> list[psutil.Process]:
    """The processes below one."""
    try:
        return psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def end(process):
    """kill -9 of a process and of all below it; wait until they are gone."""
    below = family(process)
    for one in (*below, process):
        one.kill()
    process.wait()
    psutil.wait_procs(below, timeout=GRACE)


def killed(folder, process, rng, whole):
    """kill -9 of the process that was started."""
    process.kill()


def all_killed(folder, process, rng, whole):
    """kill -9 of it and of all its workers."""
    end(process)


def worker_killed(folder, process, rng, whole):
    """kill -9 of one of its workers."""
    if workers := family(process):
        rng.choice(workers).kill()


def terminated(folder, process, rng, whole):
    """SIGTERM or, as by ctrl-C, SIGINT."""
    process.send_signal(rng.choice([signal.SIGTERM, signal.SIGINT]))


def doubled(folder, process, rng, whole):
    """The same command a second time, while the first is at work."""
    code, said = finish(start(folder))
    assert code == 0, said


def edited(folder, process, rng, whole):
    """A byte of a result changed; the command must name the file."""
    end(process)
    shutil.rmtree(folder)
    shutil.copytree(whole, folder)
    files = [p for p in folder.rglob("*.*") if p.suffix in (".csv", ".json", ".safetensors")]
    path = rng.choice([p for p in files if {"folds", "weights", "runs"} & {*p.parts}])
    content = path.read_bytes()
    at = rng.randrange(len(content))
    path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
    code, said = finish(start(folder))
    assert code == 1 and f"{path.name} is not what was written" in said, said
    path.write_bytes(content)


def starved(folder, process, rng, whole):
    """A disk that is full; the command must name the place, and go on once there is room.

    False where none can be had.
    """
    end(process)
    shutil.rmtree(folder)
    folder.mkdir()
    size = rng.randrange(1, 120)
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={4 * size}k", "full", folder]
    ).returncode:
        return False
    try:
        code, said = finish(start(folder))
        assert code == 0 or (code == 1 and str(folder) in said and "full" in said), said
        subprocess.run(["mount", "-o", "remount,size=64m", folder], check=True)
        code, said = finish(start(folder))
        assert code == 0, said
        saved = folder.with_suffix(".saved")
        shutil.copytree(folder, saved)
    finally:
        subprocess.run(["umount", folder], check=True)
    shutil.rmtree(folder)
    saved.rename(folder)
    return True


ATTACKS = (killed, all_killed, worker_killed, terminated, doubled, edited, starved)


@dataclass
class Tally:
    """What came of the attacks of one kind."""

    tried: int = 0
    refused: int = 0  # to go on without being told what was wrong
    different: int = 0
    left: int = 0  # half-written files and folders
    orphans: int = 0
    hangs: int = 0


def undisturbed(folder) -> tuple[Path, float]:
    """Do the work; return its folder, and the seconds it took."""
    started = time.monotonic()
    code, said = finish(start(folder))
    assert code == 0, said
    return Path(folder), time.monotonic() - started


def attack(kind, whole, seconds, rng, place) -> Counter:
    """Attack work that is `whole`, and takes so long, undisturbed; return what went wrong."""
    folder, wrong = Path(tempfile.mkdtemp(dir=place)), Counter(tried=1)
    process = start(folder)
    try:
        time.sleep(rng.uniform(0, seconds))
        below = family(process)
        wrong["tried"] = int(kind(folder, process, rng, whole) is not False)
        process.wait(LIMIT)
        wrong["orphans"] += len(psutil.wait_procs(below, timeout=GRACE)[1])
        code, said = finish(start(folder))
        if code:
            print(f"{kind.__name__}: the same command again said: {said}", file=sys.stderr)
            wrong["refused"] += 1
        found, expected = contents(folder), contents(whole)
        wrong["left"] += len(list(folder.rglob("*.partial*")))
        if changed := {
            n for n in found.keys() | expected.keys() if found.get(n) != expected.get(n)
        }:
            print(f"{kind.__name__}: {', '.join(sorted(changed))} differ", file=sys.stderr)
            wrong["different"] += 1
    except subprocess.TimeoutExpired:
        wrong["hangs"] += 1
    except AssertionError as error:
        print(f"{kind.__name__}: {error}", file=sys.stderr)
        wrong["refused"] += 1
    finally:
        end(process)
    shutil.rmtree(folder, ignore_errors=True)
    return wrong


def campaign(minutes=0.0, rounds=0, seed=0, kinds=ATTACKS, done_before=None) -> pd.DataFrame:
    """Attack for so long, or so many times by each kind; return a `Tally` per kind of attack.

    What is `undisturbed` may have been done before.
    """
    rng, tallies = random.Random(seed), {kind: Counter() for kind in kinds}
    with tempfile.TemporaryDirectory(prefix="rlihf-campaign-") as place:
        started = time.monotonic()
        whole, seconds = done_before or undisturbed(Path(place) / "whole")
        done, until = 0, started + 60 * minutes
        while time.monotonic() < until or done < rounds * len(kinds):
            kind = kinds[done % len(kinds)]
            tallies[kind] += attack(kind, whole, seconds, rng, place)
            done += 1
    rows = [asdict(Tally(**counts)) for counts in tallies.values()]
    return pd.DataFrame(rows, index=[kind.__name__ for kind in kinds])


def main() -> None:
    """Do the work that is attacked, or attack it."""
    command = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    command.add_argument("--minutes", type=float, default=20.0)
    command.add_argument("--seed", type=int, default=0)
    command.add_argument("--work", nargs=2, help=argparse.SUPPRESS)
    options = command.parse_args()
    if options.work is None:
        print(campaign(options.minutes, seed=options.seed).to_string())
        return
    try:
        work(Path(options.work[0]), int(options.work[1]))
    except (OSError, ValueError, RuntimeError) as error:
        sys.exit(f"{error}")


if __name__ == "__main__":
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    main()
