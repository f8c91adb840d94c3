"""Tests run side by side (pytest-xdist), a file on one worker, those that take longest first."""

import os
import signal
import subprocess

import pytest

# Two threads in one process are slower than one; set before anything imports NumPy.
for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")
# Ignored behind a shell's background job, and then by what tests start, too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

LONGEST_FIRST = (
    "test_notebooks.py",
    "test_campaign.py",
    "test_stopped.py",
    "test_incentives.py",
    "test_golden.py",
    "test_sweep.py",
)


@pytest.fixture
def full_disk(tmp_path):
    """A disk of a page of 4 KiB, and what gives it another size in pages."""
    disk = tmp_path / "full"
    disk.mkdir()

    def mount(pages, *options):
        command = ["mount", "-t", "tmpfs", "-o", ",".join([f"size={4 * pages}k", *options])]
        return subprocess.run([*command, "full", disk], stderr=subprocess.DEVNULL).returncode

    if mount(1):
        pytest.skip("only root may mount a small disk")
    yield disk, lambda pages, *options: mount(pages, "remount", *options)
    subprocess.run(["umount", disk], check=True)


def pytest_collection_modifyitems(items):
    """Bring files that take minutes to the front, lest one worker ends with them alone."""
    first = {name: place for place, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: first.get(item.path.name, len(first)))
