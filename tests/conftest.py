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
    "test_exercises.py",
    "test_jupyterlab.py",
    "test_loso.py",
    "test_sweep.py",
    "test_own_epochs.py",
    "test_lsl.py",
    "test_golden.py",
    "test_incentives.py",
    "test_regenerate.py",
)


@pytest.fixture(scope="session")
def undisturbed_work(tmp_path_factory, worker_id):
    """Folder of the campaign's work and the seconds it took, done by one worker for all."""
    from rlihf_lib.files import locked
    from tests import campaign  # imports NumPy

    place = tmp_path_factory.getbasetemp()
    place = place if worker_id == "master" else place.parent
    seconds = place / "seconds"
    with locked(place / "undisturbed.lock"):
        if not seconds.exists():
            seconds.write_text(str(campaign.undisturbed(place / "undisturbed")[1]))
    return place / "undisturbed", float(seconds.read_text())


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
