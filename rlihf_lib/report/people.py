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
    "passes it between these two"
)
MEASURES = ["auroc", "balanced_accuracy", "accuracy_online"]  # of decoders
TAUGHT = ("success", "completed")
REACHED = ("success", "return", "success_early", "success_mid", "clearance")


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

    A row for each of `REACHED`, with Holm's p over all of them; clearance is of those who place
    the can.
    """
    reached = {metric: people.dropna(subset=metric) for metric in REACHED}
    return family(
        {"metric": metric, **st.spearman(kept["auroc"], kept[metric])}
        for metric, kept in reached.items()
        if len(kept)
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
    did; n_places, n. Where the first is larger, the measure does not part people. And half_after
    and half_by, the two people between whom half of dense reward's success is reached by isotonic
    regression over people; empty where nobody reaches it, half_after also where everybody does.
    """
    places = people["success"] >= st.EQUIVALENCE_MARGIN
    best, weakest = people.loc[~places, MEASURES].max(), people.loc[places, MEASURES].min()
    table = pd.DataFrame({"fails_up_to": best, "places_from": weakest})
    table["parts_people"] = (best < weakest).where(best.notna() & weakest.notna())
    table = table.rename_axis("measure").reset_index()
    half = people["dense"].iloc[0] / 2
    found = [_around(people[measure], people["success"], half) for measure in MEASURES]
    table[["half_after", "half_by"]] = found
    return table.assign(n_places=int(places.sum()), n=len(people))


def show_threshold(table: pd.DataFrame) -> pd.DataFrame:
    """Lay `threshold_table` out as strings."""
    rows = list(table.itertuples())
    halves = [[show_value("", x) for x in (row.half_after, row.half_by)] for row in rows]
    return pd.DataFrame(
        {
            "measure": table["measure"].str.replace("_", " "),
            "places nothing up to": [show_value("", row.fails_up_to) for row in rows],
            "places from": [show_value("", row.places_from) for row in rows],
            "parts people": table["parts_people"].map({True: "yes", False: "no"}),
            "half of dense between": [" and ".join(filter(None, ends)) for ends in halves],
            "n": [f"{row.n_places} of {row.n} people place the can" for row in rows],
        }
    )


def _around(measure, success, level):
    """Of people by measure, the last before and the first at which success is at a level."""
    order = np.argsort(measure.to_numpy(), kind="stable")
    reached = isotonic_regression(success.to_numpy()[order]).x >= level
    if not reached.any():
        return np.nan, np.nan
    ends = [np.nan, *measure.to_numpy()[order]]
    return tuple(ends[k] for k in (reached.argmax(), reached.argmax() + 1))


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
