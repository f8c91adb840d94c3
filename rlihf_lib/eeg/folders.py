"""What a folder of one's own EEG holds: whose recordings, of which session; what is left aside.

Files are named as in BIDS, ``sub-XX[_ses-YY][_task-Z][_run-N]_eeg.*``, and lie in the folder itself
or in folders ``sub-*``. A name without its person isn't guessed at: one person taken for two would
be trained on and tested.
"""

import re
from dataclasses import dataclass
from pathlib import Path

#: Endings of the formats that are read, and what lies beside such a file.
FORMATS = {
    ".fif": (), ".fif.gz": (), ".set": (".fdt",), ".vhdr": (".eeg", ".vmrk", ".dat"), ".edf": (),
    ".bdf": (), ".gdf": (),
}  # fmt: skip
KINDS = ("epo", "eeg", "raw")  # last words of names, of MNE and BIDS
WANTED = (
    "sub-XX[_ses-YY]_epo.fif of MNE, or sub-XX[_ses-YY][_task-Z][_run-N]_eeg with the ending "
    f"{', '.join(FORMATS)}, in the folder itself or in folders sub-XX as in BIDS"
)
#: What tables read as missing (pandas), and the subject that is an ideal decoder (`rl.feedback`).
RESERVED = ("na", "nan", "none", "null", "ideal")
_PAPERS = ("", ".tsv", ".json", ".md", ".txt", ".html", ".pdf")  # that nobody takes for EEG
_PAIR = rf"_(?!(?:{'|'.join(KINDS)})-)[^_-]+-[^_-]+"
_NAME = re.compile(rf"(sub-([^_-]+)(?:{_PAIR})*)(?:[_-]([A-Za-z]+)(?:-(\d+))?)?", re.DOTALL)
_CHUNK = 2**16  # bytes from the middle of a file, by which a copy is recognised


@dataclass(frozen=True)
class Recording:
    """A continuous recording or a file of epochs, and what belongs to it."""

    subject: str
    session: str  # "" if its name has none
    path: Path
    files: tuple  # `path`, later parts, and what lies beside it

    @property
    def format(self) -> str:
        """Ending of its name, in small letters."""
        return _ending(self.path)

    @property
    def has_epochs(self) -> bool:
        """Whether it is named as epochs; what an EEGLAB file holds only its content tells."""
        return re.search(r"[_-]epo\.", self.path.name) is not None

    def table(self, name) -> Path | None:
        """Path of its table of BIDS, "events" or "channels", if it has one."""
        return next((file for file in self.files if file.name.endswith(f"_{name}.tsv")), None)


def find(folder) -> tuple[list[Recording], dict[Path, str]]:
    """Recordings of a folder in the order of subject, session and run; ignored files and why.

    A FileNotFoundError says if there is no such folder; a ValueError if there is no recording in
    it, a person's name cannot be used, or two files hold the same recording.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{folder} is not a folder; eeg takes 'simulated', 'hri', or a folder of {WANTED}"
        )
    ignored: dict[Path, str] = {}
    parts: dict[tuple, dict[int, Path]] = {}
    for path in _files(folder, ignored):
        try:
            name, part = _parse(path)
        except ValueError as reason:
            ignored[path] = str(reason)
        else:
            parts.setdefault((path.parent, *name), {})[part] = path
    recordings: dict[str, Recording] = {}
    for (_, name, subject, *_), numbered in parts.items():
        paths = [path for _, path in sorted(numbered.items())]
        if min(numbered) > 1:
            ignored |= dict.fromkeys(paths, "a later part of a recording whose first is missing")
        elif name in recordings:
            raise ValueError(
                f"{recordings[name].path} and {paths[0]} are named as the same recording; keep "
                "one, or give them different _ses-, _task- or _run-"
            )
        else:
            recordings[name] = _recording(name, subject, paths)
    used = {file for recording in recordings.values() for file in recording.files}
    ignored = {
        path: reason
        for path, reason in ignored.items()
        if path not in used and (path.name == "*" or path.suffix.lower() not in _PAPERS)
    }
    if not recordings:
        why = "; ".join(reasons(folder, ignored)) or "no EEG at all"
        raise ValueError(
            f"{folder} holds no recording that can be used ({why}); name them {WANTED}"
        )
    _check_subjects({recording.subject for recording in recordings.values()}, folder)
    found = sorted(recordings.values(), key=lambda r: (r.subject, _natural(r.path.name)))
    _check_copies(found)
    return found, ignored


def reasons(folder, ignored) -> list[str]:
    """A line for each reason why something is ignored: what, and the reason."""
    lines = []
    for reason in dict.fromkeys(ignored.values()):
        names = [str(path.relative_to(folder)) for path, why in ignored.items() if why == reason]
        lines.append(f"{few(names)}: {reason}")
    return lines


def few(names) -> str:
    """Words for a list: the first five, and how many more."""
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more


def _files(folder, ignored):
    """Files of the folder and of its people's folders, sorted; other folders are ignored."""
    found: list[Path] = []
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        if not path.is_dir():
            found.append(path)
        elif path.name.startswith("sub-"):
            found += (file for file in sorted(path.rglob("*")) if not file.is_dir())
        else:
            ignored[path / "*"] = "in a folder that is not named sub-XX"
    return found


