"""Tables: Table I and its companions, from the runs' `eval.csv`."""

from itertools import combinations

import numpy as np
import pandas as pd

from rlihf_lib.report import paper
from rlihf_lib.report import statistics as st
from rlihf_lib.report.evaluations import (
    LOWER_IS_BETTER,
    METRICS,
    RANGES,
    UNBOUNDED,
    add_phase,
    late_scores,
    size,
    units,
)
from rlihf_lib.report.style import label, ordered

SPREAD = (
    "mean ± sample standard deviation (n - 1) over evaluation points [95 % bootstrap interval of "
    "the mean, where at least five people, or seeds of one, were drawn]"
)
TESTED = (
    "late phase; [95 % bootstrap interval]; p: permutation test over people and seeds, in brackets "
    "the smallest that could come out at this n; Holm: corrected for all tests of the table"
)
NO_INTERVAL = ", no interval"
P_VALUES = {
    "p": "p",
    "p_holm": "p, Holm",
    "p_equivalent": "p, equivalent",
    "p_equivalent_holm": "p, equivalent, Holm",
}
DIGITS = {"return": 0, "min_clearance": 3}  # of the others: 2


def summarise(runs, by, metrics=METRICS):
    """Summarise metrics for every group of runs.

    Parameters
    ----------
    runs : DataFrame
        From `evaluations.load_runs`.
    by : list of str
        Columns that name a group, such as ["phase", "group"].
    metrics : sequence of str

    Returns
    -------
    DataFrame
        One row per group and metric: mean and sd (n - 1) over evaluation points (the mean of a
        point's rollouts, as the paper's spread suggests), ci_low and ci_high (95 % interval of the
        mean over people and seeds), iqm over runs, iqm_low, iqm_high; n, in words; n_runs,
        n_points. Without an interval (`statistics.MIN_UNITS`), its ends are empty.
    """
    metrics = list(metrics)
    point = list(dict.fromkeys([*by, "run", "subject", "step"]))
    if "group" in by:
        runs = runs.assign(group=pd.Categorical(runs["group"], ordered(runs["group"])))
    points = runs.groupby(point, observed=True)[metrics].mean().reset_index()
    rows = []
    for keys, group in points.groupby(by, observed=True):
        per_run = group.groupby(["subject", "run"])[metrics].mean().reset_index()
        for metric in metrics:
            scores, bounds = units(per_run, metric), RANGES.get(metric, UNBOUNDED)
            low, high = st.mean_interval(np.nanmean(scores, axis=1), bounds)
            iqm_low, iqm_high = st.iqm_interval(scores, bounds)
            rows.append(
                {
                    **dict(zip(by, keys, strict=True)), "metric": metric,
                    "mean": group[metric].mean(), "sd": group[metric].std(ddof=1),
                    "ci_low": low, "ci_high": high,
                    "iqm": st.iqm(scores[np.isfinite(scores)]),
                    "iqm_low": iqm_low, "iqm_high": iqm_high,
                    "n": size(per_run) + ("" if np.isfinite(low) else NO_INTERVAL),
                    "n_runs": len(per_run), "n_points": len(group),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def table_1(runs, total_steps):
    """Table I: phases by methods, with the paper's values in the columns paper_mean, paper_sd.

    Returns
    -------
    DataFrame
        Rows of `summarise` for every phase, group and metric of the paper, then those of the groups
        that the paper hasn't.
    """
    ours = summarise(add_phase(runs, total_steps), ["phase", "group"], paper.METRICS)
    ours["phase"] = ours["phase"].astype(str)
    beside = paper.table_1().merge(ours, on=["phase", "group", "metric"], how="left")
    return pd.concat([beside, ours[~ours["group"].isin(paper.CONDITIONS)]], ignore_index=True)


def show_table_1(table):
    """Lay `table_1` out like the paper: a row per phase and method, ours and the paper's beside.

    Returns
    -------
    DataFrame
        Strings, ready to be shown or saved; the index says which rows are supplementary.
    """
    rows, blocks = [], []
    for (phase, group), cells in table.groupby(["phase", "group"], sort=False):
        row = {"phase": phase, "method": label(group)}
        for cell in cells.itertuples():
            name, known = cell.metric.replace("_", " "), pd.notna(cell.paper_mean)
            row[name] = show(cell)
            row[f"{name}, paper"] = f"{cell.paper_mean:.2f} ± {cell.paper_sd:.2f}" if known else ""
        row["n"] = cells["n"].iloc[0]
        rows.append(row)
        blocks.append("as in the paper" if group in paper.CONDITIONS else "supplementary")
    return pd.DataFrame(rows, index=blocks)


def show(cell):
    """Format a row of `summarise`: "0.54 ± 0.45 [0.31, 0.74]"."""
    if np.isnan(cell.mean):
        return "not run"
    spread = "" if np.isnan(cell.sd) else f" ± {cell.sd:.{DIGITS.get(cell.metric, 2)}f}"
    return number(cell.mean, cell.metric) + spread + between(cell.ci_low, cell.ci_high, cell.metric)


def number(value, metric):
    """Format a value of a metric with its digits; no minus before zero."""
    return f"{value:z.{DIGITS.get(metric, 2)}f}"


def between(low, high, metric):
    """Format an interval: " [0.31, 0.74]", or nothing where there is none."""
    return "" if np.isnan(low) else f" [{number(low, metric)}, {number(high, metric)}]"


def show_summary(table, by, metrics):
    """Lay rows of `summarise` out with one column per metric.

    Parameters
    ----------
    table : DataFrame
        From `summarise`.
    by : list of str
        Its group columns.
    metrics : sequence of str
        Those shown; "iqm return" shows the interquartile mean.

    Returns
    -------
    DataFrame
        Strings.
    """
    rows = []
    for keys, cells in table.groupby(by, sort=False, observed=True):
        by_metric = {cell.metric: cell for cell in cells.itertuples()}
        row = {k: label(v) if k == "group" else v for k, v in zip(by, keys, strict=True)}
        for name in metrics:
            cell = by_metric[name.removeprefix("iqm ")]
            robust = number(cell.iqm, cell.metric)
            robust += between(cell.iqm_low, cell.iqm_high, cell.metric)
            row[name.replace("_", " ")] = robust if name.startswith("iqm ") else show(cell)
        rows.append({**row, "n": cells["n"].iloc[0]})
    return pd.DataFrame(rows)


def late_table(runs, total_steps, by=("group",)):
    """Late phase of every group, or also of every weight of human feedback (Fig. 6 as numbers).

    Returns
    -------
    DataFrame
        Rows of `summarise`.
    """
    return summarise(add_phase(runs, total_steps).query("phase == 'Late'"), list(by))


def compare(first, second, metric, equivalence=False):
    """Compare two groups of runs, over the people whom both know.

    Where both know two people or more, they are paired; the seeds of one person, or of a baseline
    that knows none, are not, for five pairs of seeds can't get below p = .06.

    Parameters
    ----------
    first, second : DataFrame
        From `evaluations.late_scores`.
    metric : str
    equivalence : bool
        Test whether they are equal, too.

    Returns
    -------
    dict
        metric; n, in words; what `statistics.difference` and `statistics.improvement` say;
        p_equivalent and smallest_p_equivalent (`statistics.equivalence_test`) if asked.
    """
    shared = (set(first["person"]) & set(second["person"])) - {""}
    if shared:
        first, second = (g[g["person"].isin(shared)] for g in (first, second))
    paired = len(shared) > 1
    x, y = units(first, metric), units(second, metric)
    low, high = RANGES.get(metric, UNBOUNDED)
    better = -1 if metric in LOWER_IS_BETTER else 1
    row = {
        "metric": metric,
        "n": f"{len(x)} people, paired" if paired else f"{size(first)} and {size(second)}",
        **st.difference(x, y, paired, (low - high, high - low)),
        **st.improvement(better * x, better * y, paired),
    }
    row["n"] += "" if np.isfinite(row["ci_low"]) else NO_INTERVAL
    if equivalence:
        p = st.equivalence_test(np.nanmean(x, axis=1), np.nanmean(y, axis=1), paired)
        row["p_equivalent"], row["smallest_p_equivalent"] = p
    return row


def comparison_table(
    runs,
    total_steps,
    others=("sparse", "dense"),
    metrics=("success", "return", *paper.METRICS[1:]),
):
    """Compare RLIHF with other groups in the late phase: one family of tests.

    Success is also tested for being equal to that of dense reward, as the paper claims.

    Returns
    -------
    DataFrame
        Columns comparison, those of `compare`, p_holm and smallest_p_holm.
    """
    late = dict(list(late_scores(runs, total_steps).groupby("group")))
    return _family(
        {
            "comparison": f"{label('rlihf')} - {label(other)}",
            **compare(late["rlihf"], late[other], metric, (other, metric) == ("dense", "success")),
        }
        for metric in metrics
        for other in others
    )


def weight_comparison(runs, total_steps, metrics=("return", "success")):
    """Compare every two weights in the late phase, larger minus smaller; as `comparison_table`."""
    late = late_scores(runs, total_steps).query("group == 'rlihf'")
    weights = dict(list(late.groupby("w_hf")))
    return _family(
        {
            "comparison": f"{large:g} - {small:g}",
            **compare(weights[large], weights[small], metric),
        }
        for metric in metrics
        for small, large in combinations(weights, 2)
    )


def _family(rows):
    table = pd.DataFrame(rows)
    return table.assign(p_holm=st.holm(table["p"]), smallest_p_holm=st.holm(table["smallest_p"]))


def show_comparison(table):
    """Lay a table of comparisons out: each p with the smallest that could come out in brackets."""
    rows = list(table.itertuples())
    shown = {
        "metric": table["metric"].str.replace("_", " "),
        "comparison": table["comparison"],
        "difference": [
            number(row.difference, row.metric) + between(row.ci_low, row.ci_high, row.metric)
            for row in rows
        ],
        "P(better)": [
            number(row.improvement, "") + between(row.improvement_low, row.improvement_high, "")
            for row in rows
        ],
    }
    for name, words in P_VALUES.items():
        if name in table:
            pairs = zip(table[name], table[f"smallest_{name}"], strict=True)
            shown[words] = ["" if np.isnan(p) else f"{p:.2g} ({least:.2g})" for p, least in pairs]
    return pd.DataFrame({**shown, "n": table["n"]})


def subject_table(runs, scores, total_steps):
    """Decoder and policy side by side, and each person's policy against dense reward (late phase).

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
        By auroc; columns subject, auroc, balanced_accuracy, accuracy_online, then of late success:
        success, success_low, success_high, dense; comparison and what `compare` says of it; p_holm
        and p_equivalent_holm with the smallest possible; return.
    """
    late = late_scores(runs, total_steps)
    dense = late.query("group == 'dense'")
    rows = []
    for person, own in late.query("group == 'rlihf'").groupby("subject"):
        low, high = st.mean_interval(own["success"], (0, 1))
        rows.append(
            {
                "subject": person, "comparison": f"{person} - {label('dense')}",
                "success": own["success"].mean(),
                "success_low": low, "success_high": high, "dense": dense["success"].mean(),
                "return": own["return"].mean(), **compare(own, dense, "success", True),
            }
        )  # fmt: skip
    table = _family(rows)
    for name in ("p_equivalent", "smallest_p_equivalent"):
        table[f"{name}_holm"] = st.holm(table[name])
    decoder = scores[["subject", "auroc", "balanced_accuracy", "accuracy_online"]]
    return decoder.merge(table, on="subject").sort_values("auroc", ignore_index=True)


def correlation_table(by_subject, metrics=("success", "return")):
    """Spearman's correlation of AUROC with what the policies reach late, over people.

    Parameters
    ----------
    by_subject : DataFrame
        From `subject_table`.
    metrics : sequence of str

    Returns
    -------
    DataFrame
        A row per metric; columns of `statistics.spearman`.
    """
    rows = [{"metric": m, **st.spearman(by_subject["auroc"], by_subject[m])} for m in metrics]
    return pd.DataFrame(rows)
