"""The paper's claims are judged by the tests, and by what this study's size can show."""

from rlihf_lib.report.claims import claims_table
from rlihf_lib.report.evaluations import load_runs
from rlihf_lib.report.people import correlation_table, subject_table


def judged(runs, scores):
    """(What came out, verdict) of each claim."""
    people = subject_table(runs, scores)
    table = claims_table(runs, people, correlation_table(people))
    assert table["claim"].is_unique
    return {row.claim: (row.came_out, row.shown) for row in table.itertuples()}


def test_claims_are_judged_by_their_tests(runs, scores):
    found = judged(runs, scores)
    assert found["Sparse reward fails"] == ("late success 0.04", "")
    better = [found[f"{phase}: RLIHF places more cans than sparse reward"][1]
              for phase in ("Early", "Mid", "Late")]  # fmt: skip
    assert better == ["yes"] * 3
    assert found["Late: RLIHF places about as many as dense reward"][1] == "not shown", (
        "far below to near it"
    )
    assert found["Late: its path efficiency is lower than dense reward's"][1] == "yes"
    assert found["Late: it is nearer to the ideal path than sparse reward"][1] == "yes"
    assert found["Late: better decoders, higher return"][1] == "yes"
    assert "0 of 12" in found["Some people's feedback surpasses dense reward in final return"][0]
    swapped = runs.replace({"group": {"sparse": "dense", "dense": "sparse"}})
    worse = judged(swapped, scores)["Late: RLIHF places more cans than sparse reward"]
    assert worse[0].startswith("difference -0.") and worse[1] == "no", "the other way round"


def test_runs_that_are_equal_are_shown_to_be(runs, scores):
    same = runs.assign(success=runs["success"].where(runs["group"] == "sparse", 0.9))
    found = judged(same, scores)
    assert found["Late: RLIHF places about as many as dense reward"][1] == "yes"
    weaker = found["Weaker decoders support learning, too"][0]
    assert "12 people shown to equal dense reward, with so few seeds nobody can be" in weaker


def test_a_study_of_a_run_each_is_too_small_to_show_anything(study):
    shown = [shown for _, shown in judged(load_runs(study), study.scores()).values()]
    assert shown == [""] * 4 + ["too few runs to test"] * 10
