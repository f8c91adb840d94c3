"""The command line: `python -m rlihf_lib`."""

import argparse
import logging
import sys
from datetime import timedelta

from rlihf_lib.regenerate import NOTEBOOKS, NotebookError, regenerate, select
from rlihf_lib.study import EVENTS, PROFILES, Study

SECONDS_OF_DRAWING = 150  # on two cores


def parser() -> argparse.ArgumentParser:
    """Build the parser of the main command."""
    result = argparse.ArgumentParser(
        prog="python -m rlihf_lib",
        usage="python -m rlihf_lib [options]",
        description="From EEG recordings to every figure and table of the paper. What is done "
        "already, shipped results included, is used; the rest is computed.",
        epilog="`python -m tests.benchmarks [--json FILE]` measures the speed of every part.",
    )
    add = result.add_argument
    add("--profile", choices=PROFILES, default="quick", help="size (default quick)")
    add("--eeg", default="simulated", metavar="simulated|hri|PATH", help="recordings: simulated "
        "(default), the paper's (downloads), or your folder of epochs")  # fmt: skip
    add("--events", nargs=2, default=EVENTS, metavar=("OK", "ERR"),
        help="names of the two events in your folder of epochs")  # fmt: skip
    add("--drop-channels", nargs="+", default=(), metavar="CH",
        help="channels of your folder of epochs that are no EEG")  # fmt: skip
    add("--only", nargs="+", default=[], metavar="NB", help="notebooks to execute, such as 04 05")
    add("--workers", type=_worker_count, default=0, metavar="N",
        help="processes (default: the cores)")  # fmt: skip
    add("--out", default="", metavar="DIR", help="where results/ and figures/ go (default: here)")
    add("--recompute", action="store_true", help="compute anew what is done")
    add("--list", action="store_true", help="what is done, missing, how long the rest takes")
    return result


def _worker_count(text):
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of processes; 0 = the cores")
    return int(text)


def _live(argv):
    try:
        from rlihf_lib.eeg.lsl import main
    except ModuleNotFoundError as missing:
        print(f"rlihf_lib: {missing}", file=sys.stderr)
        return 1
    return main(argv)


def main(argv=None) -> int:
    """Run the command line; return the exit status."""
    argv = sys.argv[1:] if argv is None else argv
    if argv[:1] == ["live"]:
        return _live(argv[1:])
    command = parser()
    options = command.parse_args(argv)
    if not NOTEBOOKS.is_dir():
        print(
            f"rlihf_lib: installed without its notebooks ({NOTEBOOKS} is missing), which do the "
            "work; clone the repository and run the command there",
            file=sys.stderr,
        )
        return 1
    try:
        study = Study(
            options.profile, options.eeg, options.out, options.events, options.drop_channels
        )
        steps = select([name for item in options.only for name in item.split(",")])
    except ValueError as error:
        command.error(str(error))
    try:
        if options.list:
            _print_status(study, options.workers)
        else:
            regenerate(study, steps, options.workers, options.recompute)
            print(f"figures: {study.figures}\nresults: {study.results}")
    except (NotebookError, OSError, ValueError) as error:
        print(f"rlihf_lib: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # nbclient's unfinished tasks
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
        return 130
    return 0


def _print_status(study, workers):
    table = study.status(workers)
    rest = table["seconds"].map(lambda seconds: str(timedelta(seconds=round(seconds))))
    print(f"study {study.name} in {study.out}")
    print(table.drop(columns="seconds").assign(rest=rest).to_string(index=False))
    total = table["seconds"].sum() + SECONDS_OF_DRAWING
    print(f"everything takes about {timedelta(seconds=round(total))}, drawing included")


if __name__ == "__main__":
    sys.exit(main())
