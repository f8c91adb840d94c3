"""Progress as another process reads it."""

import pytest

from rlihf_lib import progress
from rlihf_lib.progress import Progress, read


@pytest.fixture
def told(tmp_path, monkeypatch):
    path = tmp_path / "progress"
    monkeypatch.setenv(progress.VARIABLE, str(path))
    return path


def test_counts_and_estimates_and_leaves_nothing_behind(told):
    with Progress(total=5, done=1, unit="runs") as work:
        assert read(told).startswith("runs: 1.0 of 5 ") and "? to go" in read(told)
        work.advance("a", 0.5)
        assert read(told).startswith("runs: 1.5 of 5 ") and "00:" in read(told)
        work.advance("b", 0.25, ", success 0.40")
        assert read(told).endswith("a 50% · b 25%, success 0.40"), "what runs, how far each is"
        work.finished("b")
        assert read(told).startswith("runs: 2.5 of 5 ")
        work.finished("a")
        assert read(told).startswith("runs: 3.0 of 5 ")
    assert not told.exists() and read(told) == ""
    work.advance("b", 0.5)
    assert not told.exists(), "a late report must not bring the file back"


def test_where_it_cannot_be_told_the_work_goes_on(monkeypatch):
    monkeypatch.setenv(progress.VARIABLE, "/proc/nowhere/progress")
    with Progress(total=1, done=0, unit="runs") as work:
        work.finished("a")


def test_by_itself_a_bar_is_shown(capsys):
    with Progress(total=2, done=0, unit="folds") as work:
        work.finished("s02")
    assert "folds: 1.0 of 2" in capsys.readouterr().err
