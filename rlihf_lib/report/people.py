"""What decides: each person's decoder beside the policy that it taught."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import isotonic_regression

from rlihf_lib.report import paper
from rlihf_lib.report import statistics as st
from rlihf_lib.report.evaluations import derive, phase_scores
from rlihf_lib.report.style import label
from rlihf_lib.report.tables import compare, family, show_p, show_value
from rlihf_lib.rl.feedback import read_table

CORRELATED = (
    "Spearman's rank correlation with AUROC, over people [95 % bootstrap interval]; p: permutations"
)
THRESHOLD = (
    "late success; places: at least one can in ten; half of dense: isotonic regression over people "
    "[95 % bootstrap interval]"
)
MEASURES = ["auroc", "balanced_accuracy", "accuracy_online"]  # of decoders
TAUGHT = ("success", "completed")
REACHED = ("success", "return", "success_early", "success_mid")


def subject_table(runs: pd.DataFrame, scores: pd.DataFrame) -> pd.DataFrame:
    """Decoder and policy side by side, and each person's policy against dense reward (late phase).

    From the runs of the main comparison and `decoder/scores.csv`, by AUROC. Columns subject,
    `MEASURES`; of late success success, success_low, success_high, dense, what `tables.compare`
    says and Holm's p of both its tests; late return, completed, clearance; success_early and
    success_mid.
    """
    late = phase_scores(runs)
    dense = late.query("group == 'dense'")
    rows = []
    for person, own in late.query("group == 'rlihf'").groupby("subject"):
        low, high = st.mean_interval(own["success"], st.PROBABILITY)
        means = own[["success", "return", "completed", "clearance"]].mean()
        rows.append(
            {
                "subject": person, "comparison": f"RLIHF {person} - {label('dense')}", **means,
                "success_low": low, "success_high": high, "dense": dense["success"].mean(),
                **compare(own, dense, "success", True),
            }
        )  # fmt: skip
    table = scores[["subject", *MEASURES]].merge(family(rows, ("p", "p_equivalent")), on="subject")
    for phase in paper.PHASES[:-1]:
        own = phase_scores(runs, phase).query("group == 'rlihf'").groupby("subject")["success"]
        table[f"success_{phase.lower()}"] = table["subject"].map(own.mean())
    return table.sort_values("auroc", ignore_index=True)


def correlation_table(people: pd.DataFrame) -> pd.DataFrame:
    """`statistics.spearman` of AUROC with what policies have reached, over `subject_table`.

    A row for each of `REACHED`, with Holm's p over all of them.
    """
    return family(
        {"metric": metric, **st.spearman(people["auroc"], people[metric])} for metric in REACHED
    )


def show_correlations(table: pd.DataFrame) -> pd.DataFrame:
    """Lay `correlation_table` out as strings."""
    rows = list(table.itertuples())
    return pd.DataFrame(
        {
            "of AUROC with": [row.metric.replace("_", ", ") for row in rows],
            "ρ": [show_value("", row.rho, row.ci_low, row.ci_high) for row in rows],
            "p": [show_p(row.p, row.smallest_p) for row in rows],
            "p, Holm": [show_p(row.p_holm, row.smallest_p_holm) for row in rows],
            "n": [f"{row.n} people" for row in rows],
        }
    )


def threshold_table(people: pd.DataFrame) -> pd.DataFrame:
    """How good a decoder has to be for the robot to place the can at all, over `subject_table`.

    It does not where late success is below `statistics.EQUIVALENCE_MARGIN`. A row per measure of
    the decoder: fails_up_to, the best one that taught no success; places_from, the weakest that
    did; n_places, n. Where the first is larger, the measure does not part people. And half_at,
    where half of dense reward's success is reached by isotonic regression over people, with its
    interval half_low, half_high (people resampled); empty where nobody reaches it.
    """
    places = people["success"] >= st.EQUIVALENCE_MARGIN
    best, weakest = people.loc[~places, MEASURES].max(), people.loc[places, MEASURES].min()
    borders = {"fails_up_to": best, "places_from": weakest, "parts_people": best < weakest}
    table = pd.DataFrame(borders).rename_axis("measure").reset_index()
    half = people["dense"].iloc[0] / 2
    found = [_reached(people[measure], people["success"], half) for measure in MEASURES]
    table[["half_at", "half_low", "half_high"]] = found
    return table.assign(n_places=int(places.sum()), n=len(people))


def show_threshold(table: pd.DataFrame) -> pd.DataFrame:
    """Lay `threshold_table` out as strings."""
    rows = list(table.itertuples())
    halves = [show_value("", row.half_at, row.half_low, row.half_high) for row in rows]
    return pd.DataFrame(
        {
            "measure": table["measure"].str.replace("_", " "),
            "places nothing up to": [show_value("", row.fails_up_to) for row in rows],
            "places from": [show_value("", row.places_from) for row in rows],
            "parts people": table["parts_people"].map({True: "yes", False: "no"}),
            "half of dense at": halves,
            "n": [f"{row.n_places} of {row.n} people place the can" for row in rows],
        }
    )


def _reached(measure, success, level):
    """Smallest measure at which monotone success is at a level: estimate, low and high."""
    order = np.argsort(measure.to_numpy(), kind="stable")
    x, y = measure.to_numpy()[order], success.to_numpy()[order]

    def border(i):
        i = np.sort(i)  # of people in their order
        fitted, measured = isotonic_regression(y[i]).x, x[i]
        k = int(np.argmax([*(fitted >= level)[:-1], True]))  # the last, if nobody reaches it
        between = slice(max(k - 1, 0), k + 1)  # linear between two people
        return np.interp(level, fitted[between], measured[between])

    def borders(picks):
        return np.apply_along_axis(border, -1, picks)

    everybody = np.arange(len(x))
    if isotonic_regression(y).x[-1] < level:
        return np.nan, np.nan, np.nan
    return border(everybody), *st.interval(borders, len(x), corrected=False)


def taught(runs: pd.DataFrame, scores: pd.DataFrame, steps: int) -> pd.DataFrame:
    """How well each person of a study is decoded, and what they have taught in so many steps.

    Late, that is in the last third of these steps. Columns subject, auroc and `TAUGHT`.
    """
    late = phase_scores(derive(runs[runs["step"] <= steps]))
    means = late.query("group == 'rlihf'").groupby("subject")[[*TAUGHT]].mean()
    return scores[["subject", "auroc"]].merge(means.reset_index(), on="subject")


def taught_elsewhere(results: Path, profile: str) -> dict[str, tuple[Path, pd.DataFrame]]:
    """The same of the studies of a profile that lie in a folder of results, by name, and its file.

    As notebook 04 wrote it.
    """
    columns = ["subject", "auroc", *TAUGHT]
    return {
        file.parts[-3].removeprefix(f"{profile}-"): (file, read_table(file, columns)[columns])
        for file in sorted(results.glob(f"{profile}-*/tables/subjects.csv"))
    }
