"""What nobody can mean: one sentence with the value and what to do instead, and nothing is done."""

import pytest

from rlihf_lib import regenerate
from rlihf_lib.__main__ import main
from rlihf_lib.study import REPOSITORY

TABLE = "subject,epoch,label,p_error\na,0,0,0.1\na,1,1,0.9\n"
NO_CHOICE = "choose from 'smoke', 'class', 'quick', 'paper', 'pilots'"
NO_NOTEBOOK = "choose from 01_dataset_preprocessing, 02_loso_decoder"
NO_EEG = "neither simulated nor hri nor a folder"
REFUSED = [
    (["--profile"], "expected one argument"),
    (["--profile", ""], NO_CHOICE),
    (["--profile", "Paper"], NO_CHOICE),
    (["--profile", "quick,smoke"], NO_CHOICE),
    (["--profile", "smoke", "class"], "unrecognized arguments: class"),
    (["--prof", "smoke"], "unrecognized arguments: --prof smoke"),
    *((["--workers", text], f"{text!r} is not a number of processes, 1 to 1000")
      for text in ("", "two", "1.5", " 2", "0x2", "NaN", "-1", "-0", "²", "1001", "9" * 20)),
    (["--only"], "expected at least one argument"),
    *((["--only", text], f"no notebook {text.split(',')[-1]!r} to execute; {NO_NOTEBOOK}")
      for text in ("", "0", "07", "1e0", "03_policy", "*", "../x", "01,,", "01,99")),
    (["--only", "04", "7"], f"no notebook '7' to execute; {NO_NOTEBOOK}"),
    (["--only", "01", "--p-error", "lab.csv"], "no notebook '01' to execute; choose from 03_"),
    *((["--eeg", text], f"eeg is {text!r}, {NO_EEG}")
      for text in ("", " ", "file", "Simulated", "sim", "dangling", "/no/such/folder")),
    (["--eeg", "hri", "simulated"], "unrecognized arguments: simulated"),
    (["--eeg", "/"], "has no name for its results; give a folder in it"),
    (["--eeg", "."], "holds no recording that can be used"),
    (["--eeg", "empty"], "holds no recording that can be used (no EEG at all); name them sub-XX"),
    (["--eeg", "with space ü"], "with space ü holds no recording that can be used"),
    (["--eeg", "a\0"], "eeg is 'a\\x00', which is no path: embedded null byte"),
    (["--eeg", "a" * 5000], "which is no path: File name too long"),
    (["--eeg", "loop"], "eeg is 'loop', which is no path: Symlink loop"),
    (["--events", "a"], "expected 2 arguments"),
    (["--events", "a", "b", "c"], "unrecognized arguments: c"),
    *((["--events", *pair], f"events are {pair}; give the names of two, correct and error")
      for pair in (("", "b"), ("a", " "), ("a", "a"), ("a", "a "))),
    (["--events", "a", "b"], "can be named for a folder only, not for simulated"),
    (["--events", "a", "b", "--p-error", "lab.csv"], "can be named for a folder only, not for /"),
    (["--drop-channels"], "expected at least one argument"),
    (["--drop-channels", "Cz"], "can be dropped from a folder only, not from simulated"),
    (["--drop-channels", "Cz", "--p-error", "lab.csv"], "can be dropped from a folder only"),
    (["--p-error", ""], "--p-error is ''; give a table, FILE.csv"),
    (["--p-error", "lab"], "--p-error is 'lab'; give a table, FILE.csv"),
    (["--p-error", "lab.xlsx"], "--p-error is 'lab.xlsx'; give a table, FILE.csv"),
    (["--p-error", "none.csv"], "none.csv; give a table of p(error) with the columns subject"),
    (["--p-error", "folder.csv"], "there is no file"),
    (["--p-error", "a\0.csv"], "which is no path: embedded null byte"),
    (["--p-error", "simulated.csv"], "is named like a built-in source"),
    (["--p-error", "words.csv"], "words.csv lacks the column(s) subject, epoch, label, p_error"),
    (["--p-error", "lab.csv", "--eeg", "hri"], "stands for --eeg hri; give one of them"),
    (["--out", ""], "--out is empty; give a folder"),
    (["--out", "file"], "file is a file; choose another --out"),
    (["--out", "file/deeper"], "file is a file; choose another --out"),
    (["--out", "/dev/null"], "/dev/null is a file; choose another --out"),
    (["--out", "loop"], "(--out) is 'loop', which is no path: Symlink loop"),
    (["--out", "~nobody99/x"], "which is no path: Could not determine home directory"),
    (["--out", "a\0"], "which is no path: embedded null byte"),
    (["--out", "a" * 300], "which is no path: File name too long"),
    (["--recompute", "yes"], "unrecognized arguments: yes"),
    (["--list=1"], "ignored explicit argument '1'"),
    (["--wokers", "2"], "unrecognized arguments: --wokers"),
    (["-p", "smoke"], "unrecognized arguments: -p smoke"),
    (["list"], "unrecognized arguments: list"),
]  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with things that look like what is asked for."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(regenerate, "execute", lambda *_: pytest.fail("a notebook was started"))
    for name in ("empty", "with space ü", "folder.csv"):
        (tmp_path / name).mkdir()
    (tmp_path / "file").write_text("a file, not a folder")
    for name, text in {"lab": TABLE, "simulated": TABLE, "words": "a word\n"}.items():
        (tmp_path / f"{name}.csv").write_text(text)
    (tmp_path / "dangling").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    return tmp_path


@pytest.mark.parametrize(("arguments", "message"), REFUSED, ids=range(len(REFUSED)))
def test_what_nobody_can_mean_is_refused_by_name(arguments, message, folder, capsys):
    before = [*sorted(folder.rglob("*")), *sorted((REPOSITORY / "results").iterdir())]
    with pytest.raises(SystemExit) as error:
        main(arguments)
    said = capsys.readouterr().err
    assert error.value.code == 2 and message in said, said
    assert len(said.splitlines()) <= 2, "usage, and a sentence"
    assert [*sorted(folder.rglob("*")), *sorted((REPOSITORY / "results").iterdir())] == before


def test_at_least_sixty_command_lines_are_tried():
    assert len(REFUSED) >= 60


def test_a_fault_of_the_program_is_a_sentence_unless_one_looks_for_it(capsys, monkeypatch):
    def fault(*_):
        raise KeyError("nobody thought of this")

    monkeypatch.setattr("rlihf_lib.__main__.regenerate", fault)
    assert main(["--profile", "smoke"]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("rlihf_lib: KeyError: 'nobody thought of this'") and "--debug" in said
    with pytest.raises(KeyError):
        main(["--profile", "smoke", "--debug"])
