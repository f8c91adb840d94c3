"""What the cases of an experiment have reached, in numbers (notebook 06).

Three runs against three can't get a permutation test below p = .1, so none is made. Beforehand it
was settled what counts as seen: that cases are *apart*, no run of one reaching any of the other,
as one pair of equal cases in ten will be by luck.
"""

import json
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from rlihf_lib.report.figures_late import CONTROL_STEP
from rlihf_lib.report.tables import DIGITS
from rlihf_lib.rl.evaluation import Recording

UNITS = {"clearance": " (m)", "speed": " (m/s)"}
CASES = (
    "late phase; mean over runs [lowest, highest run]; arrows: above or below all runs of the case "
    "it is compared with, where all of both have a value"
)


def case_table(
    late: pd.DataFrame, metrics: Iterable[str], against: Mapping[str, str], told: Iterable[str] = ()
) -> pd.DataFrame:
    """Summarise `beyond.Beyond.late`, a row per case and metric, and what is told beside.

    Columns case, against (the case it is compared with: by the mapping, else the first), metric,
    n_runs, n (those that have a value), mean, low and high (of the runs), apart: "up" or "down" if
    all runs are above or below all of the other case's, else empty, also where a run has no value
    and for what is told: columns that are no outcome.
    """
    rows = []
    for metric in (*told, *metrics):
        runs = {case: own[metric] for case, own in late.groupby("case", observed=True)}
        for case, scores in runs.items():
            beside = against.get(case, next(iter(runs)))
            other, apart = runs[beside], ""
            if metric not in told and scores.notna().all() and other.notna().all():
                apart = "up" if scores.min() > other.max() else apart
                apart = "down" if scores.max() < other.min() else apart
            row = {"case": case, "against": "" if beside == case else beside, "metric": metric}
            row |= {"n_runs": len(scores), "n": scores.count(), "mean": scores.mean()}
            rows.append(row | {"low": scores.min(), "high": scores.max(), "apart": apart})
    return pd.DataFrame(rows)


def show_cases(table: pd.DataFrame) -> pd.DataFrame:
    """Lay `case_table` out as strings, a row per case."""
    arrows, digits = {"up": " ↑", "down": " ↓", "": ""}, {"answers": 0, **DIGITS}

    def words(row):
        if not row.n:
            return "–"
        d, few = digits.get(row.metric, 2), f" (n = {row.n})" if row.n < row.n_runs else ""
        return f"{row.mean:.{d}f} [{row.low:.{d}f}, {row.high:.{d}f}]{arrows[row.apart]}{few}"

    shown = table.assign(words=[words(row) for row in table.itertuples()])
    beside = shown.drop_duplicates("case").set_index("case")["against"]
    shown = shown.pivot(index="case", columns="metric", values="words")
    shown = shown.loc[table["case"].unique(), table["metric"].unique()]
    shown.columns = [f"{name}{UNITS.get(name, '')}" for name in shown]
    shown.insert(0, "compared with", beside)
    return shown.rename_axis(columns=None).reset_index()


def from_provenance(late: pd.DataFrame, runs_dir, name: str, last: float = 1.0) -> pd.Series:
    """What the `provenance.json` of each run says of a name; NaN if nothing.

    Of a list the mean over the last share of it.
    """
    paths = (runs_dir / run / "provenance.json" for run in late["run"])
    told = [json.loads(path.read_text(encoding="utf-8")).get(name, np.nan) for path in paths]
    lists = [np.atleast_1d(value) for value in told]
    means = [float(np.mean(values[-round(last * len(values)) :])) for values in lists]
    return pd.Series(means, late.index)


def motion(recordings: Sequence[Recording]) -> dict[str, float]:
    """How the hand moves in rollouts that place the can: means of speed, m/s, and smoothness.

    Smoothness is the negative logarithm of dimensionless jerk (Hogan & Sternad 2009, J. Motor
    Behavior 41:529): higher is smoother. NaN if no rollout places the can.
    """
    speeds, smooth = [], []
    for rollout in recordings:
        if not rollout.success:
            continue
        velocity = np.diff(rollout.hand, axis=0) / CONTROL_STEP
        speed, time = np.linalg.norm(velocity, axis=1), CONTROL_STEP * len(velocity)
        jerk = np.diff(velocity, n=2, axis=0) / CONTROL_STEP**2
        cost = (jerk**2).sum() * CONTROL_STEP * time**3 / speed.max() ** 2
        speeds.append(speed.mean())
        smooth.append(-np.log(cost))
    return {name: float(np.mean(v)) if v else np.nan for name, v in
            (("speed", speeds), ("smoothness", smooth))}  # fmt: skip
