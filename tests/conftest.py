"""Tests run side by side (pytest-xdist), a file on one worker, those that take longest first."""

import os

# Two threads in one process are slower than one; set before anything imports NumPy.
for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

LONGEST_FIRST = (
    "test_notebooks.py",
    "test_campaign.py",
    "test_incentives.py",
    "test_golden.py",
    "test_sweep.py",
    "test_own_epochs.py",
)


def pytest_collection_modifyitems(items):
    """Bring files that take minutes to the front, lest one worker ends with them alone."""
    first = {name: place for place, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: first.get(item.path.name, len(first)))
