"""The ErrP-HRI recordings (`dataset`): download, resume, verify.

Of its two scenarios, `cursor` is the default: the paper names none, but reports accuracies of 70 to
90 %, which `cursor` gives across subjects; `robot` gave 69.0 +- 7.9 % even within subjects.
"""

import hashlib
import os
from importlib.resources import files
from pathlib import Path

import pooch
import requests

from rlihf_lib.eeg import dataset

#: The state of github.com/stefan-ehrlich/dataset-ErrP-HRI that `errp-hri-blobs.txt` describes.
COMMIT = "4bc3e52469934aa0551a2261a6e4e899d156c28f"
URL = f"https://raw.githubusercontent.com/stefan-ehrlich/dataset-ErrP-HRI/{COMMIT}"
ATTEMPTS = 3


def blob_ids():
    """Git's identifier of every file of the repository at `COMMIT`.

    Returns
    -------
    dict
        Path within the repository -> 40 hexadecimal digits.
    """
    lines = (files("rlihf_lib.eeg") / "errp-hri-blobs.txt").read_text(encoding="utf-8").split("\n")
    return {path: blob for blob, path in (line.split() for line in lines if line)}


def git_blob_id(path):
    """Git's identifier of a file: the SHA-1 of ``blob <size>``, a zero byte and the content."""
    path = Path(path)
    digest = hashlib.sha1(b"blob %d\0" % path.stat().st_size)
    with path.open("rb") as file:
        while chunk := file.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()


def recording(subject, scenario="cursor", url=None, blobs=None):
    """Path of a subject's verified `.set` file, downloaded first if it is not there.

    Parameters
    ----------
    subject : str
        ``s02`` to ``s13``.
    scenario : {"cursor", "robot"}
    url : str, optional
        Where the repository's files are served; default: the environment variable
        ``RLIHF_HRI_URL`` (a mirror), else GitHub.
    blobs : dict, optional
        As `blob_ids` returns it, which is the default.

    Returns
    -------
    Path
        ``<cache>/errp-hri/<folder>/<subject>_<scenario>.set``, its `.fdt` beside it. `s12_cursor`
        lies in the folder `robot`, as it does in the repository.

    Raises
    ------
    ValueError
        If the subject is unknown, or a file there, or one that arrived, is not the published one.
    OSError
        If a file cannot be downloaded; the message says what to place where. What has arrived is
        kept, and the next call goes on from there.
    """
    dataset.check_subject(subject, dataset.SUBJECTS, "the ErrP-HRI recordings")
    blobs = blobs or blob_ids()
    url = (url or os.environ.get("RLIHF_HRI_URL") or URL).rstrip("/")
    folder = dataset.cache_dir() / "errp-hri"
    # The .set last: where it is, the .fdt is complete.
    for suffix in (".fdt", ".set"):
        name = f"{subject}_{scenario}{suffix}"
        place = next((path for path in blobs if path.endswith(f"/{name}")), None)
        if place is None:
            raise ValueError(f"the ErrP-HRI data set has no file {name}")
        target = folder / place
        if not target.is_file():
            _download(f"{url}/{place}", target, blobs[place])
        elif git_blob_id(target) != blobs[place]:
            raise ValueError(
                f"{target} is not the published file (git blob {blobs[place]}); delete it, it will "
                "be downloaded anew"
            )
    return target


def _download(url, target, blob):
    """Download to a partial file, resuming it, and rename it once its git blob id is right."""
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(target.name + ".partial")
    pooch.get_logger().info("Downloading %s", url)
    for attempt in range(1, ATTEMPTS + 1):
        start = partial.stat().st_size if partial.is_file() else 0
        # A compressed answer would have other byte offsets.
        headers = {"Accept-Encoding": "identity"}
        if start:
            headers["Range"] = f"bytes={start}-"
        try:
            with partial.open("ab") as file:
                pooch.HTTPDownloader(headers=headers, timeout=30)(url, file, None)
        except requests.HTTPError as problem:
            # 416 says that the partial file is as long as the whole already.
            if problem.response.status_code != 416:
                raise OSError(f"{url}: {problem}. {_by_hand(url, target)}") from problem
        except (requests.RequestException, OSError) as problem:
            if attempt == ATTEMPTS:
                size = partial.stat().st_size
                kept = f"{size} bytes are kept in {partial}, to go on from" if size else "no data"
                if not size:
                    partial.unlink()
                raise OSError(
                    f"{url} could not be downloaded ({type(problem).__name__}; {kept}). "
                    f"{_by_hand(url, target)}"
                ) from problem
            continue
        if git_blob_id(partial) == blob:
            os.replace(partial, target)
            return
        with partial.open("rb") as file:
            begin = file.read(40)
        size = partial.stat().st_size
        partial.unlink()
        # A server that knows no ranges sent the whole file after the part: once more, from zero.
        if not start:
            page = "a web page, perhaps a login or proxy" if begin.lstrip()[:1] == b"<" else "wrong"
            raise ValueError(
                f"{url}: what arrived ({size} bytes, beginning {begin!r}) is not the published "
                f"file (git blob {blob}) but {page}; it was discarded. {_by_hand(url, target)}"
            )
    raise OSError(f"{url} could not be resumed; try again. {_by_hand(url, target)}")


def _by_hand(url, target):
    return (
        f"Without this download: place {target.name}, from {url} or from a clone of "
        f"https://github.com/stefan-ehrlich/dataset-ErrP-HRI, at {target}"
    )
