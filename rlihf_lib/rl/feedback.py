"""The p(error) table: all that policies know of anybody's EEG. Its rows, its hash, its controls.

Columns subject, epoch, label (1 = error) and p_error, in [0, 1], of decoded held-out epochs. A
control is a subject of its own: "ideal", whose p(error) is the label; "<person>-mean", every
p(error) replaced by the person's mean; "<person>-shuffled", p(error) permuted over the epochs, so
that both classes answer alike.
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.special import expit, logit, ndtri

from rlihf_lib.eeg.scores import accuracy, auroc, balanced_accuracy
from rlihf_lib.files import sha256, write_csv, write_sums

COLUMNS = ("subject", "epoch", "label", "p_error")
NOT_DECODED = "run notebook 02_loso_decoder first (--only 02)"
IDEAL, MEAN, SHUFFLED = CONTROLS = ("ideal", "mean", "shuffled")


def person_and_control(subject: str) -> tuple[str, str]:
    """Split "s02-mean" into ("s02", "mean"), "ideal" into ("", "ideal"), "s02" into ("s02", "")."""
    person, _, control = subject.rpartition("-")
    return (person, control) if control in CONTROLS else (subject, "")


def controls_of(person: str) -> tuple[str, str]:
    """Return the subjects whose feedback is the person's with what it says taken out."""
    return f"{person}-{MEAN}", f"{person}-{SHUFFLED}"


def with_controls(p_error: pd.DataFrame, person: str) -> pd.DataFrame:
    """Add the ideal decoder's rows to those of decoded people, and one person's controls."""
    rows = rows_of(p_error, person)
    shuffled = np.random.default_rng(0).permutation(rows["p_error"])
    silent = zip(controls_of(person), (rows["p_error"].mean(), shuffled), strict=True)
    tables = [rows.assign(subject=subject, p_error=p) for subject, p in silent]
    ideal = perfect_table().assign(subject=IDEAL)
    return pd.concat([p_error, ideal, *tables], ignore_index=True)


def perfect_table() -> pd.DataFrame:
    """Return the p(error) table of an ideal decoder, p = label."""
    return pd.DataFrame({"epoch": [0, 1], "label": [0, 1], "p_error": [0.0, 1.0]})


def synthetic_table(d_prime: float, prior: float, n: int = 200) -> pd.DataFrame:
    """Return the p(error) table of a decoder whose classes lie `d_prime` standard deviations apart.

    What it decodes is normal in both classes, `n` epochs each at equal quantiles; p(error) is what
    Bayes makes of it and of the `prior` share of errors. Its AUROC is Phi(d' / sqrt(2)).
    """
    label = np.repeat([0, 1], n)
    evidence = np.tile(ndtri((np.arange(n) + 0.5) / n), 2) + d_prime * (label - 0.5)
    p_error = expit(d_prime * evidence + logit(prior))
    return pd.DataFrame({"epoch": np.arange(2 * n), "label": label, "p_error": p_error})


def answers_table(hits, misses, correct_rejections, false_alarms) -> pd.DataFrame:
    """Return the p(error) table of a decoder that says yes or no, from how often it did which."""
    counts = hits, misses, correct_rejections, false_alarms
    label, said = (np.repeat(values, counts) for values in ([1, 1, 0, 0], [1.0, 0.0, 0.0, 1.0]))
    return pd.DataFrame({"epoch": np.arange(len(label)), "label": label, "p_error": said})


