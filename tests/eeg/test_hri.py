"""The ErrP-HRI download, against a local server laid out as the repository is."""

import contextlib
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from rlihf_lib.eeg import hri, simulated
from rlihf_lib.eeg.preprocessing import load_epochs

CONTENT = {
    "cursor/s02_cursor.fdt": bytes(range(256)) * 1000,
    "cursor/s02_cursor.set": b"MATLAB 5.0 MAT-file" * 50,
    "robot/s12_cursor.fdt": b"\1\2\3\4" * 500,
    "robot/s12_cursor.set": b"MATLAB 5.0 MAT-file, s12" * 20,
}


class Server:
    """Serves `files` after `wait` s; cuts the connection after `cut[path]` bytes, once."""

    wait = 0.0

    def __init__(self):
        self.files, self.cut, self.requests, self.ranges = dict(CONTENT), {}, [], True


@pytest.fixture
def server(monkeypatch, tmp_path):
    state = Server()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            path = self.path.lstrip("/")
            wanted = self.headers.get("Range")
            state.requests.append((path, wanted))
            if path not in state.files:
                self.send_error(404)
                return
            time.sleep(state.wait)
            content = state.files[path]
            start = int(wanted[len("bytes=") : -1]) if wanted and state.ranges else 0
            if start and start >= len(content):
                self.send_error(416)
                return
            self.send_response(206 if start else 200)
            self.send_header("Content-Length", str(len(content) - start))
            self.end_headers()
            stop = state.cut.pop(path, len(content))
            with contextlib.suppress(OSError):
                self.wfile.write(content[start:stop])

        def log_message(self, *arguments):
            pass

    web = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=web.serve_forever, daemon=True).start()
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("RLIHF_HRI_URL", f"http://127.0.0.1:{web.server_port}")
    yield state
    web.shutdown()
    web.server_close()


@pytest.fixture
def blobs(tmp_path, monkeypatch):
    """The identifiers of what is served, in place of the published files'."""
    ids = {}
    for path, content in CONTENT.items():
        file = tmp_path / "file"
        file.write_bytes(content)
        ids[path] = hri.git_blob_id(file)
    monkeypatch.setattr(hri, "blob_ids", lambda: ids)


def folder(tmp_path):
    return tmp_path / "cache" / "errp-hri"


def test_git_blob_id_is_what_git_computes(tmp_path):
    file = tmp_path / "hello"
    file.write_bytes(b"hello\n")
    # printf 'hello\n' | git hash-object --stdin
    assert hri.git_blob_id(file) == "ce013625030ba8dba906f756967f9e9ca394464a"


def test_the_package_knows_the_recordings_of_every_subject_and_no_other():
    blobs = hri.blob_ids()
    places = {hri.place(subject, suffix) for subject in hri.SUBJECTS for suffix in (".set", ".fdt")}
    assert places == {hri.cache_dir() / "errp-hri" / path for path in blobs}
    assert len(places) == 24 and "robot/s12_cursor.set" in blobs
    assert all(len(blob) == 40 for blob in blobs.values())


def test_both_files_arrive_whole_and_are_not_fetched_again(server, blobs, tmp_path):
    path = hri.recording("s02")
    assert path == folder(tmp_path) / "cursor" / "s02_cursor.set"
    assert path.read_bytes() == CONTENT["cursor/s02_cursor.set"]
    assert path.with_suffix(".fdt").read_bytes() == CONTENT["cursor/s02_cursor.fdt"]
    assert len(server.requests) == 2
    assert hri.recording("s02") == path
    assert len(server.requests) == 2


def test_s12_is_found_in_the_folder_robot(server, blobs, tmp_path):
    assert hri.recording("s12") == folder(tmp_path) / "robot" / "s12_cursor.set"


def test_an_interrupted_transfer_resumes_where_it_stopped(server, blobs, tmp_path):
    server.cut["cursor/s02_cursor.fdt"] = 100_000
    path = hri.recording("s02")
    assert path.with_suffix(".fdt").read_bytes() == CONTENT["cursor/s02_cursor.fdt"]
    first, second, _ = server.requests
    assert first == ("cursor/s02_cursor.fdt", None)
    resumed_at = int(second[1][len("bytes=") : -1])
    assert 0 < resumed_at <= 100_000
    assert not list(folder(tmp_path).rglob("*.partial"))


def test_two_that_want_the_same_recording_download_it_once(server, blobs):
    server.wait = 0.3
    with ThreadPoolExecutor(2) as pool:
        paths = set(pool.map(hri.recording, ["s02", "s02"]))
    assert {path.with_suffix(".fdt").read_bytes() for path in paths} == {
        CONTENT["cursor/s02_cursor.fdt"]
    }
    assert len(server.requests) == 2


