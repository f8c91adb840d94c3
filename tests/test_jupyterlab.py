"""JupyterLab in a real browser: Run All, a slider that is moved, a cell that is stopped.

Needs Debian's `chromium`. Screenshots lie in the folder that the environment variable
RLIHF_SCREENSHOTS names, else in pytest's temporary one.
"""

import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import nbformat
import psutil
import pytest

from rlihf_lib.regenerate import NOTEBOOKS
from rlihf_lib.study import Study

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(not CHROMIUM, reason="there is no chromium here")

# Runs that would take an hour, so that there is something to stop.
ENDLESS = """
from rlihf_lib.rl.runs import RunConfig
from rlihf_lib.rl.sweep import run_sweep
configs = [RunConfig("sparse", seed, 1_000_000, 500_000, horizon=10) for seed in (0, 1)]
run_sweep(configs, "runs", workers=2)
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """JupyterLab on a folder with notebook 05, the runs that it shows, and an endless one."""
    root = tmp_path_factory.mktemp("lab")
    shutil.copy(NOTEBOOKS.parent / "README.md", root)
    study = Study()
    for copy in (Study(out=root / "out"), Study(out=root / "other")):
        shutil.copytree(study.decoder, copy.decoder)
        shutil.copytree(study.runs, copy.runs)
    nb = nbformat.read(NOTEBOOKS / "05_whf_ablation.ipynb", as_version=4)
    (parameters,) = (c for c in nb.cells if "parameters" in c.metadata.get("tags", []))
    parameters.source = parameters.source.replace('out = ""', 'out = "out"')
    nbformat.write(nb, root / "05.ipynb")
    endless = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(ENDLESS)])
    endless.metadata["kernelspec"] = nb.metadata["kernelspec"]
    nbformat.write(endless, root / "endless.ipynb")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "jupyter", "lab", "--no-browser", "--allow-root",
               f"--port={port}", "--IdentityProvider.token=", "--ServerApp.password=",
               f"--ServerApp.root_dir={root}", "--LabApp.news_url="]  # fmt: skip
    environment = os.environ | {"JUPYTER_CONFIG_DIR": str(root / ".jupyter")}
    settings = root / ".jupyter/lab/user-settings/@jupyterlab/notebook-extension"
    settings.mkdir(parents=True)  # all cells in the page, also those out of sight
    (settings / "tracker.jupyterlab-settings").write_text('{"windowingMode": "none"}')
    with (root / "log").open("w") as log:
        server = subprocess.Popen(command, cwd=root, env=environment, stdout=log, stderr=log)
    address = f"http://127.0.0.1:{port}"
    for _ in range(120):  # until the server is up
        try:
            urllib.request.urlopen(f"{address}/api").close()
            break
        except OSError:
            time.sleep(0.5)
    yield root, address, psutil.Process(server.pid)
    for process in [*psutil.Process(server.pid).children(recursive=True), server]:
        process.terminate()
    server.wait(20)


@pytest.fixture(scope="module")
def browser(lab):
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        options = ["--no-sandbox", "--disable-gpu"]
        chromium = play.chromium.launch(executable_path=CHROMIUM, args=options)
        yield chromium
        chromium.close()


@pytest.fixture
def opened(lab, browser):
    """Open a notebook of the folder in a page of its own."""
    _, address, _ = lab
    pages = []

    def open_notebook(name):
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(60_000)
        pages.append(page)
        page.goto(f"{address}/lab/workspaces/{name}/tree/{name}.ipynb")
        page.wait_for_selector(".jp-Notebook .jp-CodeCell")
        _wait_for_kernel(page, address, f"{name}.ipynb")
        return page

    yield open_notebook
    for page in pages:
        page.close()


def _wait_for_kernel(page, server, path):
    """Until the page speaks with its kernel: before, Run All asks which kernel to start."""
    deadline = time.time() + 60
    while time.time() < deadline:
        sessions = page.request.get(f"{server}/api/sessions").json()
        kernels = [session["kernel"] for session in sessions if session["path"] == path]
        if any(k["connections"] and k["execution_state"] == "idle" for k in kernels):
            return
        time.sleep(0.2)
    raise AssertionError(f"no kernel for {path}: {sessions}")


def menu(page, top, entry):
    page.click(f".lm-MenuBar-itemLabel:text-is('{top}')")
    page.click(f".lm-Menu-itemLabel:text-is('{entry}')")


def keep(page, root, name):
    folder = Path(os.environ.get("RLIHF_SCREENSHOTS", root / "screenshots"))
    folder.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=folder / f"{name}.png")


def saved(page, path):
    """Save the notebook; return its code cells as they lie on disk."""
    page.keyboard.press("Control+s")
    deadline = time.time() + 20
    while time.time() < deadline:
        cells = nbformat.read(path, as_version=4).cells
        code = [c for c in cells if c.cell_type == "code"]
        if code[-1].execution_count:
            return code
        time.sleep(0.5)
    raise AssertionError(f"{path} has not been executed to its end")


def test_jupyterlab_opens_with_the_readme_as_a_page(lab, browser):
    _, address, _ = lab
    page = browser.new_page()
    page.goto(address)
    page.locator(".jp-MarkdownViewer h1", has_text="rlihf").wait_for(timeout=60_000)
    assert "Two commands" in page.locator(".jp-MarkdownViewer").inner_text()
    page.close()


def test_run_all_and_a_moved_slider(opened, lab):
    root, *_ = lab
    page = opened("05")
    papermill = _start_papermill(root)
    menu(page, "Run", "Run All Cells")
    check = page.locator(".jp-OutputArea-output", has_text="expected").last
    check.wait_for(timeout=240_000)
    for cell in saved(page, root / "05.ipynb"):
        for output in cell.outputs:
            assert output.output_type != "error" and output.get("name") != "stderr", cell.source
    _require_what_makes(papermill, root)
    slider = page.locator(".widget-slider .noUi-handle, .widget-dropdown select").first
    slider.scroll_into_view_if_needed()
    cell = page.locator(".jp-CodeCell", has=slider)
    picture = cell.locator("img").last
    before = picture.get_attribute("src")
    keep(page, root, "slider-before")
    control = cell.locator("select").first
    control.select_option(index=control.locator("option").count() - 1)
    deadline = time.time() + 30
    while picture.get_attribute("src") == before and time.time() < deadline:
        time.sleep(0.2)
    keep(page, root, "slider-after")
    assert picture.get_attribute("src") != before, "the picture has not followed the control"


def _start_papermill(root):
    notebook, copy = str(NOTEBOOKS / "05_whf_ablation.ipynb"), str(root / "papermill.ipynb")
    command = [sys.executable, "-m", "papermill", notebook, copy, "-p", "out", str(root / "other")]
    return subprocess.Popen([*command, "--no-progress-bar", "--log-level", "ERROR"], cwd=root)


def _require_what_makes(papermill, root):
    assert papermill.wait(240) == 0
    study, other = Study(out=root / "out"), Study(out=root / "other")
    for kind in ("figures", "tables"):
        first, second = (
            {path.name: path.read_bytes() for path in getattr(one, kind).iterdir()}
            for one in (study, other)
        )
        assert len(first) > 3 and first == second, kind


def test_the_stop_button_ends_workers_within_seconds(opened, lab):
    root, _, server = lab
    page = opened("endless")
    menu(page, "Run", "Run All Cells")
    bar = page.locator(".jp-OutputArea-output", has_text="runs: 0.0 of 2")
    bar.wait_for(timeout=120_000)
    started = server.children(recursive=True)
    (kernel,) = (p for p in started if _argument(p, "ipykernel_launcher") and _workers(p))
    time.sleep(5)
    keep(page, root, "running")
    workers = _workers(kernel)
    assert len(workers) >= 2
    menu(page, "Kernel", "Interrupt Kernel")
    page.locator(".jp-OutputArea-output", has_text="KeyboardInterrupt").wait_for(timeout=10_000)
    _, alive = psutil.wait_procs(workers, timeout=5)
    keep(page, root, "stopped")
    assert not alive, "workers outlive the stop button"


def _argument(process, word):
    try:
        return any(word in part for part in process.cmdline())
    except psutil.Error:
        return False


def _workers(kernel):
    return [p for p in kernel.children(recursive=True) if _argument(p, "spawn_main")]


def test_screenshots_are_kept(lab):
    root, *_ = lab
    folder = Path(os.environ.get("RLIHF_SCREENSHOTS", root / "screenshots"))
    names = {path.stem for path in folder.glob("*.png")}
    assert {"slider-before", "slider-after", "running", "stopped"} <= names
