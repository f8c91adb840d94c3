"""What a study's runs have written, read and named; how they are counted and averaged."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from rlihf_lib.report import paper
from rlihf_lib.report.statistics import MIN_UNITS, NO_BOUNDS, PROBABILITY
from rlihf_lib.report.style import label, ordered
from rlihf_lib.rl.feedback import person_and_control
from rlihf_lib.rl.runs import RunConfig, read_run

#: Values each metric can take, a step's return 1 at most; clearance is of cans that are placed.
RANGES = {
    "return": (-np.inf, RunConfig.horizon), "success": PROBABILITY, "completed": PROBABILITY,
    "path_efficiency": PROBABILITY, "path_deviation": (0, np.inf), "collisions": (0, np.inf),
    "clearance": NO_BOUNDS,
}  # fmt: skip
METRICS = tuple(RANGES)
#: How figures show scatter, for their captions.
SCATTER = (
    "bands, bars: 95 % bootstrap intervals over people or seeds "
    f"(of {MIN_UNITS} or more; else runs, or hollow means)"
)


def group_of(config) -> str:
    """Name what a run is compared as: its condition, and whatever isn't as in the paper.

    That is, a control of p(error), "rlihf-ideal", and settings that differ from the default as in
    the run's id, such as "sparse-patience1000-discount0.98" or "rlihf-lay".
    """
    control = person_and_control(config.subject)[1]
    return "-".join(filter(None, [config.condition, control, *config.changes]))


def load_runs(study, stages: Iterable[str] = paper.CONDITIONS) -> pd.DataFrame:
    """Read the evaluations of the finished runs of some stages of `study.run_configs`.

    A row per rollout: run, group (`group_of`), condition, person (whose p(error) it drew on, "" for
    nobody's), subject, w_hf, seed; the columns of `eval.csv`; those of `derive`. A run that is
    missing raises FileNotFoundError; a table that lacks a column or a number, ValueError.
    """
    needed = ("step", "rollout", *METRICS[:-1], "min_clearance")
    return derive(_read_runs(study, stages, "eval.csv", needed))


def load_training(study, stages: Iterable[str]) -> pd.DataFrame:
    """Read how training went, in windows of steps, in a study's finished runs; see `load_runs`.

    The columns of `train.csv` are means over the episodes that ended in the window, empty where
    none did; the return is that of the condition's own reward.
    """
    return _read_runs(study, stages, "train.csv", ("step", "episodes", "return", "success"))


def _read_runs(study, stages, name, columns):
    frames = []
    for config in dict.fromkeys(c for stage in stages for c in study.run_configs(stage)):
        named = {key: getattr(config, key) for key in ("condition", "subject", "w_hf", "seed")}
        named |= {"run": config.run_id, "group": group_of(config)}
        named |= {"person": person_and_control(config.subject)[0]}
        frames.append(read_run(config, study.runs, name, columns).assign(**named))
    return pd.concat(frames, ignore_index=True)


def derive(runs: pd.DataFrame) -> pd.DataFrame:
    """Add the columns phase and clearance.

    Early, Mid and Late are the thirds of training, as in the paper; runs are evaluated after their
    last step, the paper's thirds end at 50k, 100k and 150k. Clearance is the smallest of a rollout
    that places the can, in m: who stays at the start keeps it, too.
    """
    third = np.ceil(3 * runs["step"] / runs["step"].max()).clip(1, 3).astype(int) - 1
    phase = pd.Categorical.from_codes(third, paper.PHASES, ordered=True)
    return runs.assign(phase=phase, clearance=runs["min_clearance"].where(runs["success"] == 1))


def phase_scores(runs: pd.DataFrame, phase: str = "Late") -> pd.DataFrame:
    """Average each run over a phase, a row per run: the score by which runs are compared."""
    keys = ["group", "person", "subject", "w_hf", "seed", "run"]
    return runs[runs["phase"] == phase].groupby(keys)[list(METRICS)].mean().reset_index()


def units(runs: pd.DataFrame, metric: str) -> np.ndarray:
    """Arrange runs, a row each, by what was drawn at random; see `statistics`.

    Shape (n_units, n_seeds): a row per person in the order of their names, or per run where there
    is one person or none. NaN where a person has fewer runs than another; runs without a value are
    left out.
    """
    runs = runs.dropna(subset=metric)
    if runs["subject"].nunique() < 2:
        return runs[[metric]].to_numpy(float)
    numbered = runs.assign(number=runs.groupby("subject").cumcount())
    return numbered.pivot(index="subject", columns="number", values=metric).to_numpy(float)


def unit_means(table: pd.DataFrame) -> pd.DataFrame:
    """Average each person's rows, a run each, indexed by subject; as they are of one or none."""
    people = table.groupby(level="subject")
    return people.mean() if people.ngroups > 1 else table


def size(runs: pd.DataFrame) -> str:
    """Say how many runs there are, and of what, such as "12 people x 5 seeds" or "2 seeds"."""
    seeds = runs.groupby("subject")["run"].nunique()
    least, most = int(seeds.min()), int(seeds.max())
    words = f"{most} seed{'s' * (most != 1)}"
    words = words if least == most else f"{least} to {words}"
    return f"{len(seeds)} people x {words}" if len(seeds) > 1 else words


def described(runs: pd.DataFrame) -> str:
    """Caption of figures: how many runs of what there are, and how their scatter is drawn."""
    sizes = {group: size(chosen) for group, chosen in runs.groupby("group", sort=False)}
    words = ", ".join(f"{label(group)} {sizes[group]}" for group in ordered(sizes))
    weights = runs.loc[runs["condition"] == "rlihf", "w_hf"].unique()
    if len(weights) == 1:
        words += f"; w_hf = {weights.item():g}"
    return f"{words}; {SCATTER}"
