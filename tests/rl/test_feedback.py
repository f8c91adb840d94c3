"""The table of p(error), also somebody else's: what is read, refused, adopted."""

import numpy as np
import pandas as pd
import pytest
from sklearn.metrics import balanced_accuracy_score, roc_auc_score

from rlihf_lib.rl.feedback import (
    adopt_table,
    answers_table,
    controls_of,
    read_table,
    synthetic_table,
    with_controls,
)
from rlihf_lib.study import Study

HEADER = "subject,epoch,label,p_error,remark\n"


def theirs(folder, n=40):
    """A table of two people, with a column that nobody asked for."""
    rng = np.random.default_rng(0)
    label = np.arange(n) % 3 == 0
    parts = [
        pd.DataFrame({"subject": who, "epoch": np.arange(n), "label": label.astype(int),
                      "p_error": np.clip(rng.normal(0.3 + gain * label, 0.2), 0, 1), "remark": ""})
        for who, gain in (("NA", 0.1), ("007", 0.4))
    ]  # fmt: skip
    table = pd.concat(parts, ignore_index=True)
    table.to_csv(folder / "lab.csv", index=False)
    return table


def test_somebody_elses_table_becomes_a_study_with_its_name_in_every_label(tmp_path):
    table = theirs(tmp_path)
    study = Study("quick", tmp_path / "lab.csv", tmp_path)
    assert study.name == "quick-lab" and study.eeg_label == "p(error) of lab"
    read = study.p_error()
    pd.testing.assert_frame_equal(read, table[["subject", "epoch", "label", "p_error"]])
    scores = study.scores().set_index("subject")
    for who, rows in table.groupby("subject"):
        assert scores.loc[who, "auroc"] == roc_auc_score(rows["label"], rows["p_error"])
        balanced = balanced_accuracy_score(rows["label"], rows["p_error"] > 0.5)
        assert scores.loc[who, "balanced_accuracy"] == pytest.approx(balanced)
    assert study.ranked_subjects() == ["NA", "007"]
    assert {c.subject for c in study.run_configs("rlihf")} == {"NA", "007"}


