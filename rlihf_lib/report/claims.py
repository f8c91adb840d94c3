"""What the paper claims of its policies, beside what came out: one row a claim."""

import pandas as pd

from rlihf_lib.report import paper
from rlihf_lib.report.evaluations import phase_scores
from rlihf_lib.report.tables import compare, family

ALPHA = 0.05


def claims_table(
    runs: pd.DataFrame, people: pd.DataFrame, correlations: pd.DataFrame
) -> pd.DataFrame:
    """Set the paper's claims (section IV, captions) beside our numbers and what they show.

    From the runs of the main comparison, `people.subject_table`, `people.correlation_table`.
    Columns claim, came_out and shown: "yes" or "no" where a test says so, corrected for all tests
    of the table (Holm), or why this study can't tell; "" where nothing is tested.
    """
    rows = [*_tested(runs), _correlated(correlations)]
    tests = family(rows)
    shown = [_verdict(row.p_holm, row.smallest_p_holm, row.claimed) for row in tests.itertuples()]
    told = tests[["claim", "came_out"]].assign(shown=shown)
    return pd.concat([pd.DataFrame(_seen(runs, people)), told], ignore_index=True).fillna("")


def _tested(runs):
    by_phase = {
        phase: dict(list(phase_scores(runs, phase).groupby("group"))) for phase in paper.PHASES
    }
    claims = [
        (f"{phase}: RLIHF places more cans than sparse reward", phase, "sparse", "success", 1)
        for phase in paper.PHASES
    ]
    claims += [
        (f"{phase}: comparable to dense reward", phase, "dense", "success", 0)
        for phase in paper.PHASES[1:]
    ]
    claims += [
        ("Late: path efficiency lower than dense reward's", "Late", "dense", "path_efficiency", -1),
        ("Late: nearer to the ideal path than sparse reward", "Late", "sparse", "path_deviation",
         -1),
    ]  # fmt: skip
    for claim, phase, other, metric, sign in claims:
        found = compare(by_phase[phase]["rlihf"], by_phase[phase][other], metric, not sign)
        spread = ""
        if pd.notna(found["ci_low"]):
            spread = f" [{found['ci_low']:.2f}, {found['ci_high']:.2f}]"
        kind = "" if sign else "_equivalent"
        yield {
            "claim": claim, "p": found[f"p{kind}"], "smallest_p": found[f"smallest_p{kind}"],
            "came_out": f"difference {found['difference']:.2f}{spread}, {found['n']}",
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
        "came_out": f"late success by person {low:.2f} to {high:.2f}; {(equal & ~behind).sum()} "
        f"shown equal to dense reward, {behind.sum()} shown to differ, the others neither",
    }


def _verdict(p, smallest, as_claimed):
    if smallest >= ALPHA:
        return "too few runs to test"
    if p >= ALPHA:
        return "not shown"
    return "yes" if as_claimed else "no"
