"""Write files so that a killed run or a full disk never leaves half a file behind."""

import fcntl
import glob
import hashlib
import json
import os
import platform
import shutil
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import platformdirs

SUMS = "SHA256SUMS"  # of the other files of a folder, as `sha256sum -c` reads it
ABANDONED = 3600  # s after which nobody still writes a file that is half written
RESULTS = (".csv", ".json", ".safetensors")  # files that no folder with `SUMS` holds unnamed


def cache_dir() -> Path:
    """Folder for recordings and epochs: ``RLIHF_CACHE``, by default ``~/.cache/rlihf`` on Linux."""
    if folder := os.environ.get("RLIHF_CACHE"):
        return Path(folder).absolute()
    try:
        return platformdirs.user_cache_path("rlihf")
    except RuntimeError as error:  # a container's user whom its system doesn't know
        raise OSError(
            f"this user ({os.getuid()}) has no home folder; set HOME to a folder"
        ) from error


@contextmanager
def atomic_path(path) -> Iterator[Path]:
    """Give a temporary path beside `path`; rename it to `path` when the block succeeds.

    Its folder is created. If it cannot be written to or the disk is full, an OSError says so, and
    an earlier `path` stays as it was. What was left of it an hour ago, half written, is removed.
    """
    path = Path(path)
    make_folder(path.parent)
    for left in path.parent.glob(f".{glob.escape(path.stem)}.*.partial{path.suffix}"):
        with suppress(FileNotFoundError):  # another process may be as tidy
            if time.time() - left.stat().st_mtime > ABANDONED:
                left.unlink()
    # The suffix stays last because libraries choose the format by it.
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def cannot_write(path, error: OSError) -> OSError:
    """Say what to do if a file or folder cannot be written."""
    # NumPy, which tells how many bytes it wrote, has no strerror.
    return OSError(
        f"cannot write {path} ({error.strerror or error}); is the disk full or read-only? Make "
        "room, or choose another folder: --out for results, RLIHF_CACHE for recordings"
    )


def make_folder(folder: Path) -> None:
    """Create a folder and those above it; an OSError says if that cannot be done, and a remedy."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(
            f"cannot create the folder {folder} ({error.strerror}); make its place writable, "
            "or choose another: --out for results, RLIHF_CACHE for recordings"
        ) from error


@contextmanager
def locked(path, say=lambda owner: None) -> Iterator[IO[str]]:
    """Hold the lock of a file, which is made; `say` gets what its owner wrote, if one waits."""
    path = Path(path)
    make_folder(path.parent)
    try:
        lock = path.open("a+", encoding="utf-8")
    except OSError as error:
        raise cannot_write(path, error) from error
    # The system lets go of the lock when its owner dies, however it does: no lock grows stale.
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.seek(0)
            say(lock.read().strip())
            fcntl.flock(lock, fcntl.LOCK_EX)
        except OSError as error:
            raise OSError(
                f"cannot lock {path} ({error.strerror}), as some network shares can't; choose a "
                "folder of this machine"
            ) from error
        yield lock


@contextmanager
def one_at_a_time(folder, *beside) -> Iterator[None]:
    """Let one process at a time work in a folder, and in those beside it; the next one waits.

    It says for whom. What a process that was killed left half written in the folders is removed.
    """
    folder = Path(folder)

    def say(owner):
        print(f"waiting for {owner}, which works in {folder}", file=sys.stderr)

    with locked(folder / ".lock", say) as lock:
        lock.truncate(0)
        print(f"process {os.getpid()} on {platform.node()}, since {time.ctime()}", file=lock)
        lock.flush()
        for place in (folder, *map(Path, beside)):
            for left in place.glob(".*.partial*"):
                shutil.rmtree(left) if left.is_dir() else left.unlink(missing_ok=True)
        yield


def write_text(path, text) -> None:
    """Write `text` to `path` as UTF-8, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_csv(path, frame) -> None:
    """Write a DataFrame to `path` without its index, atomically and with round-trip floats."""
    with atomic_path(path) as temporary:
        frame.to_csv(temporary, index=False, lineterminator="\n")


def canonical_json(value) -> str:
    """JSON with sorted keys and no spaces, so that equal values give equal text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def sha256(data) -> str:
    """Hexadecimal SHA-256 of bytes, a string (as UTF-8) or the content of a Path."""
    if isinstance(data, Path):
        data = data.read_bytes()
    elif isinstance(data, str):
        data = data.encode()
    return hashlib.sha256(data).hexdigest()


def sums(files: Mapping[str, bytes | Path]) -> str:
    """Content of `SUMS` for files, their content or path by name."""
    return "".join(f"{sha256(files[name])}  {name}\n" for name in sorted(files))


def write_sums(folder, names) -> None:
    """Write `SUMS` of some files of a folder."""
    write_text(Path(folder) / SUMS, sums({name: Path(folder) / name for name in names}))


def check_sums(folder, may_lack=()) -> bool:
    """Tell whether a folder has `SUMS`; a ValueError names a file that isn't what they say.

    Files that the folder `may_lack` need not be there; no table, JSON or weights may be in it that
    `SUMS` does not name.
    """
    folder = Path(folder)
    try:
        lines = (folder / SUMS).read_text(encoding="utf-8", errors="replace").splitlines()
    except FileNotFoundError:
        return False
    known = {name or SUMS: digest for digest, _, name in (line.partition("  ") for line in lines)}
    results = (path.name for path in folder.glob("[!.]*") if path.suffix in RESULTS)
    for name in (*known, *sorted(results)):
        path = Path(os.path.normpath(folder / name))
        there = path.is_file()
        if (there and sha256(path) != known.get(name)) or not (there or name in may_lack):
            raise ValueError(
                f"{path} is {'not what was written' if there else 'gone'} (its hash is in {SUMS} "
                f"beside it); restore it, or delete the folder {folder} to compute it anew"
            )
    return bool(known)
