"""Decoder and policy of each person side by side."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.report import people
from rlihf_lib.report.evaluations import phase_scores


def test_every_person_is_compared_with_dense_reward(runs, scores):
    table = people.subject_table(runs, scores)
    assert table["subject"].tolist() == scores["subject"].tolist()
    first = table.iloc[0]
    late = phase_scores(runs)
    own = late.query("subject == 's02'")["success"].mean()
    dense = late.query("group == 'dense'")["success"].mean()
    assert first["difference"] == pytest.approx(own - dense)
    assert first["p"] == first["smallest_p"] == 2 / 252
    assert set(table["smallest_p_holm"]) == {12 * 2 / 252}, "cannot reach .05 after correction"
    assert set(table["smallest_p_equivalent"]) == {1 / 252}
    correlation = people.correlation_table(table).set_index("metric")
    assert correlation.loc["success", "rho"] > 0.9 and correlation.loc["success", "p"] < 0.001
    early = phase_scores(runs, "Early").query("subject == 's02'")["success"].mean()
    assert table["success_early"][0] == pytest.approx(early)
    assert "clearance" not in correlation.index, "no robot of these runs is known to have kept any"
    kept = people.correlation_table(table.assign(clearance=[np.nan, *range(11)])).iloc[-1]
    assert kept["metric"] == "clearance" and (kept["n"], kept["rho"]) == (11, 1)
    assert len(correlation) == 4 and (correlation["p_holm"] >= correlation["p"]).all()


def test_measures_that_do_not_part_people_say_so(runs, scores):
    without = runs.assign(success=runs["success"].where(~runs["subject"].isin(["s02", "s03"]), 0))
    mixed = scores.assign(accuracy_online=scores["accuracy_online"].to_numpy()[::-1])
    table = people.threshold_table(people.subject_table(without, mixed)).set_index("measure")
    assert table.loc["auroc", ["fails_up_to", "places_from"]].tolist() == list(scores["auroc"][1:3])
    assert table.loc["auroc", "parts_people"] and not table.loc["accuracy_online", "parts_people"]
    assert set(table["n_places"]) == {10} and set(table["n"]) == {12}


def test_half_of_dense_is_reached_between_the_people_around_it(runs, scores):
    level = 0.9 * (scores["auroc"] > 0.8)  # a step between two people
    whole = runs.assign(success=runs["success"].where(runs["group"] != "rlihf"))
    own = whole["subject"].map(dict(zip(scores["subject"], level, strict=True)))
    table = people.threshold_table(people.subject_table(whole.fillna({"success": own}), scores))
    row = table.set_index("measure").loc["auroc"]
    around = [scores["auroc"][scores["auroc"] <= 0.8].max(), scores["auroc"][level > 0].min()]
    assert row[["half_after", "half_by"]].tolist() == around
    shown = people.show_threshold(table)["half of dense between"][0]
    assert shown == f"{around[0]:.2f} and {around[1]:.2f}"
    for each, known in ((0.0, []), (0.9, [scores["auroc"].min()])):
        alike = whole.fillna({"success": each})
        row = people.threshold_table(people.subject_table(alike, scores)).iloc[0]
        assert row[["half_after", "half_by"]].dropna().tolist() == known
        assert pd.isna(row["parts_people"]), "all of them fail, or none"


def test_what_people_have_taught_is_counted_in_the_last_third_of_so_many_steps(runs, scores):
    two_thirds = people.taught(runs, scores, 2_000)
    assert two_thirds["subject"].tolist() == scores["subject"].tolist()
    own = runs.query("subject == 's05' and step == 2000")["success"].mean()
    assert two_thirds.set_index("subject").loc["s05", "success"] == pytest.approx(own)
    whole = people.taught(runs, scores, 3_000)
    table = people.subject_table(runs, scores)
    assert whole["success"].tolist() == pytest.approx(table["success"].tolist())


def test_people_of_other_studies_are_read_from_their_tables(runs, scores, tmp_path):
    assert people.taught_elsewhere(tmp_path, "quick") == {}
    for study in ("quick-lab", "paper-other"):
        file = tmp_path / study / "tables/subjects.csv"
        file.parent.mkdir(parents=True)
        people.subject_table(runs, scores).assign(subject="07").to_csv(file, index=False)
    found = people.taught_elsewhere(tmp_path, "quick")
    ((name, (file, table)),) = found.items()
    assert name == "lab" and file == tmp_path / "quick-lab/tables/subjects.csv"
    assert list(table) == ["subject", "auroc", "success", "completed"] and set(
        table["subject"]
    ) == {"07"}
