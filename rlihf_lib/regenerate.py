"""Execute the notebooks in order through papermill."""

import os
import tempfile
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from rlihf_lib.execute import check_parameters, execute
from rlihf_lib.files import cache_dir, one_at_a_time
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
    ready = [job for job in together if job[0].stem not in READ_01]
    # Half of them at most, lest those that wait, 02 is the longest, come alone in the end.
    return ready if len(ready) == len(together) else ready[: max(1, len(together) // 2)]


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
