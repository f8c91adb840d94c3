"""Runs as they are read, named and counted."""

import json

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.files import write_sums
from rlihf_lib.report.evaluations import (
    derive,
    described,
    group_of,
    load_runs,
    load_training,
    phase_scores,
    size,
    units,
)
from rlihf_lib.report.style import label
from rlihf_lib.rl.feedback import person_and_control
from rlihf_lib.rl.runs import RunConfig, SACSettings


def test_phases_are_thirds_of_training_and_clearance_is_of_those_who_place_the_can():
    rows = {"step": [0, 1, 50_000, 50_001, 100_000, 100_001, 150_000], "min_clearance": 0.03}
    runs = derive(pd.DataFrame({**rows, "success": [0, 0, 0, 0, 1, 0, 1]}))
    phases = runs["phase"].astype(str).tolist()
    assert phases == ["Early", "Early", "Early", "Mid", "Mid", "Late", "Late"]
    assert runs["clearance"].notna().tolist() == [False] * 4 + [True, False, True]


@pytest.mark.parametrize(
    ("condition", "subject", "other", "group", "shown"),
    [
        ("sparse", "", {}, "sparse", "RL sparse"),
        ("dense", "", {}, "dense", "RL dense"),
        ("rlihf", "s02", {"w_hf": 0.4}, "rlihf", "RLIHF"),
        ("rlihf", "ideal", {"w_hf": 0.7}, "rlihf-ideal", "RLIHF, ideal p"),
        ("rlihf", "s02-mean", {"w_hf": 0.7}, "rlihf-mean", "RLIHF, constant p"),
        ("rlihf", "s02-shuffled", {"w_hf": 0.7}, "rlihf-shuffled", "RLIHF, shuffled p"),
        ("rlihf", "s02", {"w_hf": 0.7, "observer": "lay"}, "rlihf-lay", "RLIHF, lay observer"),
        (
            "sparse", "", {"patience": 1000, "sac": SACSettings(discount=0.99)},
            "sparse-patience1000-discount0.99", "RL sparse, tuned (discount .99)",
        ),
        ("dense", "", {"patience": 50}, "dense-patience50", "dense-patience50"),
    ],
)  # fmt: skip
def test_a_run_is_compared_as_what_its_config_says(condition, subject, other, group, shown):
    config = RunConfig(condition, 3, 3000, 1000, subject=subject, **other)
    assert group_of(config) == group
    assert label(group) == shown


def test_a_phase_is_averaged_without_the_one_before(runs):
    own = runs.query("run == 'dense-seed1'").set_index("step")["success"]
    for phase, steps in (("Early", [0, 1000]), ("Mid", [2000]), ("Late", [3000])):
        found = phase_scores(runs, phase).set_index("run").loc["dense-seed1", "success"]
        assert found == pytest.approx(own[steps].mean())


def test_whose_feedback_a_run_drew_on():
    subjects = ("s02", "s02-mean", "s02-shuffled", "ideal", "", "sub-01")
    assert [person_and_control(s)[0] for s in subjects] == ["s02", "s02", "s02", "", "", "sub-01"]


def test_units_are_people_or_else_seeds(runs):
    late = phase_scores(runs)
    assert units(late.query("group == 'rlihf'"), "success").shape == (12, 5)
    assert units(late.query("subject == 's05'"), "success").shape == (5, 1)
    assert units(late.query("group == 'dense'"), "success").shape == (5, 1)
    assert size(late.query("group == 'rlihf'")) == "12 people x 5 seeds"
    assert size(late.query("subject == 's05' and seed == 0")) == "1 seed"
    unequal = late.query("subject in ('s05', 's06')").iloc[:-1]
    assert np.isnan(units(unequal, "success")).sum() == 1
    words = "RL sparse 5 seeds, RL dense 5 seeds, RLIHF 12 people x 5 seeds; w_hf = 0.7; bands"
    assert described(runs).startswith(words)
    assert "w_hf" not in described(runs.query("condition == 'dense'")), "nobody's feedback"


def test_a_missing_or_foreign_run_is_named(study):
    (config,) = study.run_configs("dense")
    folder = study.runs / config.run_id
    (folder / "config.json").write_text(json.dumps({"hash": "another"}))
    write_sums(folder, ["config.json", "eval.csv"])
    with pytest.raises(FileNotFoundError, match=r"dense-seed0 is missing .* another config"):
        load_runs(study)


def test_a_run_with_an_empty_number_is_named_with_its_line(study):
    path = study.runs / "sparse-seed0" / "eval.csv"
    frame = pd.read_csv(path)
    frame.loc[3, "return"] = np.nan
    frame.to_csv(path, index=False)
    write_sums(path.parent, ["config.json", "eval.csv"])
    with pytest.raises(ValueError, match=r"sparse-seed0/eval.csv, line 5"):
        load_runs(study)


def test_a_run_that_was_edited_is_never_drawn(study):
    path = study.runs / "sparse-seed0" / "eval.csv"
    path.write_text(path.read_text().replace("10.0", "100.0", 1))
    with pytest.raises(ValueError, match=r"sparse-seed0/eval.csv is not what was written"):
        load_runs(study)


def test_windows_of_training_in_which_no_episode_ended_are_empty_not_broken(study):
    path = study.runs / "dense-seed0" / "train.csv"
    windows = pd.DataFrame({"step": [1000, 2000, 3000], "episodes": [0, 1, 2]})
    windows.assign(**{"return": [np.nan, 3, 4], "success": [np.nan, 0, 1]}).to_csv(path)
    write_sums(path.parent, ["config.json", "eval.csv", "train.csv"])
    training = load_training(study, ["dense"])
    assert training["return"].tolist()[1:] == [3, 4] and training["group"].unique() == ["dense"]
    windows.assign(**{"return": [1, np.nan, 4], "success": 0}).to_csv(path)
    write_sums(path.parent, ["config.json", "eval.csv", "train.csv"])
    with pytest.raises(ValueError, match=r"dense-seed0/train.csv, line 3"):
        load_training(study, ["dense"])
