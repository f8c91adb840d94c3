"""What decides: each person's decoder beside the policy that it taught."""

from pathlib import Path

import pandas as pd

from rlihf_lib.report import paper
from rlihf_lib.report import statistics as st
from rlihf_lib.report.evaluations import derive, phase_scores
from rlihf_lib.report.style import label
from rlihf_lib.report.tables import compare, family
from rlihf_lib.rl.feedback import read_table

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


def threshold_table(people: pd.DataFrame) -> pd.DataFrame:
    """How good a decoder has to be for the robot to place the can at all, over `subject_table`.

    It does not where late success is below `statistics.EQUIVALENCE_MARGIN`. A row per measure of
    the decoder: fails_up_to, the best one that taught no success; places_from, the weakest that
    did; n_places, n. Where the first is larger, the measure does not part people.
    """
    places = people["success"] >= st.EQUIVALENCE_MARGIN
    best, weakest = people.loc[~places, MEASURES].max(), people.loc[places, MEASURES].min()
    borders = {"fails_up_to": best, "places_from": weakest, "parts_people": best < weakest}
    table = pd.DataFrame(borders).rename_axis("measure").reset_index()
    return table.assign(n_places=int(places.sum()), n=len(people))


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
