"""Execute one notebook through papermill, with its progress shown and its errors told."""

import errno
import os
import sys
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path

from rlihf_lib import progress
from rlihf_lib.files import cache_dir, cannot_write, write_text

#: Variable and folder of what libraries would else keep at home or beside their code.
CACHES = {
    "MPLCONFIGDIR": "matplotlib", "NUMBA_CACHE_DIR": "numba", "MESA_SHADER_CACHE_DIR": "mesa",
}  # fmt: skip


class NotebookError(RuntimeError):
    """An error inside a notebook, told in the words a reader needs."""


def check_parameters(notebook: Path, parameters) -> None:
    """Refuse parameters that the notebook does not declare; papermill would only warn."""
    import papermill

    known = papermill.inspect_notebook(str(notebook))
    for name in parameters:
        if name not in known:
            raise ValueError(
                f"{notebook} has no parameter {name!r}; it has {', '.join(known) or 'none'}"
            )


def execute(notebook: Path, output: Path, parameters, bars=True) -> None:
    """Execute one notebook into `output`, showing its progress, by `bars` where there is room.

    If a cell raises, a NotebookError names notebook, cell, the exception's last line and the copy.
    """
    import papermill
    from nbclient.exceptions import DeadKernelError

    check_parameters(notebook, parameters)
    output.parent.mkdir(parents=True, exist_ok=True)
    bars = bars and sys.stderr.isatty()
    with _shown(output.stem, bars):
        try:
            papermill.execute_notebook(
                str(notebook),
                str(output),
                parameters=parameters,
                kernel_name="python3",
                progress_bar={"desc": output.stem, "disable": not bars},
                # Kernels warn on every start that they talk over localhost.
                extra_arguments=["--IPKernelApp.log_level=50"],
            )
        except papermill.PapermillExecutionError as error:
            lines = [line for line in error.source.splitlines() if line.strip()]
            last_line = (error.evalue.strip().splitlines() or [""])[-1]
            raise NotebookError(
                f"error in notebook {notebook.name}, cell In [{error.exec_count}], "
                f"which begins `{lines[0] if lines else ''}`\n"
                f"  {error.ename}: {last_line}\n"
                f"  executed copy: {output}"
            ) from error
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise cannot_write(output, error) from error
            raise
        except DeadKernelError as error:
            raise NotebookError(
                f"the kernel of notebook {notebook.name} died; was it killed for want of memory?\n"
                f"  executed copy, as far as it came: {output}"
            ) from error
        _write_plain(output)


def _write_plain(copy):
    """Leave in an executed copy what its reader sees: equal results make equal files."""
    import nbformat
    from nbconvert.preprocessors import CoalesceStreamsPreprocessor

    from rlihf_lib.interact import WIDGET

    nb = nbformat.read(copy, as_version=4)
    nb.metadata["language_info"] = {"name": "python"}  # of any version
    for name in ("papermill", "widgets"):  # times and paths; sliders of a kernel that is gone
        nb.metadata.pop(name, None)
    for number, cell in enumerate(nb.cells):
        for timed in ("papermill", "execution"):
            cell.metadata.pop(timed, None)
        if "injected-parameters" in cell.metadata.get("tags", []):
            cell.id = f"parameters-{number}"
        if cell.cell_type == "code":
            cell.outputs = [out for out in cell.outputs if WIDGET not in out.get("data", {})]
    CoalesceStreamsPreprocessor().preprocess(nb, {})  # printed lines come in pieces, by chance
    write_text(copy, nbformat.writes(nb) + "\n")


@contextmanager
def _shown(title, bars):
    """Show how far long work in the kernel is: below the bar of cells, or as lines."""
    from tqdm import tqdm

    left = threading.Event()
    with (
        tempfile.TemporaryDirectory(prefix="rlihf-") as folder,
        tqdm(position=1, leave=False, bar_format="{desc}", disable=not bars) as line,
    ):
        path = Path(folder) / "progress"

        def say(text):
            if bars:
                line.set_description_str(text)
            elif text:
                print(f"{title}: {text}", flush=True)

        def watch():
            shown = ""
            # A bar is refreshed every second, a line is written now and then.
            while not left.wait(1 if bars else 15):
                text = progress.read(path)
                if text != shown:
                    say(text)
                    shown = text

        watcher = threading.Thread(target=watch, daemon=True)
        before = dict(os.environ)
        # The kernel's, too, which so heeds and leaves nothing in the reader's home folder.
        caches = {variable: str(cache_dir() / name) for variable, name in CACHES.items()}
        if not _is_private(Path(caches["NUMBA_CACHE_DIR"])):
            caches["NUMBA_CACHE_DIR"] = folder
        os.environ |= caches | before | {progress.VARIABLE: str(path), "IPYTHONDIR": folder}
        say("started")
        watcher.start()
        try:
            yield
            say("finished")
        finally:
            left.set()
            watcher.join()
            os.environ.clear()
            os.environ |= before


def _is_private(folder):
    """Whether nobody else can put code there, which Numba unpickles; a new one is made so."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    told = folder.stat()
    return told.st_uid == os.getuid() and not told.st_mode & 0o022
