"""What the paper claims of its policies, beside what came out: one row a claim."""

import pandas as pd

from rlihf_lib.report import paper
from rlihf_lib.report.evaluations import phase_scores
from rlihf_lib.report.tables import EQUIVALENT, compare, family, show_p, show_value

ALPHA = 0.05
SAYS = (
    "means over people and seeds [95 % bootstrap interval]; p: after Holm's correction for all "
    f"tests of this table, in brackets the smallest that could come out at this n; {EQUIVALENT}"
)
#: The paper's words, the phase, what RLIHF is compared with, the metric; the difference's sign that
#: is claimed, 0 where the two are called comparable. Section IV, and Fig. 1.
CLAIMS = (
    *((f"{phase}: RLIHF places more cans than sparse reward", phase, "sparse", "success", 1)
      for phase in paper.PHASES),
    *((f"{phase}: RLIHF places about as many as dense reward", phase, "dense", "success", 0)
      for phase in paper.PHASES),
    ("Late: its path efficiency is lower than dense reward's", "Late", "dense",
     "path_efficiency", -1),
    ("Late: it is nearer to the ideal path than sparse reward", "Late", "sparse",
     "path_deviation", -1),
    ("It keeps safer clearances (Fig. 1; late, here beside dense reward, m)", "Late", "dense",
     "clearance", 1),
)  # fmt: skip


def claims_table(
    runs: pd.DataFrame, people: pd.DataFrame, correlations: pd.DataFrame
) -> pd.DataFrame:
    """Set the paper's claims (section IV, captions) beside our numbers and what they show.

    From the runs of the main comparison, `people.subject_table`, `people.correlation_table`.
    Columns claim, came_out, p and shown: "yes" or "no" where a test says so, corrected for all
    tests of the table (Holm), or why this study can't tell; p and shown are "" where nothing is
    tested.
    """
    rows = [*_tested(runs), _correlated(correlations)]
    tests = family(rows)
    ends = [(row.p_holm, row.smallest_p_holm) for row in tests.itertuples()]
    shown = [_verdict(*end, claimed) for end, claimed in zip(ends, tests["claimed"], strict=True)]
    told = tests[["claim", "came_out"]].assign(p=[show_p(*end) for end in ends], shown=shown)
    return pd.concat([pd.DataFrame(_seen(runs, people)), told], ignore_index=True).fillna("")


def _tested(runs):
    by_phase = {
        phase: dict(list(phase_scores(runs, phase).groupby("group"))) for phase in paper.PHASES
    }
    for claim, phase, other, metric, sign in CLAIMS:
        found = compare(by_phase[phase]["rlihf"], by_phase[phase][other], metric, not sign)
        words = show_value(metric, *(found[k] for k in ("difference", "ci_low", "ci_high")))
        kind = "" if sign else "_equivalent"
        yield {
            "claim": claim,
            "p": found.get(f"p{kind}"), "smallest_p": found.get(f"smallest_p{kind}"),
            "came_out": f"difference {words}, {found['n']}" if words else "no can is placed",
            "claimed": sign * found["difference"] >= 0,
        }  # fmt: skip


def _correlated(correlations):
    found = correlations.set_index("metric").loc["return"]
    return {
        "claim": "Late: better decoders, higher return", "p": found["p"],
        "smallest_p": found["smallest_p"], "claimed": found["rho"] > 0,
        "came_out": f"Spearman's rho {found['rho']:.2f}, {found['n']:.0f} people",
    }  # fmt: skip


def _seen(runs, people):
    """Claims that are looked at and not tested."""
    late = phase_scores(runs).groupby("group")[["success", "return"]].mean()
    above = people["return"] > late.loc["dense", "return"]
    low, high = people["success"].min(), people["success"].max()
    equal, behind = (people[f"{p}_holm"] < ALPHA for p in ("p_equivalent", "p"))
    differing = f"{behind.sum()} to differ"
    if people["smallest_p_holm"].min() >= ALPHA:
        differing = "with so few seeds nobody can be shown to differ"
    right = people["accuracy_online"]
    yield {
        "claim": "Decoders are right in 70 to 90 %",
        "came_out": f"{right.min():.0%} to {right.max():.0%} by person",
    }
    yield {
        "claim": "Sparse reward fails",
        "came_out": f"late success {late.loc['sparse', 'success']:.2f}",
    }
    yield {
        "claim": "Some people's feedback surpasses dense reward in final return",
        "came_out": f"{above.sum()} of {len(people)} people's late mean does",
    }
    yield {
        "claim": "Weaker decoders support learning, too",
        "came_out": f"late success by person {low:.2f} to {high:.2f}; "
        f"{(equal & ~behind).sum()} people shown to equal dense reward, {differing}",
    }


def _verdict(p, smallest, as_claimed):
    if pd.isna(p) or smallest >= ALPHA:
        return "too few runs to test"
    if p >= ALPHA:
        return "not shown"
    return "yes" if as_claimed else "no"
