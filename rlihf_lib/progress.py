"""How far long work is: a bar by tqdm, and a file for the command line that runs the notebook."""

import contextlib
import io
import os
import threading
from pathlib import Path

from rlihf_lib.files import write_text

#: Environment variable that names the file. Where it is set, nothing is shown in the notebook.
VARIABLE = "RLIHF_PROGRESS"
MOST_NAMED = 4  # of what runs at once


class Progress:
    """Count finished and begun parts of long work.

    Parameters
    ----------
    total, done : int
        How many there are, and how many were done before.
    unit : str
        What is counted, in the plural.
    """

    def __init__(self, total: int, done: int, unit: str):
        from tqdm import auto, std

        path = os.environ.get(VARIABLE)
        self._path = Path(path) if path else None
        self._finished = done
        self._running: dict[str, tuple[float, str]] = {}
        self._lock = threading.Lock()  # work elsewhere reports from another thread
        self._bar = (std if path else auto).tqdm(
            total=total,
            initial=done,
            bar_format=f"{unit}: {{n:.1f}} of {{total}} {{bar:20}} {{remaining}} to go{{postfix}}",
            file=io.StringIO() if path else None,
        )

    def __enter__(self) -> "Progress":
        with self._lock:
            self._show()
        return self

    def __exit__(self, *exception) -> None:
        with self._lock:
            self._bar.close()
            if self._path:
                self._path.unlink(missing_ok=True)

    def advance(self, name: str, share: float, note: str = "") -> None:
        """Note that the share `share`, in [0, 1], of the work called `name` is done.

        What runs is shown beside the bar, each with its share and the last `note` on it.
        """
        with self._lock:
            self._running[name] = share, note
            self._show()

    def finished(self, name: str) -> None:
        """Count the work called `name` as finished, well or not."""
        with self._lock:
            self._running.pop(name, None)
            self._finished += 1
            self._show()

    def _show(self):
        """Show the state, with the lock held."""
        if self._bar.disable:  # closed; a late report changes nothing
            return
        self._bar.n = self._finished + sum(share for share, _ in self._running.values())
        running = [f"{name} {share:.0%}{note}" for name, (share, note) in self._running.items()]
        self._bar.set_postfix_str(" · ".join(running[:MOST_NAMED]), refresh=False)
        self._bar.refresh()
        if self._path:
            with contextlib.suppress(OSError):  # a full disk here costs no work
                write_text(self._path, str(self._bar))


def read(path: Path) -> str:
    """Return the last text that a running `Progress` wrote to `path`; "" if there is none."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return ""
