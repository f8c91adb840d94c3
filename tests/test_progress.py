"""Progress as another process reads it."""

import pytest

from rlihf_lib.progress import Progress, duration, read


def test_counts_and_estimates_and_leaves_nothing_behind(tmp_path):
    path = tmp_path / "study" / ".progress.json"
    with Progress(path, total=5, missing=4, n_workers=2) as progress:
        assert read(path) == "runs: 1 done, 2 running, 2 left"
        progress.advance("a", 0.5)
        assert read(path).startswith("runs: 1 done, 2 running, 2 left, about ")
        progress.finished("a")
        assert read(path).startswith("runs: 2 done, 2 running, 1 left, about ")
    assert not path.exists() and read(path) == ""
    progress.advance("b", 0.5)
    assert not path.exists(), "a late report must not bring the file back"


def test_folds_done_before_do_not_count_as_work_of_now(tmp_path):
    path = tmp_path / ".progress.json"
    with Progress(path, 0, 0, unit="folds") as progress:
        progress.counted(3, 12)
        assert read(path) == "folds: 3 done, 1 running, 8 left"
        progress.counted(4, 12, 1.0)
        assert read(path).startswith("folds: 4 done, 1 running, 7 left, about ")


def test_a_damaged_file_is_no_progress(tmp_path):
    (tmp_path / "p.json").write_text("{")
    assert read(tmp_path / "p.json") == ""


@pytest.mark.parametrize(("seconds", "text"), [(40, "40 s"), (720, "12 min"), (12600, "3.5 h")])
def test_durations_are_for_people(seconds, text):
    assert duration(seconds) == text