def _parse(path):
    """What names a recording: name, subject, kind, ending; and which part of it a file is, from 1.

    A ValueError says why it isn't one.
    """
    ending = _ending(path)
    if ending not in FORMATS:
        raise ValueError(f"none of the formats {', '.join(FORMATS)}, and beside none of them")
    match = _NAME.fullmatch(path.name[: -len(ending)])
    if not match:
        raise ValueError("not named sub-XX[_ses-YY][_task-Z][_run-N]_eeg, or _epo for epochs")
    name, subject, kind, number = match.groups()
    if kind not in KINDS and (kind or ending.startswith(".fif")):
        raise ValueError("its name doesn't end in _epo for epochs, _eeg or _raw")
    if not path.is_file():
        raise ValueError("a link to a file that isn't there; download the whole data set")
    part = int(number or 0) + 1
    if split := re.search(r"_split-(\d+)", name):
        part, name = int(split[1]), name.replace(split[0], "")
    return (name, subject, kind, ending), part


def _recording(name, subject, paths):
    path = paths[0]
    beside = [path.with_suffix(suffix) for suffix in FORMATS[_ending(path)]]
    beside += [path.with_name(f"{name}_{table}.tsv") for table in ("events", "channels")]
    session = re.search(r"_ses-([^_-]+)", name)
    files = (*paths, *(file for file in beside if file.is_file()))
    return Recording(subject, session[1] if session else "", path, files)


def _ending(path):
    name = path.name.lower()
    return ".fif.gz" if name.endswith(".fif.gz") else path.suffix.lower()


def _natural(name):
    """A key that sorts run-2 before run-10."""
    return [int(text) if text.isdigit() else text for text in re.split(r"(\d+)", name)]


def _check_subjects(subjects, folder):
    lower: dict[str, str] = {}
    for subject in sorted(subjects):
        if not re.fullmatch(r"[0-9A-Za-z+]+", subject) or subject.lower() in RESERVED:
            raise ValueError(
                f"{folder}: a person is named {subject!r}; rename the files, with letters a to z "
                f"and digits and none of {', '.join(RESERVED)}"
            )
        if (other := lower.setdefault(subject.lower(), subject)) != subject:
            raise ValueError(
                f"{folder}: people named {other} and {subject} could not be told apart on every "
                "computer; rename the files of one"
            )


def _check_copies(recordings):
    """Refuse a recording that is there twice, as other people's or another session."""
    known: dict[tuple, Path] = {}
    for recording in recordings:
        data = max(recording.files, key=lambda file: file.stat().st_size)
        size = data.stat().st_size
        with data.open("rb") as file:
            file.seek(max(0, (size - _CHUNK) // 2))
            other = known.setdefault((size, file.read(_CHUNK)), data)
        if other != data:
            raise ValueError(
                f"{other} and {data} hold the same data; of one person's recording only one file "
                "may be there, under its true name"
            )
