"""The ErrP-HRI data set: what its recordings look like, and how they are downloaded and verified.

Source: the documentation that lies beside the recordings of Ehrlich & Cheng (2019),
*A feasibility study for validating robot actions using EEG-based error-related potentials*,
Int. J. Soc. Robotics 11, 271-283, doi:10.1007/s12369-018-0501-8.

Of its two scenarios, `cursor` is used: the paper names none, but reports accuracies of 70 to 90 %,
which `cursor` gives across subjects; `robot` gave 69.0 +- 7.9 % even within subjects.
"""

import hashlib
import os
from importlib.resources import files
from pathlib import Path

import numpy as np
import pandas as pd
import pooch
import requests

from rlihf_lib.files import cache_dir, cannot_write, locked

#: Subjects of the study, as its files name them.
SUBJECTS = tuple(f"s{number:02d}" for number in range(2, 14))

#: Channels in the order of the files: 27 EEG and 3 EOG, recorded against the mean of TP9 and TP10.
CHANNELS = tuple(
    "Fp1 Fz F3 F7 EOG1 FC5 FC1 C3 T7 CP5 CP1 Pz P3 P7 O1 EOG3 O2 P4 P8 CP6 CP2 Cz C4 T8 EOG2 "
    "FC6 FC2 F4 F8 Fp2".split()
)
EOG_CHANNELS = ("EOG1", "EOG2", "EOG3")
EEG_CHANNELS = tuple(name for name in CHANNELS if name not in EOG_CHANNELS)

#: Sampling rate of the files, in Hz (recorded at 1000 Hz).
SFREQ = 256.0

#: Event names (two spaces each). A trial runs from one stimulus to the next.
STIMULI = ("S  1", "S  2", "S  3")
RESPONSES = ("R  1", "R  2", "R  3")
FEEDBACKS = ("FB1", "FB2", "FB3")
CORRECT, HUMAN_ERROR, MACHINE_ERROR = "S  4", "S  5", "S  6"
FRAME, BACK, TRIAL_END = "S  7", "S  8", "S  9"
#: Label of a feedback, 0 correct and 1 error, and what becomes of it, by the outcome of its trial.
OUTCOMES = {CORRECT: (0, "kept"), MACHINE_ERROR: (1, "kept"), HUMAN_ERROR: (-1, "human error")}

N_BLOCKS, N_TRIALS_PER_BLOCK = 10, 50

#: The state of github.com/stefan-ehrlich/dataset-ErrP-HRI that `errp-hri-blobs.txt` describes.
COMMIT = "4bc3e52469934aa0551a2261a6e4e899d156c28f"
URL = f"https://raw.githubusercontent.com/stefan-ehrlich/dataset-ErrP-HRI/{COMMIT}"
ATTEMPTS = 3
TIMEOUT = 30  # s without an answer
RANGE_NOT_SATISFIABLE = 416  # the partial file is as long as the whole already


def blob_ids() -> dict[str, str]:
    """Path within the repository at `COMMIT` -> git's identifier of the file, 40 digits."""
    lines = (files("rlihf_lib.eeg") / "errp-hri-blobs.txt").read_text(encoding="utf-8").split("\n")
    return {path: blob for blob, path in (line.split() for line in lines if line)}


def git_blob_id(path: Path) -> str:
    """Git's identifier of a file: the SHA-1 of ``blob <size>``, a zero byte and the content."""
    digest = hashlib.sha1(b"blob %d\0" % path.stat().st_size)
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: digest).hexdigest()


def recording(subject: str) -> Path:
    """A subject's verified `.set` in ``<cache>/errp-hri/<folder>``, downloaded if it is missing.

    It comes from GitHub, or the mirror that the environment variable ``RLIHF_HRI_URL`` names; its
    `.fdt` lies beside it. `s12_cursor` is in the folder `robot`, as in the repository. A ValueError
    says if a file is not the published one, an OSError if it cannot be downloaded, and what to
    place where. What has arrived is kept, and the next call goes on from there.
    """
    blobs = blob_ids()
    url = (os.environ.get("RLIHF_HRI_URL") or URL).rstrip("/")
    # The .set last: where it is, the .fdt is complete.
    for suffix in (".fdt", ".set"):
        target = place(subject, suffix)
        source = target.relative_to(cache_dir() / "errp-hri").as_posix()
        if not target.is_file():
            with locked(target.with_name(f".{target.name}.lock"), _waits):
                if not target.is_file():  # as another process may have left it
                    _download(f"{url}/{source}", target, blobs[source])
        elif git_blob_id(target) != blobs[source]:
            raise ValueError(
                f"{target} is not the published file (git blob {blobs[source]}); delete it, it "
                "will be downloaded anew"
            )
    return target