def test_a_place_that_cannot_be_written_is_named_and_a_full_one_resumed(
    server, blobs, full_disk, monkeypatch
):
    disk, resize = full_disk
    monkeypatch.setenv("RLIHF_CACHE", str(disk))
    (disk / "errp-hri" / "cursor").mkdir(parents=True)
    resize(1, "ro")
    with pytest.raises(OSError, match=rf"cannot write {disk}/.*cursor/.* or .* RLIHF_CACHE"):
        hri.recording("s02")
    assert not server.requests
    resize(10, "rw")
    with pytest.raises(OSError, match=rf"cannot write {disk}/.*\.partial \(No space.* Make room"):
        hri.recording("s02")
    resize(1000)
    assert hri.recording("s02").is_file()
    assert [wanted for _, wanted in server.requests[1:]] == ["bytes=40960-", None]


def test_a_part_that_cannot_be_opened_is_named(server, blobs, tmp_path):
    (folder(tmp_path) / "cursor" / "s02_cursor.fdt.partial").mkdir(parents=True)
    with pytest.raises(OSError, match=r"cannot write .*\.partial \(Is a directory"):
        hri.recording("s02")
    assert not server.requests


def test_a_later_call_resumes_what_an_earlier_one_left(server, blobs, tmp_path):
    partial = folder(tmp_path) / "cursor" / "s02_cursor.fdt.partial"
    partial.parent.mkdir(parents=True)
    partial.write_bytes(CONTENT["cursor/s02_cursor.fdt"][:1234])
    hri.recording("s02")
    assert server.requests[0] == ("cursor/s02_cursor.fdt", "bytes=1234-")


def test_a_complete_partial_file_is_taken(server, blobs, tmp_path):
    partial = folder(tmp_path) / "cursor" / "s02_cursor.fdt.partial"
    partial.parent.mkdir(parents=True)
    partial.write_bytes(CONTENT["cursor/s02_cursor.fdt"])
    path = hri.recording("s02")
    assert path.with_suffix(".fdt").read_bytes() == CONTENT["cursor/s02_cursor.fdt"]


def test_a_server_without_ranges_is_asked_again_from_the_start(server, blobs, tmp_path):
    server.ranges = False
    partial = folder(tmp_path) / "cursor" / "s02_cursor.fdt.partial"
    partial.parent.mkdir(parents=True)
    partial.write_bytes(CONTENT["cursor/s02_cursor.fdt"][:1234])
    path = hri.recording("s02")
    assert path.with_suffix(".fdt").read_bytes() == CONTENT["cursor/s02_cursor.fdt"]


@pytest.mark.parametrize(
    "arrived, said",
    [
        (CONTENT["cursor/s02_cursor.fdt"][:-1], "255999 bytes"),
        (b"x" + CONTENT["cursor/s02_cursor.fdt"][1:], "not the published file"),
        (b"<!DOCTYPE html><html>Please log in</html>", "web page"),
    ],
    ids=["truncated", "wrong", "web page with status 200"],
)
def test_what_is_not_the_published_file_is_refused(server, blobs, tmp_path, arrived, said):
    server.files["cursor/s02_cursor.fdt"] = arrived
    with pytest.raises(ValueError, match=said) as refused:
        hri.recording("s02")
    assert "s02_cursor.fdt" in str(refused.value)
    assert not list(folder(tmp_path).rglob("s02*"))


def test_a_wrong_file_placed_by_hand_is_refused_and_kept(server, blobs, tmp_path):
    placed = folder(tmp_path) / "cursor" / "s02_cursor.fdt"
    placed.parent.mkdir(parents=True)
    placed.write_bytes(b"something else")
    with pytest.raises(ValueError, match="delete it"):
        hri.recording("s02")
    assert placed.read_bytes() == b"something else"


def test_files_placed_by_hand_need_no_network(blobs, tmp_path, monkeypatch):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("RLIHF_HRI_URL", "http://127.0.0.1:9")
    for path, content in CONTENT.items():
        file = folder(tmp_path) / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    assert hri.recording("s12").is_file()


def test_without_network_the_error_says_what_to_place_where(blobs, tmp_path, monkeypatch):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("RLIHF_HRI_URL", "http://127.0.0.1:9")
    with pytest.raises(OSError, match=r"place s02_cursor\.fdt") as problem:
        hri.recording("s02")
    assert str(folder(tmp_path) / "cursor" / "s02_cursor.fdt") in str(problem.value)


def test_a_missing_file_on_the_server_is_named(server, blobs):
    del server.files["cursor/s02_cursor.set"]
    with pytest.raises(OSError, match="404"):
        hri.recording("s02")


def test_what_the_server_holds_becomes_labelled_epochs(server, tmp_path, monkeypatch):
    monkeypatch.setattr(hri, "N_BLOCKS", 2)
    pair = tmp_path / "served" / "s12_cursor.set"
    simulated.write_set(pair, *simulated.simulate("s12"))
    served = {f"robot/{file.name}": file for file in (pair, pair.with_suffix(".fdt"))}
    server.files = {path: file.read_bytes() for path, file in served.items()}
    server.cut["robot/s12_cursor.fdt"] = 1_000_000
    blobs = {path: hri.git_blob_id(file) for path, file in served.items()}
    monkeypatch.setattr(hri, "blob_ids", lambda: blobs)
    epochs = load_epochs("hri", "s12")
    assert epochs.get_data().shape[1:] == (30, 512)
    assert len(epochs["correct"]) + len(epochs["error"]) == len(epochs) > 40
