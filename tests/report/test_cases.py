"""What cases of experiments reach: which are apart, and how a hand moves."""

import json

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report.cases import case_table, from_provenance, motion, show_cases
from rlihf_lib.rl.evaluation import Recording


def test_cases_are_apart_where_no_run_of_one_reaches_any_of_the_other():
    scores = {"first": [0.4, 0.6], "above": [0.7, 0.8], "below": [0.1, 0.3], "among": [0.2, 0.5]}
    late = pd.DataFrame([(c, v) for c, pair in scores.items() for v in pair],
                        columns=["case", "success"])  # fmt: skip
    late["case"] = pd.Categorical(late["case"], list(scores))
    late = late.assign(clearance=np.nan, speed=[0.1, 0.1, 0.2, np.nan] + 4 * [0.3])
    late["weight"] = late["success"]
    metrics = "success", "clearance", "speed"
    table = case_table(late, metrics, {"among": "above"}, told=("weight",))
    assert set(table.query("metric == 'weight'")["apart"]) == {""}, "which is no outcome"
    success = table.query("metric == 'success'").set_index("case")
    assert success["apart"].to_dict() == {
        "first": "", "above": "up", "below": "down", "among": "down",
    }  # fmt: skip
    assert success["mean"].tolist() == pytest.approx([0.5, 0.75, 0.2, 0.35])
    shown = show_cases(table)
    assert shown["success"].tolist() == [
        "0.50 [0.40, 0.60]", "0.75 [0.70, 0.80] ↑", "0.20 [0.10, 0.30] ↓", "0.35 [0.20, 0.50] ↓",
    ]  # fmt: skip
    assert shown["compared with"].tolist() == ["", "first", "first", "above"]
    assert shown["speed (m/s)"][1] == "0.20 [0.20, 0.20] (n = 1)", "no arrow where one has no value"
    assert set(shown["clearance (m)"]) == {"–"}, "nobody places the can"


def test_answers_and_weights_are_those_that_the_runs_tell_of(tmp_path):
    for run, told in (("one", {"watched": 480}), ("two", {"watched": 60, "shares": [1, 0.5]})):
        (tmp_path / run).mkdir()
        (tmp_path / run / "provenance.json").write_text(json.dumps(told))
    late = pd.DataFrame({"run": ["one", "two"]}, [7, 8])
    assert from_provenance(late, tmp_path, "watched").to_dict() == {7: 480, 8: 60}
    shares = from_provenance(late, tmp_path, "shares")
    assert np.isnan(shares[7]) and shares[8] == 0.75
    assert from_provenance(late, tmp_path, "shares", last=0.5)[8] == 0.5


def test_a_hand_that_trembles_is_less_smooth_however_far_it_goes():
    share = np.linspace(0, 1, 501)
    along = 5 * (10 * share**3 - 15 * share**4 + 6 * share**5)  # minimum jerk, 5 m in 50 s
    shaken = along + 0.002 * (-1) ** np.arange(501)

    def moved(x, success=True):
        hand = np.c_[x, 0 * x, 0 * x]
        return motion([Recording(hand, hand, hand, 0, success)])

    assert moved(along)["speed"] == pytest.approx(0.1)
    assert moved(along)["smoothness"] == pytest.approx(-np.log(720 / 1.875**2), abs=0.05)
    assert moved(shaken)["smoothness"] < moved(along)["smoothness"] - 3
    assert moved(along / 2)["smoothness"] == pytest.approx(moved(along)["smoothness"])
    assert np.isnan(list(moved(along, success=False).values())).all()