def place(subject: str, suffix: str = ".set") -> Path:
    """Where a subject's file lies, or will lie."""
    path = next(path for path in blob_ids() if path.endswith(f"/{subject}_cursor{suffix}"))
    return cache_dir() / "errp-hri" / path


def feedback_events(raw) -> pd.DataFrame:
    """Feedback events in the order of time, labelled by the outcome marker of their trial.

    Columns are onset (s), epoch, block, label and status; a ValueError says if there are none.
    """
    onset, name = raw.annotations.onset, raw.annotations.description
    trial = np.searchsorted(onset[np.isin(name, STIMULI)], onset, side="right")
    rows = []
    for epoch, index in enumerate(np.flatnonzero(np.isin(name, FEEDBACKS))):
        outcomes = set(name[trial == trial[index]]) & OUTCOMES.keys()
        label, status = OUTCOMES[outcomes.pop()] if len(outcomes) == 1 else (-1, "no outcome")
        rows.append((onset[index], epoch, epoch // N_TRIALS_PER_BLOCK, label, status))
    events = pd.DataFrame(rows, columns=["onset", "epoch", "block", "label", "status"])
    if not (events["label"] >= 0).any():
        raise ValueError(
            f"no feedback ({', '.join(FEEDBACKS)}) with an outcome ({CORRECT}, {MACHINE_ERROR}) "
            f"among the events of the recording, which are {', '.join(sorted(set(name))) or 'none'}"
        )
    return events


def _waits(owner):
    pooch.get_logger().info("Waiting for another process, which downloads the same file")


def _download(url, target, blob):
    """Download to a partial file, resuming it, and rename it once its git blob id is right."""
    by_hand = (
        f"Without this download: place {target.name}, from {url} or from a clone of "
        f"https://github.com/stefan-ehrlich/dataset-ErrP-HRI, at {target}"
    )
    partial = target.with_name(target.name + ".partial")
    pooch.get_logger().info("Downloading %s", url)
    for attempt in range(1, ATTEMPTS + 1):
        start = partial.stat().st_size if partial.is_file() else 0
        # A compressed answer would have other byte offsets.
        headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-"} if start else {})
        try:
            with partial.open("ab") as file:
                pooch.HTTPDownloader(headers=headers, timeout=TIMEOUT)(url, file, None)
        except requests.HTTPError as problem:
            if getattr(problem.response, "status_code", None) != RANGE_NOT_SATISFIABLE:
                raise OSError(f"{url}: {problem}. {by_hand}") from problem
        except requests.RequestException as problem:
            if attempt < ATTEMPTS:
                continue
            kept = "no data"
            if size := partial.stat().st_size:
                kept = f"{size} bytes are kept in {partial}, to go on from"
            else:
                partial.unlink()
            raise OSError(
                f"{url} could not be downloaded ({type(problem).__name__}; {kept}). {by_hand}"
            ) from problem
        except OSError as problem:
            raise cannot_write(partial, problem) from problem
        if git_blob_id(partial) == blob:
            os.replace(partial, target)
            return
        arrived = partial.read_bytes()
        partial.unlink()
        # A server that knows no ranges sent the whole file after the part: once more, from zero.
        if not start:
            page = arrived.lstrip().startswith(b"<")
            what = "a web page, perhaps a login or proxy" if page else "wrong"
            raise ValueError(
                f"{url}: what arrived ({len(arrived)} bytes, beginning {arrived[:40]!r}) is not "
                f"the published file (git blob {blob}) but {what}; it was discarded. {by_hand}"
            )
    raise OSError(f"{url} could not be resumed; try again. {by_hand}")
