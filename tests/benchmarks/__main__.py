"""Speed of every part, against the stock stack: `python -m tests.benchmarks [--json FILE]`."""

import argparse
import json
import os
import sys
from itertools import chain
from pathlib import Path

from rlihf_lib.files import write_text

#: What each number is, and what is wanted.
BENCHMARKS = {
    "env_speedup": ("control steps per second, to robosuite's `env.step`", "at least 5"),
    "mujoco_share": ("share of the environment's time in `mj_step`", "at least 0.7"),
    "train_speedup": ("training steps per second, to SB3's SAC on robosuite", "at least 5"),
    "update_speedup": ("gradient updates per second, to SB3's SAC", "at least 2"),
    "feedback_cost": ("time of a step with human feedback, to dense reward", "at most 1.05"),
    "sweep_scaling": ("throughput of two workers, to one", "at least 1.9"),
    "loso_speedup": ("trials per second and network, to the published layers", "at least 5"),
    "loso_auroc": ("AUROC of single networks, one fold", "at least the reference's - 0.01"),
    "loso_auroc_reference": ("the same of the reference", ""),
    "loso_reference": ("which the reference is", ""),
    "decode_ms_median": ("ms from an epoch's last sample to p(error), median", "below 5"),
    "decode_ms_p99": ("the same, 99th percentile", "below 5"),
    "preprocess_s": ("seconds to simulate and preprocess 12 subjects", ""),
    "preprocess_peak_mib": ("MiB of memory it needs", ""),
}


def main(argv=None):
    """Measure, print a table, write the ratios where `--json` says; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the ratios to FILE")
    parser.add_argument("--repeats", type=int, default=5, help="alternating repeats (default 5)")
    options = parser.parse_args(argv)
    from rlihf_lib.rl.training import processor  # PyTorch and MuJoCo, only to measure
    from tests.benchmarks import decoder, policies

    ratios = {"machine": f"{len(os.sched_getaffinity(0))} cores of {processor()}"}
    print(f"{'what':21}{'measured':>9}  wanted", flush=True)
    for key, value in chain(policies.measure(options.repeats), decoder.measure()):
        ratios[key] = value
        measured = value if isinstance(value, str) else f"{value:9.2f}"
        print(f"{key:21}{measured}  {BENCHMARKS[key][1]}".rstrip(), flush=True)
    if options.json:
        write_text(options.json, json.dumps(ratios, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
