"""The command line: `python -m rlihf_lib`."""

import argparse
import logging
import signal
import sys
from datetime import timedelta

try:
    from rlihf_lib.regenerate import NOTEBOOKS, regenerate, select
    from rlihf_lib.study import EVENTS, PROFILES, Study
except KeyboardInterrupt:  # what they import takes a second
    print("\ninterrupted; nothing was begun", file=sys.stderr)
    sys.exit(130)

MOST_WORKERS = 1_000
SECONDS_OF_DRAWING = 150  # on two cores


def parser() -> argparse.ArgumentParser:
    """Build the parser of the main command."""
    result = argparse.ArgumentParser(
        prog="python -m rlihf_lib",
        usage="python -m rlihf_lib [options]",
        description="From EEG recordings to all figures and tables; what is done is used.",
        epilog="`python -m rlihf_lib live --help`: p(error) of whoever wears the cap.",
        allow_abbrev=False,
    )
    add = result.add_argument
    add("--profile", choices=PROFILES, default="paper", help="size (default paper)")
    add("--eeg", default="simulated", metavar="simulated|hri|PATH", help="recordings: simulated "
        "(default), the paper's (downloads), or your folder; --list describes it")  # fmt: skip
    add("--p-error", metavar="FILE.csv", help="instead of recordings, what another "
        "decoder says: subject, epoch, label, p_error")  # fmt: skip
    add("--events", nargs=2, default=EVENTS, metavar=("OK", "ERR"),
        help="names of the two events in your folder")  # fmt: skip
    add("--drop-channels", nargs="+", default=(), metavar="CH",
        help="channels of your folder to leave out")  # fmt: skip
    add("--only", nargs="+", default=[], metavar="NB", help="notebooks to execute, such as 04 05")
    add("--workers", type=_worker_count, default=0, metavar="N",
        help="processes (default: the cores)")  # fmt: skip
    add("--out", metavar="DIR", help="where results/ and figures/ go (default: here)")
    add("--recompute", action="store_true", help="compute anew what is done")
    add("--list", action="store_true", help="what is done, missing, how long the rest takes")
    add("--debug", action="store_true", help="where in the program an error comes from, too")
    return result


def _worker_count(text):
    if not (text.isascii() and text.isdigit() and int(text) <= MOST_WORKERS):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a number of processes, 1 to {MOST_WORKERS}, or 0 for the cores"
        )
    return int(text)


class Terminated(KeyboardInterrupt):
    """Somebody asked the process to end (SIGTERM), which then cleans up as after ctrl-C."""


def _terminate(*_):
    raise Terminated


def main(argv=None) -> int:
    """Run the command line; return the exit status."""
    signal.signal(signal.SIGTERM, _terminate)
    argv = sys.argv[1:] if argv is None else argv
    try:
        if argv[:1] == ["live"]:
            from rlihf_lib.eeg.lsl import main as live  # needs an extra, and PyTorch

            return live(argv[1:])
        _run(argv)
    except Exception as error:
        if "--debug" in argv:
            raise
        said = str(error)
        if not isinstance(error, RuntimeError | OSError | ValueError | ModuleNotFoundError):
            said = f"{type(error).__name__}: {error}; a fault of this program, --debug shows where"
        print(f"rlihf_lib: {said}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as stopped:
        logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # nbclient's unfinished tasks
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
        return 143 if isinstance(stopped, Terminated) else 130
    return 0


def _run(argv):
    command = parser()
    options = command.parse_args(argv)
    if not NOTEBOOKS.is_dir():
        raise FileNotFoundError(
            f"installed without its notebooks ({NOTEBOOKS} is missing), which do the work; clone "
            "the repository and run the command there"
        )
    try:
        study = _study(options)
        steps = select([name for item in options.only for name in item.split(",")], study)
        if study.is_table:
            study.p_error()  # before anything is trained
    except (OSError, ValueError) as error:
        command.error(str(error))
    if options.list:
        _print_status(study, options.workers)
    else:
        regenerate(study, steps, options.workers, options.recompute)
        print(f"figures: {study.figures}\nresults: {study.results}")


def _study(options):
    eeg = options.eeg
    if options.out == "":
        raise ValueError("--out is empty; give a folder, or leave it out to write here")
    if options.p_error is not None:
        if eeg != "simulated":
            raise ValueError(
                f"--p-error {options.p_error} stands for --eeg {eeg}; give one of them"
            )
        if not options.p_error.endswith(".csv"):
            raise ValueError(f"--p-error is {options.p_error!r}; give a table, FILE.csv")
        eeg = options.p_error
    return Study(options.profile, eeg, options.out or "", options.events, options.drop_channels)


def _print_status(study, workers):
    table = study.status(workers)
    rest = table["seconds"].map(lambda seconds: str(timedelta(seconds=round(seconds))))
    print(f"study {study.name} in {study.out}")
    print(table.drop(columns="seconds").assign(rest=rest).to_string(index=False))
    total = table["seconds"].sum() + SECONDS_OF_DRAWING
    print(f"everything takes about {timedelta(seconds=round(total))}, drawing included")
    if study.is_folder:
        from rlihf_lib.eeg.overview import describe  # imports MNE, so only when needed

        print(describe(study.eeg, study.drop_channels))


if __name__ == "__main__":
    sys.exit(main())
