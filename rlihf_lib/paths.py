"""Paths that somebody has typed: in full, or a ValueError that says what is wrong with them."""

from pathlib import Path

from rlihf_lib.rl.feedback import COLUMNS

EEG_SOURCES = ("simulated", "hri")  # built in, whose names nothing else may have


def full_path(path, what) -> Path:
    """Full path of what somebody has typed."""
    try:
        full = Path(path).expanduser().resolve()
        full.exists()  # or its name is too long
    except (OSError, RuntimeError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise ValueError(f"{what} is {str(path)[:80]!r}, which is no path: {reason}") from problem
    return full


def output_folder(out) -> Path:
    """Full path of a folder that can be made and written to."""
    folder = full_path(out, "the folder for results and figures (--out)")
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if not there.is_dir():
        raise ValueError(f"cannot write to {folder}, for {there} is a file; choose another --out")
    return folder


def eeg_folder(eeg) -> tuple[str, str]:
    """Full path and name of a folder of one's own EEG."""
    from rlihf_lib.eeg.folders import WANTED, find  # built-in sources don't need it

    folder = full_path(eeg, "eeg")
    if not eeg.strip() or not folder.is_dir():
        raise ValueError(
            f"eeg is {eeg!r}, neither {' nor '.join(EEG_SOURCES)} nor a folder; "
            f"give one of these or a folder of {WANTED}"
        )
    if not folder.name:
        raise ValueError(
            f"the EEG folder {folder} has no name for its results; give a folder in it"
        )
    _refuse_name(folder.name, f"the EEG folder {folder}", "folder")
    find(folder)  # says what is wrong with its files
    return str(folder), folder.name


def p_error_table(eeg) -> tuple[str, str]:
    """Full path and name of a table of p(error)."""
    path = full_path(eeg, "p(error)")
    if not path.is_file():
        raise ValueError(
            f"there is no file {path}; give a table of p(error) with the columns "
            f"{', '.join(COLUMNS)}"
        )
    _refuse_name(path.stem, f"the table {path}", "file")
    return str(path), path.stem


def _refuse_name(name, source, kind):
    if name in EEG_SOURCES:
        raise ValueError(
            f"{source} is named like a built-in source, so their results would mix; rename the "
            f"{kind}"
        )
