"""Tables: Table I and its companions, from what `evaluations.load_runs` returns."""

from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise, product

import numpy as np
import pandas as pd
from scipy.stats import page_trend_test

from rlihf_lib.report import paper
from rlihf_lib.report import statistics as st
from rlihf_lib.report.evaluations import METRICS, RANGES, phase_scores, size, units
from rlihf_lib.report.style import label, ordered

SPREAD = (
    "mean ± sample standard deviation (n - 1) over evaluation points [95 % bootstrap interval of "
    "the mean, where at least five people, or seeds of one, were drawn; = where these are all "
    "equal, which does not rule out rare failures]"
)
TABLE_1 = (
    f"Table I, beside the paper's numbers; {SPREAD}; our path efficiency is weighted by the share "
    "of the path completed, our deviation is from its nearest point, which the paper's need not "
    "be; Early has the untrained policy, too"
)
TESTED = (
    "late phase; [95 % bootstrap interval; = where nothing scatters]; p: permutation test over "
    "people and seeds, in brackets the smallest that could come out at this n; Holm: corrected for "
    "all tests of the table"
)
ORDERED = (
    "weights by mean over people, in brackets; p: Page's test of the paper's order, one-sided; "
    "Holm: corrected for the rows of the table"
)
EQUIVALENT = f"equivalent: less than {st.EQUIVALENCE_MARGIN:.2f} apart"
NO_INTERVAL = ", no interval"
#: What is compared of two groups (`statistics.difference`, `statistics.improvement`).
COMPARED = ("difference", "ci_low", "ci_high", "p", "smallest_p", "improvement", "improvement_low",
            "improvement_high")  # fmt: skip
DIGITS = {"return": 0, "clearance": 3}  # of the others: 2


