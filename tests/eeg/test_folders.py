"""Whose recordings a folder holds, by the names of its files."""

import shutil

import pytest

from rlihf_lib.eeg import folders


def put(folder, *names):
    """Files of these names, each with a content of its own."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)


def told(folder):
    """Subject, session and files of each recording; what is ignored, and why."""
    found, ignored = folders.find(folder)
    shown = [(r.subject, r.session, *(file.name for file in r.files)) for r in found]
    return shown, folders.reasons(folder, ignored)


def test_people_and_sessions_come_from_names_and_runs_stay_in_order(tmp_path):
    put(tmp_path, "sub-02_run-10_eeg.edf", "sub-02_run-2_eeg.edf", "sub-01_ses-b_task-x_raw.fif")
    assert told(tmp_path) == (
        [
            ("01", "b", "sub-01_ses-b_task-x_raw.fif"),
            ("02", "", "sub-02_run-2_eeg.edf"),
            ("02", "", "sub-02_run-10_eeg.edf"),
        ],
        [],
    )


def test_a_tree_of_bids_is_read_with_its_tables(tmp_path):
    stem = "sub-01/ses-1/eeg/sub-01_ses-1_task-errp_run-1"
    put(tmp_path, f"{stem}_eeg.vhdr", f"{stem}_eeg.vmrk", f"{stem}_eeg.eeg", f"{stem}_eeg.json")
    put(tmp_path, f"{stem}_events.tsv", f"{stem}_channels.tsv", f"{stem}_events.json")
    put(tmp_path, "participants.tsv", "README", "dataset_description.json", ".bidsignore")
    put(tmp_path, "sub-02/eeg/sub-02_task-errp_eeg.set", "sub-02/eeg/sub-02_task-errp_eeg.fdt")
    put(tmp_path, "derivatives/sub-01/eeg/sub-01_task-errp_eeg.set")
    found, ignored = told(tmp_path)
    name = "sub-01_ses-1_task-errp_run-1"
    beside = ("_eeg.vhdr", "_eeg.eeg", "_eeg.vmrk", "_events.tsv", "_channels.tsv")
    assert found == [
        ("01", "1", *(name + end for end in beside)),
        ("02", "", "sub-02_task-errp_eeg.set", "sub-02_task-errp_eeg.fdt"),
    ]
    assert ignored == ["derivatives/*: in a folder that is not named sub-XX"]


@pytest.mark.parametrize(
    "parts",
    [
        ["sub-01_epo.fif", "sub-01_epo-1.fif", "sub-01_epo-2.fif"],
        ["sub-01_split-01_eeg.fif", "sub-01_split-02_eeg.fif"],
        ["sub-01-epo.fif.gz"],
    ],
)
def test_the_parts_of_a_split_file_are_one_recording(tmp_path, parts):
    put(tmp_path, *parts)
    assert told(tmp_path) == ([("01", "", *parts)], [])


IGNORED = {
    "sub-02_epo-1.fif": "a later part of a recording whose first is missing",
    "person2_epo.fif": "not named sub-XX",
    "sub-S-2_epo.fif": "not named sub-XX",
    "sub-02_cleaned.set": "doesn't end in _epo for epochs, _eeg or _raw",
    "sub-02-ave.fif": "doesn't end in _epo for epochs, _eeg or _raw",
    "sub-02.fif": "doesn't end in _epo for epochs, _eeg or _raw",
    "sub-02_eeg.cnt": "none of the formats .fif, ",
    "sub-02_eeg.fdt": "none of the formats .fif, ",
}


@pytest.mark.parametrize("name", IGNORED)
def test_what_cannot_be_used_is_ignored_with_the_reason(tmp_path, name):
    put(tmp_path, "sub-01_epo.fif", name)
    found, (line,) = told(tmp_path)
    assert len(found) == 1
    assert line.startswith(f"{name}: ") and IGNORED[name] in line
    (tmp_path / "sub-01_epo.fif").unlink()
    with pytest.raises(ValueError, match="no recording that can be used") as refused:
        folders.find(tmp_path)
    assert line in str(refused.value)


def test_links_are_followed_and_those_to_nothing_named(tmp_path):
    put(tmp_path, "elsewhere/of-somebody.fif")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "sub-01_epo.fif").symlink_to(tmp_path / "elsewhere" / "of-somebody.fif")
    (tmp_path / "mine" / "sub-02_epo.fif").symlink_to(tmp_path / "annex" / "not-downloaded")
    found, ignored = told(tmp_path / "mine")
    assert [subject for subject, *_ in found] == ["01"]
    assert ignored == [
        "sub-02_epo.fif: a link to a file that isn't there; download the whole data set"
    ]


@pytest.mark.parametrize("name", ["NA", "null", "None", "nan", "ideal", "..", "a,b", "a\nb", "Ü"])
def test_a_name_that_tables_or_folders_cannot_hold_is_refused(tmp_path, name):
    put(tmp_path, f"sub-{name}_epo.fif", "sub-01_epo.fif")
    with pytest.raises(ValueError, match=r"a person is named .*; rename the files"):
        folders.find(tmp_path)


def test_names_that_differ_in_case_only_are_refused(tmp_path):
    put(tmp_path, "sub-A_epo.fif", "sub-a_epo.fif")
    with pytest.raises(ValueError, match="people named A and a could not be told apart"):
        folders.find(tmp_path)


@pytest.mark.parametrize("copy", ["sub-02_ses-1_epo.fif", "sub-01_ses-2_epo.fif"])
def test_a_copy_as_another_person_or_session_is_refused(tmp_path, copy):
    put(tmp_path, "sub-01_ses-1_epo.fif", "sub-03_epo.fif")
    shutil.copy(tmp_path / "sub-01_ses-1_epo.fif", tmp_path / copy)
    with pytest.raises(ValueError, match=r"epo\.fif hold the same data") as refused:
        folders.find(tmp_path)
    assert copy in str(refused.value) and "sub-01_ses-1" in str(refused.value)


def test_one_recording_in_two_files_is_refused(tmp_path):
    put(tmp_path, "sub-01_epo.fif", "sub-01/eeg/sub-01_eeg.set")
    with pytest.raises(ValueError, match="are named as the same recording"):
        folders.find(tmp_path)


def test_a_folder_without_anything_or_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no EEG at all"):
        folders.find(tmp_path)
    with pytest.raises(FileNotFoundError, match="'simulated', 'hri', or a folder"):
        folders.find(tmp_path / "none")
