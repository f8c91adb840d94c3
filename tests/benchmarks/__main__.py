"""Speed of every part, against the stock stack: `python -m tests.benchmarks [--json FILE]`."""

import argparse
import json
import sys
from itertools import chain
from pathlib import Path

from rlihf_lib.files import write_text
from tests.benchmarks import decoder, policies

WANTED = {
    "env_speedup": "at least 5",
    "mujoco_share": "at least 0.7",
    "train_speedup": "at least 5",
    "update_speedup": "at least 2",
    "feedback_cost": "at most 1.05",
    "sweep_scaling": "at least 1.9",
    "loso_speedup": "at least 5",
    "loso_auroc": "at least the reference's - 0.01",
    "loso_auroc_reference": "",
    "loso_reference": "",
    "decode_ms_median": "below 5",
    "decode_ms_p99": "below 5",
    "preprocess_s": "12 subjects",
    "preprocess_peak_mib": "of the process",
}


def main(argv=None):
    """Measure, print a table, write the ratios where `--json` says; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the ratios to FILE")
    parser.add_argument("--repeats", type=int, default=5, help="alternating repeats (default 5)")
    options = parser.parse_args(argv)
    ratios = {}
    print(f"{'what':21}{'measured':>9}  wanted", flush=True)
    for key, value in chain(policies.measure(options.repeats), decoder.measure()):
        ratios[key] = value
        measured = value if isinstance(value, str) else f"{value:9.2f}"
        print(f"{key:21}{measured}  {WANTED[key]}".rstrip(), flush=True)
    if options.json:
        write_text(options.json, json.dumps(ratios, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
