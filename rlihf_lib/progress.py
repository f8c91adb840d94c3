"""Progress of long work inside a notebook, told to the command line through a small file."""

import json
import threading
import time

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
        self.shares = {}
        self.n_finished = 0
        self.start = time.monotonic()
        self.lock = threading.Lock()  # work elsewhere reports from another thread

    def __enter__(self):
        self._write()
        return self

    def __exit__(self, *exception):
        with self.lock:
            self.path.unlink(missing_ok=True)
            self.path = None

    def advance(self, name, share):
        """Note that the share `share`, in [0, 1], of the work called `name` is done."""
        with self.lock:
            self.shares[name] = share
        self._write()

    def finished(self, name):
        """Count the work called `name` as finished, well or not."""
        with self.lock:
            self.shares.pop(name, None)
            self.n_finished += 1
        self._write()

    def counted(self, done, total, seconds=None):
        """Note that `done` of `total` are done; the callback of `eeg.loso.run_loso`."""
        with self.lock:
            self.n_finished = done - (self.total - self.missing)
            if seconds is None:  # the start: what was done before takes no time now
                self.total, self.missing, self.n_finished = total, total - done, 0
        self._write()

    def __str__(self):
        left = self.missing - self.n_finished
        running = min(self.n_workers, left)
        text = f"{self.unit}: {self.total - left} done, {running} running, {left - running} left"
        work = self.n_finished + sum(self.shares.values())
        if work and left:
            seconds = (self.missing - work) * (time.monotonic() - self.start) / work
            text += f", about {duration(seconds)} to go"
        return text

    def _write(self):
        with self.lock:
            if self.path:
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
