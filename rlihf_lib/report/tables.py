"""Tables: Table I and its companions, from the runs' `eval.csv`."""

from itertools import combinations

import numpy as np
import pandas as pd

from rlihf_lib.files import write_csv, write_text
from rlihf_lib.report import paper
from rlihf_lib.report.evaluations import EVAL_COLUMNS, add_phase
from rlihf_lib.report.statistics import bootstrap_interval, iqm, paired_test
from rlihf_lib.report.style import caption

METRICS = EVAL_COLUMNS[2:]
METHODS = {"sparse": "RL sparse", "dense": "RL dense", "rlihf": "RLIHF"}


def summarise(runs, by, metrics=METRICS):
    """Summarise metrics for every group of runs.

    Parameters
    ----------
    runs : DataFrame
        From `evaluations.load_runs`.
    by : list of str
        Columns that name a group, such as ["phase", "condition"].
    metrics : sequence of str

    Returns
    -------
    DataFrame
        One row per group and metric: mean and sd over evaluation points (the mean of a point's
        rollouts, as the paper's spread suggests), iqm over runs, ci_low and ci_high (95 %
        bootstrap interval of the mean over runs, within subjects; empty for fewer than two
        seeds), n_runs, n_points.
    """
    point = list(dict.fromkeys([*by, "run", "subject", "step"]))
    points = runs.groupby(point, observed=True)[list(metrics)].mean().reset_index()
    rows = []
    for keys, group in points.groupby(by, observed=True):
        per_run = group.groupby(["run", "subject"])[list(metrics)].mean()
        strata = per_run.index.get_level_values("subject")
        for metric in metrics:
            scores = per_run[metric].to_numpy()
            known = np.isfinite(scores)  # a metric may be undefined for a run, such as a clearance
            low, high = bootstrap_interval(scores[known], strata[known])
            rows.append(
                {
                    **dict(zip(by, keys, strict=True)),
                    "metric": metric,
                    "mean": group[metric].mean(),
                    "sd": group[metric].std(ddof=1),
                    "iqm": iqm(scores[known]) if known.any() else np.nan,
                    "ci_low": low,
                    "ci_high": high,
                    "n_runs": len(per_run),
                    "n_points": len(group),
                }
            )
    return pd.DataFrame(rows)


def table_1(runs, total_steps):
    """Table I: phases by methods, with the paper's values in the columns paper_mean, paper_sd.

    Returns
    -------
    DataFrame
        Rows of `summarise` for every phase, condition and metric of the paper.
    """
    ours = summarise(add_phase(runs, total_steps), ["phase", "condition"], paper.METRICS)
    return paper.table_1().merge(ours, on=["phase", "condition", "metric"], how="left")


def show_table_1(table):
    """Lay `table_1` out like the paper: a row per phase and method, ours and the paper's beside.

    Returns
    -------
    DataFrame
        Strings, ready to be shown or written as Markdown.
    """
    rows = []
    for (phase, condition), cells in table.groupby(["phase", "condition"], sort=False):
        row = {"phase": phase, "method": METHODS[condition]}
        for cell in cells.itertuples():
            name = cell.metric.replace("_", " ")
            row[name] = show(cell)
            row[f"{name}, paper"] = f"{cell.paper_mean:.2f} ± {cell.paper_sd:.2f}"
        row["n runs"] = int(cells["n_runs"].fillna(0).max())
        rows.append(row)
    return pd.DataFrame(rows)


def show(cell, digits=2):
    """Format a row of `summarise`: "0.54 ± 0.45 [0.31, 0.74]"."""
    if np.isnan(cell.mean):
        return "not run"
    text = f"{cell.mean:.{digits}f}"
    if not np.isnan(cell.sd):
        text += f" ± {cell.sd:.{digits}f}"
    if not np.isnan(cell.ci_low):
        text += f" [{cell.ci_low:.{digits}f}, {cell.ci_high:.{digits}f}]"
    return text


def weight_table(runs, total_steps):
    """Late phase of every weight of human feedback, with the baselines (Fig. 6 as numbers).

    Returns
    -------
    DataFrame
        Rows of `summarise` by condition and w_hf.
    """
    late = add_phase(runs, total_steps).query("phase == 'Late'")
    return summarise(late, ["condition", "w_hf"])