def summarise(runs: pd.DataFrame, by: list[str], metrics: Sequence[str] = METRICS) -> pd.DataFrame:
    """Summarise metrics for every group of runs, named by columns such as ["phase", "group"].

    A row per group and metric: mean over people and seeds with ci_low and ci_high, iqm over runs
    with iqm_low and iqm_high (95 %; empty below `statistics.MIN_UNITS`); sd (n - 1) over evaluation
    points (the mean of a point's rollouts), as the paper's spread suggests; n, in words, n_runs and
    n_points, of those that have a value.
    """
    metrics = list(metrics)
    runs = runs.assign(group=pd.Categorical(runs["group"], ordered(runs["group"])))
    points = runs.groupby([*by, "run", "subject", "step"], observed=True)[metrics].mean()
    rows = []
    for keys, group in points.reset_index().groupby(by, observed=True):
        per_run = group.groupby(["subject", "run"])[metrics].mean().reset_index()
        for metric in metrics:
            scores, valued = units(per_run, metric), per_run.dropna(subset=metric)
            if not len(scores):  # no clearance, for no run places the can
                continue
            means = np.nanmean(scores, axis=1)
            low, high = st.mean_interval(means, RANGES[metric])
            iqm_low, iqm_high = st.iqm_interval(scores, RANGES[metric])
            rows.append(
                {
                    **dict(zip(by, keys, strict=True)), "metric": metric,
                    "mean": means.mean(), "sd": group[metric].std(ddof=1),
                    "ci_low": low, "ci_high": high,
                    "iqm": st.iqm(scores[np.isfinite(scores)]),
                    "iqm_low": iqm_low, "iqm_high": iqm_high,
                    "n": size(valued) + ("" if np.isfinite(low) else NO_INTERVAL),
                    "n_runs": len(valued), "n_points": group[metric].count(),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def late_table(runs: pd.DataFrame, by: Iterable[str] = ("group",)) -> pd.DataFrame:
    """`summarise` the late phase, also by weight of human feedback (Fig. 6 as numbers)."""
    return summarise(runs[runs["phase"] == "Late"], list(by))


def table_1(runs: pd.DataFrame) -> pd.DataFrame:
    """Table I: rows of `summarise` beside its paper_mean and paper_sd; then groups it hasn't."""
    ours = summarise(runs, ["phase", "group"], paper.METRICS)
    ours["phase"] = ours["phase"].astype(str)
    beside = paper.table_1().merge(ours, on=["phase", "group", "metric"], how="left")
    return pd.concat([beside, ours[~ours["group"].isin(paper.CONDITIONS)]], ignore_index=True)


def show_table_1(table: pd.DataFrame) -> pd.DataFrame:
    """Lay `table_1` out like the paper, whose numbers stand beside ours.

    Strings, a row per phase and method; the index is the phase, and says which are supplementary.
    """
    columns = [name for metric in paper.METRICS for name in (metric, f"{metric}, paper")]
    shown = show_summary(table, ["phase", "group"], columns)
    known = shown["method"].isin([label(group) for group in paper.CONDITIONS])
    shown["method"] += " (" + shown.pop("n").str.removesuffix(NO_INTERVAL) + ")"
    phase = shown.pop("phase")
    arrows = dict(zip(shown.columns[1::2], ("success rate ↑", "path efficiency ↑",
                                            "path deviation (m) ↓"), strict=True))  # fmt: skip
    papers = dict.fromkeys(shown.columns[2::2], "paper")
    return shown.rename(columns=arrows | papers).set_axis(
        phase.where(known, phase + ", supplementary")
    )


def show_summary(table: pd.DataFrame, by: list[str], columns: Iterable[str]) -> pd.DataFrame:
    """Lay rows of `summarise` out as strings: a row per group, named by `by`, and its n.

    A column is "success", 0.54 ± 0.45 [0.31, 0.74]; "iqm success", the interquartile mean with its
    interval; or "success, paper".
    """
    rows = []
    for keys, cells in table.groupby(by, sort=False, observed=True):
        texts = dict.fromkeys(columns, "")
        for c in cells.itertuples():
            texts[c.metric] = show_value(c.metric, c.mean, c.ci_low, c.ci_high, c.sd) or "not run"
            texts[f"iqm {c.metric}"] = show_value(c.metric, c.iqm, c.iqm_low, c.iqm_high)
            if "paper_mean" in cells:
                texts[f"{c.metric}, paper"] = show_value(c.metric, c.paper_mean, sd=c.paper_sd)
        named = dict(zip(by, map(label, keys), strict=True))
        if named.get("w_hf") == 0:  # nobody's feedback
            named["w_hf"] = "–"
        shown = {name.replace("_", " "): texts[name] for name in columns}
        rows.append({**named, **shown, "n": cells["n"].iloc[0]})
    return pd.DataFrame(rows).rename(columns={"group": "method"})


def show_value(
    metric: str, value: float, low: float = np.nan, high: float = np.nan, sd: float = np.nan
) -> str:
    """Format "0.54 ± 0.45 [0.31, 0.74]", or what there is of it; no minus before zero.

    Of units that are all equal the interval has no width and is no claim: "0.00 ± 0.00 [=]".
    """
    numbers = (f"{x:z.{DIGITS.get(metric, 2)}f}" for x in (value, sd, low, high))
    parts = zip(("{}", " ± {}", " [{}", ", {}]"), numbers, strict=True)
    text = "".join(part.format(number) for part, number in parts if number != "nan")
    return f"{text.partition(' [')[0]} [=]" if abs(high - low) < 1e-9 else text


def compare(
    first: pd.DataFrame, second: pd.DataFrame, metric: str, equivalence: bool = False
) -> dict:
    """Compare two groups of `evaluations.phase_scores`, over the people whom both know.

    Where both know two people or more, they are paired; the seeds of one person, or of a baseline
    that knows none, are not, for five pairs of seeds can't get below p = .06. Returns metric; n, in
    words; what `statistics.difference` and `statistics.improvement` say; if asked, p_equivalent and
    smallest_p_equivalent (`statistics.equivalence_test`).
    """
    first, second = (group.dropna(subset=metric) for group in (first, second))
    people, others = (set(group["person"]) - {""} for group in (first, second))
    shared = people & others
    if people and others:
        first, second = (g[g["person"].isin(shared)] for g in (first, second))
    if first.empty or second.empty:  # no clearance, for nobody places the can with both
        return {"metric": metric, "n": "nobody", **dict.fromkeys(COMPARED, np.nan)}
    paired = len(shared) > 1
    x, y = units(first, metric), units(second, metric)
    low, high = RANGES[metric]
    better = -1 if metric in ("path_deviation", "collisions") else 1
    found = st.difference(x, y, paired, (low - high, high - low))
    n = f"{len(x)} people, paired" if paired else f"{size(first)} and {size(second)}"
    n += "" if np.isfinite(found["ci_low"]) else NO_INTERVAL
    row = {"metric": metric, "n": n, **found, **st.improvement(better * x, better * y, paired)}
    if equivalence:
        p = st.equivalence_test(np.nanmean(x, axis=1), np.nanmean(y, axis=1), paired)
        row["p_equivalent"], row["smallest_p_equivalent"] = p
    return row


def comparison_table(
    runs: pd.DataFrame,
    others: Iterable[str] = ("sparse", "dense"),
    metrics: Iterable[str] = ("success", "return", *paper.METRICS[1:]),
) -> pd.DataFrame:
    """Compare RLIHF with other groups in the late phase: one family of tests.

    Success is also tested for being equal to that of dense reward, as the paper claims. Columns
    comparison, those of `compare`, p_holm and smallest_p_holm.
    """
    late = dict(list(phase_scores(runs).groupby("group")))
    person = {other: "".join(set(late[other]["person"])) for other in others}  # of a control
    return family(
        {
            "comparison": f"{label('rlihf')} {person[other]}".rstrip() + f" - {label(other)}",
            **compare(late["rlihf"], late[other], metric, (other, metric) == ("dense", "success")),
        }
        for metric in metrics
        for other in others
    )


def weight_comparison(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare every two weights in the late phase, larger minus smaller; as `comparison_table`."""
    weights = dict(list(phase_scores(runs).query("group == 'rlihf'").groupby("w_hf")))
    return family(
        {"comparison": f"RLIHF {b:g} - {a:g}", **compare(weights[b], weights[a], metric)}
        for metric in ("return", "success", "clearance")
        for a, b in combinations(weights, 2)
    )


def order_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Is more weight better, as in the paper, and sooner? Page's test of the order, over people.

    Each person's means rank the weights, or each seed's of one person. A row for success in every
    phase and for late return: ours, the weights by mean (≈ where two have the same, as written),
    and paper, the paper's order; p, exact where nothing is tied and too large else, and p_holm.
    """
    rows = []
    for phase, metric in [*product(paper.PHASES, ["success"]), ("Late", "return")]:
        scores = phase_scores(runs, phase).query("group == 'rlihf'")
        unit = "subject" if scores["subject"].nunique() > 1 else "seed"
        means = scores.pivot_table(metric, unit, "w_hf").dropna()
        weights, ranked = sorted(means), means.mean().sort_values(kind="stable")
        levels = [show_value(metric, mean) for mean in ranked]
        signs = [""] + [" ≈ " if a == b else " < " for a, b in pairwise(levels)]
        ours = zip(signs, ranked.index, levels, strict=True)
        p = page_trend_test(means).pvalue if len(means) > 1 and len(weights) > 2 else np.nan
        rows.append(
            {
                "phase": phase, "metric": metric, "p": p,
                "ours": "".join(f"{sign}{weight:g} ({level})" for sign, weight, level in ours),
                "paper": " < ".join(f"{w:g}" for w in weights),
                "n": f"{len(means)} {'people' if unit == 'subject' else 'seeds'}",
            }
        )  # fmt: skip
    table = pd.DataFrame(rows)
    return table.assign(p_holm=st.holm(table["p"]))[
        ["phase", "metric", "paper", "ours", "p", "p_holm", "n"]
    ]


def family(rows: Iterable[dict], tests: Iterable[str] = ("p",)) -> pd.DataFrame:
    """Correct the tests for one another, and the smallest p that could come out alike."""
    table = pd.DataFrame(rows)
    names = [name for test in tests for name in (test, f"smallest_{test}")]
    return table.assign(**{f"{name}_holm": st.holm(table[name]) for name in names})


def show_p(p: float, smallest: float) -> str:
    """Write a p, and in brackets the smallest that could have come out."""
    if np.isnan(p):
        return ""
    return f"{p:.2g} ({smallest:.2g})" if smallest < 1 else "no test"


def show_comparison(table: pd.DataFrame) -> pd.DataFrame:
    """Lay comparisons out as strings: each p with the smallest that could come out in brackets.

    Where no other p than 1 could, as of one run against another, there is no test.
    """
    shown = table[["metric", "comparison"]].replace({"metric": {"_": " "}}, regex=True)
    shown.columns = ["metric", "compared, late phase"]
    rows = list(table.itertuples())
    shown["difference"] = [show_value(r.metric, r.difference, r.ci_low, r.ci_high) for r in rows]
    shown["P(better)"] = [
        show_value("", r.improvement, r.improvement_low, r.improvement_high) for r in rows
    ]
    for name in ("p", "p_holm", "p_equivalent", "p_equivalent_holm"):
        if name in table:
            words = name.replace("_", ", ").replace("holm", "Holm")
            pairs = zip(table[name], table[f"smallest_{name}"], strict=True)
            shown[words] = [show_p(*pair) for pair in pairs]
    return shown.assign(n=table["n"])
