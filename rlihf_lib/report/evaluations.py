"""Read the evaluations and the training of a study's runs, and say what each run is."""

import numpy as np
import pandas as pd

from rlihf_lib.report import paper
from rlihf_lib.report.statistics import MIN_UNITS
from rlihf_lib.report.style import label, ordered
from rlihf_lib.rl.feedback import person_and_control
from rlihf_lib.rl.runs import read_run

EVAL_COLUMNS = (
    "step",
    "rollout",
    "return",
    "success",
    "path_efficiency",
    "path_deviation",
    "collisions",
    "min_clearance",
)
METRICS = EVAL_COLUMNS[2:]
RANGES = {
    "success": (0, 1), "path_efficiency": (0, 1), "path_deviation": (0, np.inf),
    "collisions": (0, np.inf),
}  # fmt: skip
UNBOUNDED = (-np.inf, np.inf)
LOWER_IS_BETTER = ("path_deviation", "collisions")


def group_of(config):
    """Name what a run is compared as: its condition, and whatever isn't as in the paper.

    Parameters
    ----------
    config : RunConfig

    Returns
    -------
    str
        "sparse", "dense", "rlihf"; "rlihf-ideal", "rlihf-mean" or "rlihf-shuffled" where p(error)
        isn't decoded; settings that differ from the default as in the run's id, such as
        "sparse-patience1000-discount0.98" or "rlihf-lay".
    """
    control = person_and_control(config.subject)[1]
    return "-".join(filter(None, [config.condition, control, *config.changes]))


def person_of(subject):
    """Return whose p(error) a run drew on: "s02" for "s02" and "s02-mean"; "" for nobody's."""
    return person_and_control(subject)[0]


def load_runs(study, stages=("sparse", "dense", "rlihf")):
    """Read the evaluations of a study's finished runs.

    Parameters
    ----------
    study : Study
    stages : sequence of str
        Stages of `study.run_configs`.

    Returns
    -------
    DataFrame
        The columns of `eval.csv` after run, group (`group_of`), person (`person_of`), condition,
        subject, w_hf, seed.

    Raises
    ------
    FileNotFoundError
        If a run is missing.
    ValueError
        If a table lacks a column or holds a number that is none.
    """
    return _load(study, stages, "eval.csv", EVAL_COLUMNS)


def load_training(study, stages):
    """Read how training went, in windows of steps, in a study's finished runs; see `load_runs`.

    Returns
    -------
    DataFrame
        The columns of `train.csv` (step, episodes, return, success, ...) after those of the run:
        means over the episodes that ended in the window, empty where none did. The return is in
        units of the condition's own reward.
    """
    return _load(study, stages, "train.csv", ("step", "episodes", "return", "success"))


def _load(study, stages, name, columns):
    configs = dict.fromkeys(config for stage in stages for config in study.run_configs(stage))
    return read_runs(configs, study.runs, name, columns)


def read_runs(configs, runs_dir, name="eval.csv", columns=EVAL_COLUMNS):
    """Read one table of each run; see `load_runs`.

    Parameters
    ----------
    configs : iterable of RunConfig
    runs_dir : Path
        Holds the runs' folders.
    name : str
        File in a run's folder.
    columns : sequence of str
        Columns it must have.
    """
    frames = []
    for config in configs:
        frame = read_run(config, runs_dir, name, columns)
        named = {
            "run": config.run_id, "group": group_of(config), "person": person_of(config.subject),
            "condition": config.condition, "subject": config.subject, "w_hf": config.w_hf,
            "seed": config.seed,
        }  # fmt: skip
        frames.append(pd.DataFrame({**named, **frame}))
    return pd.concat(frames, ignore_index=True)


def add_phase(runs, total_steps):
    """Add the column phase: Early, Mid, Late are the thirds of training, as in the paper.

    Parameters
    ----------
    runs : DataFrame
        With the column step.
    total_steps : int
        Environment steps of training; the paper's thirds end at 50k, 100k and 150k.
    """
    third = np.ceil(3 * runs["step"] / total_steps).clip(1, 3).astype(int) - 1
    return runs.assign(phase=pd.Categorical.from_codes(third, paper.PHASES, ordered=True))


def late_scores(runs, total_steps):
    """Average each run over the late phase: the score by which runs are compared.

    Returns
    -------
    DataFrame
        A row per run: run, group, person, subject, w_hf, seed and the metrics.
    """
    late = add_phase(runs, total_steps).query("phase == 'Late'")
    keys = ["group", "person", "subject", "w_hf", "seed", "run"]
    return late.groupby(keys)[list(METRICS)].mean().reset_index()


def units(runs, metric):
    """Arrange runs by what was drawn at random; see `statistics`.

    Parameters
    ----------
    runs : DataFrame
        A row per run, with the column subject.
    metric : str
        Its column; runs without a value are left out.

    Returns
    -------
    ndarray, shape (n_units, n_seeds)
        A row per person in the order of their names, or per run where there is one person or none.
        NaN where a person has fewer runs than another.
    """
    runs = runs.dropna(subset=metric)
    if runs["subject"].nunique() < 2:
        return runs[[metric]].to_numpy(float)
    number = runs.groupby("subject").cumcount()
    return (
        runs.assign(number=number)
        .pivot(index="subject", columns="number", values=metric)
        .to_numpy(float)
    )


def unit_means(table):
    """Average rows, one per run and indexed by subject (among others), over what was drawn.

    Returns
    -------
    DataFrame
        A row per person; the rows themselves where there is one person or none.
    """
    people = table.groupby(level="subject")
    return people.mean() if people.ngroups > 1 else table


def size(runs):
    """Say how many runs there are, and of what, such as "12 people x 5 seeds" or "2 seeds"."""
    people = runs["subject"].nunique()
    seeds = runs["run"].nunique() // people
    words = f"{seeds} seed{'s' * (seeds != 1)}"
    return f"{people} people x {words}" if people > 1 else words


def described(runs):
    """Caption of figures: how many runs of what there are, and how their scatter is drawn."""
    sizes = {group: size(chosen) for group, chosen in runs.groupby("group", sort=False)}
    words = ", ".join(f"{label(group)} {sizes[group]}" for group in ordered(sizes))
    return (
        f"{words}; bands and bars: 95 % bootstrap intervals ({MIN_UNITS} people or seeds at least; "
        "below, thin lines and dots are runs)"
    )