def weight_comparison(runs, total_steps, metrics=("return", "success")):
    """Compare every two weights in the late phase, paired by subject and seed.

    Returns
    -------
    DataFrame
        Columns metric, comparison, difference (larger minus smaller weight), p (paired
        permutation test), n_pairs.
    """
    late = add_phase(runs, total_steps).query("phase == 'Late' and condition == 'rlihf'")
    scores = late.groupby(["subject", "seed", "w_hf"])[list(metrics)].mean().unstack("w_hf")
    rows = []
    for metric in metrics:
        for small, large in combinations(scores[metric].columns, 2):
            difference, p = paired_test(scores[metric][large], scores[metric][small])
            rows.append((metric, f"{large:g} - {small:g}", difference, p, len(scores)))
    return pd.DataFrame(rows, columns=["metric", "comparison", "difference", "p", "n_pairs"])


def show_summary(table, by, metrics):
    """Lay rows of `summarise` out with one column per metric.

    Parameters
    ----------
    table : DataFrame
        From `summarise`.
    by : list of str
        Its group columns.
    metrics : sequence of str

    Returns
    -------
    DataFrame
        Strings.
    """
    rows = []
    for keys, cells in table.groupby(by, sort=False):
        by_metric = {cell.metric: cell for cell in cells.itertuples()}
        row = dict(zip(by, keys, strict=True))
        row |= {metric.replace("_", " "): show(by_metric[metric]) for metric in metrics}
        row["n runs"] = int(cells["n_runs"].max())
        rows.append(row)
    return pd.DataFrame(rows)


def subject_table(runs, scores, total_steps):
    """Decoder and policy side by side, per policy subject (late phase).

    Parameters
    ----------
    runs : DataFrame
        Of the main comparison.
    scores : DataFrame
        `decoder/scores.csv`.
    total_steps : int

    Returns
    -------
    DataFrame
        Columns subject, auroc, balanced_accuracy, success, return, ... of RLIHF, their sd and
        intervals, and success_minus_dense, return_minus_dense.
    """
    late = add_phase(runs, total_steps).query("phase == 'Late'")
    dense = late.query("condition == 'dense'")[list(METRICS)].mean()
    table = summarise(late.query("condition == 'rlihf'"), ["subject"], ("success", "return"))
    wide = table.pivot(index="subject", columns="metric", values=["mean", "ci_low", "ci_high"])
    wide.columns = [
        metric if kind == "mean" else f"{metric}_{kind}" for kind, metric in wide.columns
    ]
    wide["n_runs"] = table.groupby("subject")["n_runs"].first()
    for metric in ("success", "return"):
        wide[f"{metric}_minus_dense"] = wide[metric] - dense[metric]
    decoder = scores[["subject", "auroc", "balanced_accuracy", "accuracy_online"]]
    return decoder.merge(wide.reset_index(), on="subject", how="inner").sort_values("auroc")


def comparison_table(runs, total_steps):
    """Compare RLIHF with both baselines in the late phase, paired by seed.

    RLIHF's scores are averaged over subjects within a seed first, because all subjects of a seed
    are compared with the same baseline run.

    Returns
    -------
    DataFrame
        Columns metric, comparison, difference, p (paired permutation test), n_pairs.
    """
    late = add_phase(runs, total_steps).query("phase == 'Late'")
    seeds = late.groupby(["condition", "seed", "run"])[list(METRICS)].mean()
    seeds = seeds.groupby(level=["condition", "seed"]).mean()
    rows = []
    for other in ("sparse", "dense"):
        pairs = seeds.loc["rlihf"].join(seeds.loc[other], rsuffix="_other", how="inner")
        for metric in METRICS:
            difference, p = paired_test(pairs[metric], pairs[f"{metric}_other"])
            rows.append((metric, f"RLIHF - {METHODS[other]}", difference, p, len(pairs)))
    return pd.DataFrame(rows, columns=["metric", "comparison", "difference", "p", "n_pairs"])


def save_table(study, name, table, shown=None):
    """Write a table as `tables/<name>.csv` and, as people read it, `tables/<name>.md`.

    Parameters
    ----------
    study : Study
    name : str
    table : DataFrame
        All numbers, in full precision.
    shown : DataFrame, optional
        What the Markdown shows; `table` if None.

    Returns
    -------
    DataFrame
        What was shown.
    """
    shown = table if shown is None else shown
    write_csv(study.tables / f"{name}.csv", table)
    rows = [shown.columns, ["---"] * len(shown.columns), *shown.itertuples(index=False)]
    lines = ["| " + " | ".join(map(str, row)) + " |" for row in rows]
    header = f"{caption(study)}; mean ± sd over evaluation points [95 % bootstrap interval]"
    write_text(study.tables / f"{name}.md", "\n".join([header, "", *lines, ""]))
    return shown
