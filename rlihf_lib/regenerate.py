"""Execute the notebooks in order through papermill."""

import argparse
import sys
import threading
from dataclasses import dataclass, field

from rlihf_lib import progress
from rlihf_lib.study import REPOSITORY

NOTEBOOKS = REPOSITORY / "notebooks"


@dataclass(frozen=True)
class Step:
    """One execution of a notebook."""

    notebook: str
    parameters: dict = field(default_factory=dict)

    @property
    def title(self):
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
)
#: Notebooks that read epochs: they need to know how events are named, and what to leave out.
READ_EPOCHS = ("01_dataset_preprocessing", "02_loso_decoder", "03_policy_training")


class NotebookError(RuntimeError):
    """An error inside a notebook, told in the words a reader needs."""


def worker_count(text):
    """Return the number of processes an option of the command line asks for; 0 means the cores."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of processes; 0 = the cores")
    return int(text)


def select(only):
    """Return the steps of the notebooks named, in order.

    Parameters
    ----------
    only : list of str
        Numbers or names of notebooks, such as "04" or "02_loso_decoder"; empty for all.

    Raises
    ------
    ValueError
        If there is no such notebook.
    """
    names = list(dict.fromkeys(step.notebook for step in STEPS))
    chosen = set()
    for wanted in only:
        found = [name for name in names if wanted == name or wanted.zfill(2) == name[:2]]
        if not found:
            raise ValueError(f"there is no notebook {wanted!r}; choose from {', '.join(names)}")
        chosen.update(found)
    return [step for step in STEPS if not only or step.notebook in chosen]


def regenerate(study, steps, workers=0, recompute=False):
    """Execute notebooks and keep the executed copies in `study.notebooks`.

    Parameters
    ----------
    study : Study
    steps : list of Step
    workers : int
        Worker processes for training; 0 = one per core.
    recompute : bool
        Compute anew what is done.

    Raises
    ------
    OSError
        If the output folders cannot be written to; nothing has been computed then.
    ValueError
        If a notebook does not declare a parameter it is given.
    NotebookError
        If a cell raises.
    """
    _check_writable(study)
    for step in steps:
        check_parameters(_path(step), _parameters(study, step, workers, recompute))
    for step in steps:
        execute(
            _path(step),
            study.notebooks / f"{step.title}.ipynb",
            _parameters(study, step, workers, recompute),
            study.results / progress.FILE_NAME,
        )


def _path(step):
    return NOTEBOOKS / f"{step.notebook}.ipynb"


def _parameters(study, step, workers, recompute):
    parameters = {
        "profile": study.profile.name,
        "eeg": study.eeg,
        "out": "" if study.out == REPOSITORY else str(study.out),
        "workers": workers,
        "recompute": recompute,
        **step.parameters,
    }
    if step.notebook in READ_EPOCHS:
        parameters["events"] = list(study.events)
        parameters["drop_channels"] = list(study.drop_channels)
    return parameters


def check_parameters(notebook, parameters):
    """Refuse parameters that the notebook does not declare; papermill would only warn.

    Raises
    ------
    ValueError
        If a parameter is unknown.
    FileNotFoundError
        If there is no such notebook.
    """
    import papermill

    known = papermill.inspect_notebook(str(notebook))
    for name in parameters:
        if name not in known:
            raise ValueError(
                f"{notebook} has no parameter {name!r}; it has {', '.join(known) or 'none'}"
            )


def execute(notebook, output, parameters, progress_path):
    """Execute one notebook, showing its progress.

    Parameters
    ----------
    notebook, output : Path
        The notebook and where its executed copy goes.
    parameters : dict
        Values for its cell tagged `parameters`.
    progress_path : Path
        Where long work inside the notebook tells how far it is.

    Raises
    ------
    NotebookError
        If a cell raises: names notebook, cell, the exception's last line and the executed copy.
    """
    import papermill
    from nbclient.exceptions import DeadKernelError

    check_parameters(notebook, parameters)
    output.parent.mkdir(parents=True, exist_ok=True)
    progress_path.unlink(missing_ok=True)  # a killed run may have left one
    papermill.engines.papermill_engines.register("rlihf", _engine())
    with _Display(output.stem, progress_path) as display:
        try:
            papermill.execute_notebook(
                str(notebook),
                str(output),
                parameters=parameters,
                engine_name="rlihf",
                kernel_name="python3",
                progress_bar=False,
                display=display,
                # Kernels warn on every start that they talk over localhost.
                extra_arguments=["--IPKernelApp.log_level=50"],
            )
        except papermill.PapermillExecutionError as error:
            last_line = (error.evalue.strip().splitlines() or [""])[-1]
            raise NotebookError(
                f"error in notebook {notebook.name}, cell In [{error.exec_count}], "
                f"which begins `{_first_line(error.source)}`\n"
                f"  {error.ename}: {last_line}\n"
                f"  executed copy: {output}"
            ) from error
        except DeadKernelError as error:
            raise NotebookError(
                f"the kernel of notebook {notebook.name} died in cell {display.n} of "
                f"{display.total}; was it killed for want of memory?\n  executed copy: {output}"
            ) from error


def _first_line(source):
    lines = [line for line in source.splitlines() if line.strip()]
    return lines[0] if lines else ""


def _engine():
    """Papermill's usual engine, which also tells the display which cell is done."""
    from papermill.engines import NBClientEngine

    class Engine(NBClientEngine):
        @classmethod
        def execute_managed_notebook(cls, nb_man, kernel_name, display=None, **kwargs):
            display.start(len(nb_man.nb.cells))
            nb_man.pbar = display  # papermill calls its update() after each cell
            return super().execute_managed_notebook(nb_man, kernel_name, **kwargs)

    return Engine


class _Display:
    """A progress bar of a notebook's cells with the text of its long work; lines in a file."""

    def __init__(self, title, progress_path):
        self.title = title
        self.progress_path = progress_path
        self.n = self.total = 0
        self.stop = threading.Event()
        self.bar = None

    def __enter__(self):
        return self

    def start(self, total):
        from tqdm import tqdm

        self.total = total
        if sys.stderr.isatty():
            self.bar = tqdm(
                total=total,
                desc=self.title,
                bar_format="{desc} |{bar:20}| cell {n_fmt}/{total_fmt} {elapsed}{postfix}",
            )
        else:
            self._line("started")
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def __exit__(self, kind, *_):
        self.stop.set()
        if self.total:
            self.thread.join()
        if self.bar:
            self.bar.set_postfix_str("")
            self.bar.close()
        elif self.total and kind is None:
            self._line("finished")

    # The part of tqdm that papermill uses: update, refresh, set_description, close, n.

    def update(self, n):
        self.n += n
        if self.bar:
            self.bar.update(n)

    def refresh(self):
        pass

    def set_description(self, text):
        pass

    def close(self):
        pass

    def _watch(self):
        shown = ""
        # A terminal is refreshed every second, a file gets a line now and then.
        while not self.stop.wait(1 if self.bar else 15):
            text = progress.read(self.progress_path)
            if self.bar:
                self.bar.set_postfix_str(text)
            elif text and text != shown:
                self._line(text)
                shown = text

    def _line(self, text):
        print(f"{self.title}: cell {self.n}/{self.total} {text}".rstrip(), flush=True)


def _check_writable(study):
    """Fail before any work if the output cannot be written."""
    for folder in (study.results, study.figures, study.notebooks):
        probe = folder / ".writable"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise OSError(
                f"cannot write to {folder} ({error.strerror}); choose another folder with --out"
            ) from error
