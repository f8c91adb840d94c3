"""Execute the notebooks in order through papermill."""

import errno
import os
import sys
import tempfile
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from rlihf_lib import progress
from rlihf_lib.files import cache_dir, cannot_write, one_at_a_time, write_text
from rlihf_lib.parallel import in_processes
from rlihf_lib.study import REPOSITORY, Study

NOTEBOOKS = REPOSITORY / "notebooks"


@dataclass(frozen=True)
class Step:
    """One execution of a notebook."""

    notebook: str
    parameters: dict = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Name of the executed copy, such as `03_policy_training-dense`."""
        return "-".join([self.notebook, *self.parameters.values()])


STEPS = (
    Step("01_dataset_preprocessing"),
    Step("02_loso_decoder"),
    Step("03_policy_training", {"condition": "sparse"}),
    Step("03_policy_training", {"condition": "dense"}),
    Step("03_policy_training", {"condition": "rlihf"}),
    Step("04_metrics_tables"),
    Step("05_whf_ablation"),
    Step("06_beyond_the_paper"),
)
FROM_EEG = ("01_dataset_preprocessing", "02_loso_decoder")
COMPARES = ("05_whf_ablation",)  # weights
#: Notebooks that read epochs: they need to know how events are named, and what to leave out.
READ_EPOCHS = (*FROM_EEG, "03_policy_training")
TRAIN = ("03_policy_training", "05_whf_ablation", "06_beyond_the_paper")
READ_RUNS = ("04_metrics_tables", "06_beyond_the_paper")  # that 03 has trained
READ_01 = ("02_loso_decoder", "04_metrics_tables")  # recordings it caches, waves it draws
#: Variable and folder of what libraries would else keep at home or beside their code.
CACHES = {
    "MPLCONFIGDIR": "matplotlib", "NUMBA_CACHE_DIR": "numba", "MESA_SHADER_CACHE_DIR": "mesa",
}  # fmt: skip


class NotebookError(RuntimeError):
    """An error inside a notebook, told in the words a reader needs."""


def select(only, study: Study) -> list[Step]:
    """Return the steps of notebooks, named like "04" or "02_loso_decoder", in order; of none: all.

    All but `FROM_EEG` if the study is given p(error), and all but `COMPARES` if it has one weight
    only. A ValueError says if there is no such step.
    """
    needless = [*FROM_EEG] * study.is_table + [*COMPARES] * (len(study.profile.weights) < 2)
    steps = [step for step in STEPS if step.notebook not in needless]
    names = list(dict.fromkeys(step.notebook for step in steps))
    chosen = set()
    for wanted in only:
        found = [name for name in names if wanted == name or wanted.zfill(2) == name[:2]]
        if not found:
            raise ValueError(
                f"there is no notebook {wanted!r} to execute; choose from {', '.join(names)}"
            )
        chosen.update(found)
    return [step for step in steps if not only or step.notebook in chosen]


def regenerate(study: Study, steps, workers=0, recompute=False) -> None:
    """Execute steps and keep the executed copies in `study.notebooks`.

    On `workers` processes, 0 = one per core; notebooks that only draw are executed side by side.
    Before anything is computed, an OSError says if a folder cannot be written to (results, cache,
    temporary files), a cluster doesn't answer, or p(error) or runs are neither there nor made, a
    ValueError if a notebook lacks a parameter or a folder has too few people; then a NotebookError
    if a cell raises.
    """
    names = {step.notebook for step in steps}
    _check_writable(study)
    if study.is_folder and names & {*FROM_EEG} and len(people := study.subjects()) < 3:
        raise ValueError(
            f"{study.eeg} holds recordings of {len(people)} ({', '.join(people)}), decoders need "
            "three people, one each to train, validate and test; add some, or look at what is "
            "there with --list"
        )
    if names.difference(FROM_EEG) and "02_loso_decoder" not in names:
        study.p_error()  # which policies need; not after hours of those that don't
    if names & {*TRAIN} and os.environ.get("DASK_SCHEDULER_ADDRESS"):
        from rlihf_lib.rl.sweep import check_cluster  # imports Dask, so only when needed

        check_cluster()
    if (reading := sorted(names & {*READ_RUNS})) and TRAIN[0] not in names:
        rows = study.status()
        if missing := rows.loc[rows["stage"].str.startswith(TRAIN[0]), "missing"].sum():
            raise FileNotFoundError(
                f"{missing} runs of {study.runs} that {' and '.join(reading)} would read are "
                f"missing; train them, too: --only 03 {' '.join(name[:2] for name in reading)}"
            )
    jobs = []
    for step in steps:
        notebook = NOTEBOOKS / f"{step.notebook}.ipynb"
        parameters = _parameters(study, step, workers, recompute)
        check_parameters(notebook, parameters)
        jobs.append((notebook, study.notebooks / f"{step.title}.ipynb", parameters))
    with one_at_a_time(study.results, study.notebooks, study.tables, study.figures):
        while jobs:
            together = _together(study, jobs, recompute)
            jobs = [job for job in jobs if job not in together]
            n_processes = min(len(together), workers or os.cpu_count() or 1)
            bars = n_processes == 1
            for _ in in_processes(execute, [(*job, bars) for job in together], n_processes):
                pass


def _together(study, jobs, recompute):
    """Which of the notebooks left can be executed at once: those before one that trains."""
    if recompute:
        return jobs[:1]
    rows = study.status()
    train = {stage[:2] for stage in rows.loc[rows["missing"] > 0, "stage"]}
    together = list(takewhile(lambda job: job[0].stem[:2] not in train, jobs))
    if not together:
        return jobs[:1]
    if together[0][0].stem != FROM_EEG[0]:
        return together
    return [job for job in together if job[0].stem not in READ_01]


def _parameters(study, step, workers, recompute):
    parameters = {
        "profile": study.profile.name,
        "eeg": study.eeg,
        "out": "" if study.out == REPOSITORY else str(study.out),
        "workers": workers,
        "recompute": recompute,
        "ship": True,
        **step.parameters,
    }
    if step.notebook in READ_EPOCHS:
        parameters["events"] = list(study.events)
        parameters["drop_channels"] = list(study.drop_channels)
    return parameters


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


def _check_writable(study):
    """Fail before any work if what it needs cannot be written."""
    folders = dict.fromkeys((study.results, study.figures, study.notebooks), "--out")
    folders |= {cache_dir(): "RLIHF_CACHE", Path(tempfile.gettempdir()): "TMPDIR"}
    for folder, variable in folders.items():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder) as probe:
                probe.write(b"a disk may be full")
        except OSError as error:
            raise OSError(
                f"cannot write to {folder} ({error.strerror}); make room there, or choose another "
                f"folder with {variable}"
            ) from error
