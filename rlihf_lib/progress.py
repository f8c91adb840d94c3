"""Progress of long work inside a notebook, told to the command line through a small file."""

import json

from rlihf_lib.files import write_text

FILE_NAME = ".progress.json"


class Progress:
    """Count what is done, running and left, and estimate the time that is left.

    Parameters
    ----------
    path : Path
        File that another process may read while the work goes on; removed on leaving the block.
    total, missing : int
        How many there are, and how many of them are still to do.
    n_workers : int
        How many are worked on at once.
    unit : str
        What is counted.
    """

    def __init__(self, path, total, missing, n_workers=1, unit="runs"):
        self.path = path
        self.total = total
        self.missing = missing
        self.n_workers = n_workers
        self.unit = unit
        self.seconds = []

    def __enter__(self):
        self._write()
        return self

    def __exit__(self, *exception):
        self.path.unlink(missing_ok=True)

    def finished(self, seconds=None):
        """Count one more as finished, after `seconds` of work; None if it failed."""
        self.missing -= 1
        if seconds is not None:
            self.seconds.append(seconds)
        self._write()

    def __str__(self):
        running = min(self.n_workers, self.missing)
        text = (
            f"{self.unit}: {self.total - self.missing} done, {running} running, "
            f"{self.missing - running} left"
        )
        if self.seconds and self.missing:
            # Those running are half done on average.
            mean = sum(self.seconds) / len(self.seconds)
            rest = (self.missing - running / 2) * mean / self.n_workers
            text += f", about {duration(rest)} to go"
        return text

    def _write(self):
        write_text(self.path, json.dumps({"text": str(self)}))


def read(path):
    """Return the last text that a running `Progress` wrote to `path`; "" if there is none."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))["text"]
    except (OSError, ValueError, KeyError):
        return ""


def duration(seconds):
    """Format seconds for people: "40 s", "12 min", "3.5 h"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