def read_table(path: Path, columns=COLUMNS) -> pd.DataFrame:
    """Read a table of p(error), or of the scores of decoders, that has at least some columns.

    A FileNotFoundError says if notebook 02 has not written it yet; a ValueError names a column that
    is missing or there twice, or the line with a probability not in [0, 1], a label other than 0
    and 1, an epoch that is no number or that a subject has twice, or a subject without epochs of
    both classes.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist yet; {NOT_DECODED}")
    try:
        # Shortest-representation floats come back bit by bit only from the round-trip parser.
        table = pd.read_csv(
            path, dtype={"subject": str}, float_precision="round_trip", keep_default_na=False,
            na_values={"p_error": ["", "nan", "NaN"]},
        )  # fmt: skip
    except ValueError as error:
        raise ValueError(f"{path} is not a table of comma-separated values ({error})") from error
    if not isinstance(table.index, pd.RangeIndex):
        raise ValueError(f"{path} has lines with more values than there are columns")
    if missing := [column for column in columns if column not in table.columns]:
        raise ValueError(
            f"{path} lacks the column(s) {', '.join(missing)} (it has: {', '.join(table)}); write "
            "it anew, with commas between the columns"
        )
    if twice := [column for column in columns if f"{column}.1" in table]:
        raise ValueError(f"{path} has the column(s) {', '.join(twice)} twice; leave one of them")
    if table.empty:
        raise ValueError(f"{path} has no rows; write it anew")
    if "p_error" not in columns:
        return table
    p_error, epoch, label = (
        pd.to_numeric(table[name], errors="coerce") for name in ("p_error", "epoch", "label")
    )
    faults = {
        "p_error is {p_error}, not in [0, 1]": ~p_error.between(0, 1),
        "label is {label}, neither 0 (correct) nor 1 (error)": ~label.isin([0, 1]),
        "epoch is {epoch!r}, not a whole number": ~(epoch.between(0, 2**53) & (epoch % 1 == 0)),
        "epoch {epoch} of {subject} is there twice": table.duplicated(["subject", "epoch"]),
    }
    for says, faulty in faults.items():
        if faulty.any():
            row = int(np.argmax(faulty))
            says = says.format(**table.loc[row])
            raise ValueError(f"{path}, line {row + 2}: {says}; write the table anew")
    for subject, labels in table.groupby("subject")["label"]:
        if labels.nunique() < 2:
            raise ValueError(
                f"{path}: subject {subject!r} needs epochs of both classes, labels 0 and 1"
            )
    return table


def adopt_table(path: Path, folder: Path) -> None:
    """Take over somebody else's table of p(error): p_error.csv and scores.csv of a study.

    Errors as in `read_table`; a ValueError says, too, if a subject can't be part of a file's name.
    """
    table = read_table(path)[list(COLUMNS)]
    known: dict[str, str] = {}
    ours = folder / "p_error.csv"
    if ours.is_file() and (folder / "scores.csv").is_file() and read_table(ours).equals(table):
        return
    rows = []
    for subject, part in table.groupby("subject", sort=False):
        if not re.fullmatch(r"[A-Za-z0-9_]{1,40}", subject) or subject in CONTROLS:
            raise ValueError(
                f"{path}: subject {subject!r} can't name a run; use up to 40 letters, digits and "
                f"_, and none of {', '.join(CONTROLS)}"
            )
        if (other := known.setdefault(subject.lower(), subject)) != subject:
            raise ValueError(
                f"{path}: runs of {other} and {subject} could not be told apart on every computer; "
                "rename one"
            )
        p, label = part["p_error"].to_numpy(float), part["label"].to_numpy()
        scores = {
            "accuracy_online": accuracy(p, label),
            "balanced_accuracy": balanced_accuracy(p, label, 0.5),
            "auroc": float(auroc(p, label)),
            "n_epochs": len(part),
            "n_errors": int(label.sum()),
        }
        rows.append({"subject": subject, **scores})
    write_csv(folder / "scores.csv", pd.DataFrame(rows))
    write_csv(ours, table)
    write_sums(folder, ["p_error.csv", "scores.csv"])


def rows_of(p_error: pd.DataFrame | None, subject: str) -> pd.DataFrame:
    """Pick a subject's rows, all that a run may see of the table; a ValueError without any."""
    known = [] if p_error is None else sorted(set(p_error["subject"]))
    if p_error is None or subject not in known:
        raise ValueError(
            f"subject {subject!r} is not in the p(error) table (there: "
            f"{', '.join(known) or 'none'}); decode it first with notebook 02"
        )
    return p_error[p_error["subject"] == subject].reset_index(drop=True)


def p_error_sha256(p_error: pd.DataFrame | None, subject: str) -> str:
    """Hash the rows a run draws its feedback from: epoch, label and p_error of one subject."""
    rows = rows_of(p_error, subject)[["epoch", "label", "p_error"]]
    return sha256(rows.to_csv(index=False, lineterminator="\n"))


def check_feedback(configs, p_error: pd.DataFrame | None) -> None:
    """Raise a ValueError unless the table holds the very rows that the `RunConfig`s name."""
    named = {(config.subject, config.p_error_sha256) for config in configs if config.subject}
    for subject, digest in sorted(named):
        if p_error_sha256(p_error, subject) != digest:
            raise ValueError(
                f"the p(error) rows of {subject} are not those that the config names by hash; "
                "make the configs from the table that is used (`Study.run_configs`), "
                "or write the table anew with notebook 02"
            )