def test_a_table_that_changes_changes_the_runs(tmp_path):
    table = theirs(tmp_path)
    study = Study("quick", tmp_path / "lab.csv", tmp_path)
    before = {config.hash for config in study.run_configs("rlihf")}
    assert before == {config.hash for config in study.run_configs("rlihf")}
    table.assign(p_error=1 - table["p_error"]).to_csv(tmp_path / "lab.csv", index=False)
    assert before.isdisjoint(config.hash for config in study.run_configs("rlihf"))
    assert study.scores()["auroc"].max() < 0.5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER + "a,0,0,0.5,\na,1,1,1.5,\n", "line 3: p_error is 1.5, not in"),
        (HEADER + "a,0,0,-0.5,\na,1,1,1,\n", "line 2: p_error is -0.5, not in"),
        (HEADER + "a,0,0,inf,\na,1,1,1,\n", "line 2: p_error is inf, not in"),
        (HEADER + "a,0,0,,\na,1,1,1,\n", "line 2: p_error is nan, not in"),
        (HEADER + "a,0,0,high,\na,1,1,1,\n", "line 2: p_error is high, not in"),
        (HEADER + "a,0,0,50%,\na,1,1,90%,\n", "line 2: p_error is 50%, not in"),
        (HEADER + "a,0,0,0.5,\na,1,1", "line 3: p_error is nan"),
        (HEADER + "a,0,no,0.5,\na,1,1,1,\n", "line 2: label is no, neither 0"),
        (HEADER + "a,0,0,0.5,\na,1,-1,1,\n", "line 3: label is -1, neither 0"),
        (HEADER + "a,0,,0.5,\na,1,1,1,\n", "line 2: label is , neither 0"),
        (HEADER + "a,0,0,0.5,\na,1,,1,\n", "line 3: label is , neither 0"),
        (HEADER + "a,0.5,0,0.5,\na,1,1,1,\n", "line 2: epoch is 0.5, not a whole number"),
        (HEADER + "a,-1,0,0.5,\na,1,1,1,\n", "line 2: epoch is -1, not a whole number"),
        (HEADER + "a,,0,0.5,\na,1,1,1,\n", "line 2: epoch is '', not a whole number"),
        (HEADER + "a,0,0,0.5,\na,0,1,1,\n", "line 3: epoch 0 of a is there twice"),
        (HEADER + "a,0,0,0.5,\na,1,0,1,\n", "subject 'a' needs epochs of both classes"),
        (HEADER + "a/b,0,0,0.5,\na/b,1,1,1,\n", "subject 'a/b' can't name a run"),
        (HEADER + ",0,0,0.5,\n,1,1,1,\n", "subject '' can't name a run"),
        (HEADER + f"{'a' * 41},0,0,0,\n{'a' * 41},1,1,1,\n", "use up to 40 letters"),
        (HEADER + "ideal,0,0,0.5,\nideal,1,1,1,\n", "subject 'ideal' can't name a run"),
        (HEADER + "a,0,0,0,\na,1,1,1,\nA,0,0,0,\nA,1,1,1,\n", "a and A could not be told apart"),
        (HEADER.replace(",", ";") + "a;0;0;0.5;\n", r"it has: subject;epoch;label;p_error"),
        ("a,0,0,0.5,\na,1,1,1,\n", r"lacks the column\(s\) subject, epoch, label, p_error"),
        ("subject,epoch\na,0\n", r"lacks the column\(s\) label, p_error \(it has: subject, epoch"),
        (HEADER.replace("remark", "p_error") + "a,0,0,0,1\n", r"the column\(s\) p_error twice"),
        (HEADER, "has no rows"),
        ("", "not a table of comma-separated values"),
        (HEADER + "a,0,0,0.5,,,,\n" * 2, "lab.csv"),
    ],
)
def test_what_no_decoder_can_have_said_is_refused_by_line(text, message, tmp_path):
    (tmp_path / "lab.csv").write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        adopt_table(tmp_path / "lab.csv", tmp_path / "ours")
    assert "lab.csv" in str(error.value)
    assert not (tmp_path / "ours").exists()


def test_answers_counted_elsewhere_become_a_table():
    table = answers_table(hits=3, misses=2, correct_rejections=4, false_alarms=1)
    counts = table.groupby(["label", "p_error"]).size()
    assert counts.to_dict() == {(0, 0.0): 4, (0, 1.0): 1, (1, 0.0): 2, (1, 1.0): 3}
    assert table["epoch"].is_unique


def test_a_table_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"there is no file .*none\.csv"):
        Study("quick", tmp_path / "none.csv")
    with pytest.raises(FileNotFoundError, match="run notebook 02"):
        read_table(tmp_path / "none.csv")
    theirs(tmp_path)
    (tmp_path / "lab.csv").rename(tmp_path / "hri.csv")
    with pytest.raises(ValueError, match="rename the file"):
        Study("quick", tmp_path / "hri.csv")


def test_feedback_that_says_nothing_says_what_answers_are_on_average():
    table = pd.DataFrame({"subject": "a", "epoch": range(4), "label": [0, 0, 0, 1]})
    table["p_error"] = [0.0, 0.1, 0.2, 0.9]
    told = with_controls(table, "a").groupby("subject")["p_error"]
    constant, shuffled = controls_of("a")
    assert told.get_group(constant).tolist() == pytest.approx([0.3] * 4), "the mean, not the median"
    assert sorted(told.get_group(shuffled)) == table["p_error"].tolist()


@pytest.mark.parametrize("prior", [0.2, 0.5])
def test_a_synthetic_decoder_means_what_it_says_given_its_prior(prior):
    table = synthetic_table(1.5, prior)
    weight = np.where(table["label"] == 1, prior, 1 - prior) / table.groupby("label")[
        "epoch"
    ].transform("size")
    assert np.average(table["p_error"], weights=weight) == pytest.approx(prior, abs=0.01)
    assert roc_auc_score(table["label"], table["p_error"]) == pytest.approx(0.856, abs=0.01)
