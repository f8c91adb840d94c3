"""Read the evaluations and training episodes of a study's runs."""

import numpy as np
import pandas as pd

from rlihf_lib.report import paper

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
        The columns of `eval.csv` after run, condition, subject, w_hf, seed.

    Raises
    ------
    FileNotFoundError
        If a run is missing.
    ValueError
        If a table lacks a column or holds a number that is none.
    """
    return _load(study, stages, "eval.csv", EVAL_COLUMNS)


def load_training(study, stages):
    """Read the training episodes of a study's finished runs; see `load_runs`.

    Returns
    -------
    DataFrame
        The columns of `train.csv` (step, episode, return, success, ...) after run, condition,
        subject, w_hf, seed. The return is in units of the condition's own reward.
    """
    return _load(study, stages, "train.csv", ("step", "episode", "return", "success"))


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
    from rlihf_lib.rl.sweep import is_done  # imports Dask, so only when asked

    frames = []
    for config in configs:
        path = runs_dir / config.run_id / name
        if not is_done(config, runs_dir):
            raise FileNotFoundError(
                f"{path.parent} is missing or made from another config; "
                "train it with notebook 03_policy_training or 05_whf_ablation (--only 03 05)"
            )
        frame = pd.read_csv(path, float_precision="round_trip")
        missing = [column for column in columns if column not in frame.columns]
        if missing:
            raise ValueError(f"{path} lacks the column(s) {', '.join(missing)}; delete the run")
        broken = frame["return"].isna() | frame["success"].isna()
        if broken.any():
            line = frame.index[broken][0] + 2
            raise ValueError(f"{path}, line {line}: return or success is empty; delete the run")
        frame.insert(0, "run", config.run_id)
        frame.insert(1, "condition", config.condition)
        frame.insert(2, "subject", config.subject)
        frame.insert(3, "w_hf", config.w_hf)
        frame.insert(4, "seed", config.seed)
        frames.append(frame)
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
