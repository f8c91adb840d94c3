"""Experiments beyond the paper: one thing is varied, all else stays the study's."""

import dataclasses
import shutil

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.beyond import Beyond, count, planned
from rlihf_lib.eeg.scores import auroc, calibration_error
from rlihf_lib.eeg.tiring import PARTS, aurocs_by_part
from rlihf_lib.experiments import EXPERIMENTS, N_CASES, PRIOR, against, contrast
from rlihf_lib.profiles import PROFILES
from rlihf_lib.rl.asking import Asking
from rlihf_lib.rl.observer import path_observer
from rlihf_lib.rl.timing import Timing
from rlihf_lib.study import Study
from tests.rl.conftest import moment


@pytest.fixture(scope="module")
def beyond():
    return Beyond(Study())


def test_a_session_that_was_edited_is_not_believed(beyond, tmp_path):
    study = Study(out=tmp_path)
    shutil.copytree(beyond.study.decoder, study.decoder)
    shutil.copytree(beyond.runs.parent, study.results / "beyond", ignore=lambda *_: ["runs"])
    pd.testing.assert_frame_equal(Beyond(study).session, beyond.session)
    (path,) = (study.results / "beyond").glob("session-*/p_error.csv")
    path.write_text(path.read_text().replace("0.", "0.1", 1))
    with pytest.raises(ValueError, match=r"p_error.csv is not what was written"):
        _ = Beyond(study).session


def test_experiments_are_of_sixty_thousand_steps_and_three_seeds(beyond):
    for name in EXPERIMENTS:
        for case, runs in beyond.cases(name).items():
            assert [config.seed for config in runs] == [0, 1, 2], case
            assert {config.total_steps for config in runs} == {60_000}
    assert beyond.runs == beyond.study.results / "beyond" / "runs"


def test_cases_are_as_many_as_are_counted_before_there_are_decoders(beyond, tmp_path):
    assert {name: len(beyond.cases(name)) for name in EXPERIMENTS} == N_CASES
    smoke = Study("smoke", out=tmp_path)
    assert count(smoke) == (0, N_CASES["observers"])
    assert smoke.status().iloc[-1].tolist()[:3] == ["06_beyond_the_paper", 0, 5]


def test_nobody_tires_who_is_not_simulated(tmp_path, monkeypatch):
    smoke = dataclasses.replace(PROFILES["smoke"], experiments=("tiring",))
    monkeypatch.setitem(PROFILES, "smoke", smoke)
    assert planned(Study("smoke")) == ("tiring",)
    (tmp_path / "lab.csv").touch()
    assert planned(Study("smoke", tmp_path / "lab.csv", tmp_path)) == ()


def test_runs_of_an_experiment_differ_in_what_it_varies(beyond):
    same = {
        "lateness": ["timing"], "ladder": ["subject"], "observers": ["observer"],
        "tiring": ["subject", "schedule"],
    }  # fmt: skip
    for name, varied in same.items():
        runs = beyond.run_configs(name)
        for entry in dataclasses.fields(runs[0]):
            if entry.name not in ("seed", *varied, "p_error_sha256"):
                assert len({str(getattr(config, entry.name)) for config in runs}) == 1, entry.name
    every = {config for name in EXPERIMENTS for config in beyond.run_configs(name)}
    assert len({config.run_id for config in every}) == len(every), "no two share a folder"
    assert {c.timing for c in beyond.cases("lateness")["every 1, 0 late"]} == {Timing()}


def test_spoilt_calibration_leaves_the_auroc_as_it_was(beyond):
    tables = dict(list(beyond.p_error.groupby("subject")))
    aurocs, errors = {}, {}
    for case, (config, *_) in beyond.cases("bias").items():
        if callable(config.observer):
            continue  # whose errors depend on what the robot does
        rows = tables[config.subject]
        aurocs[case] = round(float(auroc(rows["p_error"], rows["label"])), 6)
        weights = np.where(rows["label"] == 1, PRIOR, 1 - PRIOR)  # as many errors as expected
        drawn = rows.sample(20_000, replace=True, weights=weights, random_state=0)
        errors[case] = calibration_error(drawn["p_error"], drawn["label"])
    assert len(set(aurocs.values())) == 1
    assert errors.pop("calibrated") < 0.02 < min(errors.values())


def test_forms_of_feedback_tell_right_from_wrong_by_as_much(beyond):
    contrasts = []
    for case, (config, *_) in beyond.cases("forms").items():
        if case.endswith(("half", "twice")):
            continue
        form = config.feedback if callable(config.feedback) else lambda p: 1 - p
        own = beyond.p_error[beyond.p_error["subject"] == config.subject]
        assert config.subject == beyond.person or case == "calibrated"
        rows = own.reset_index()
        worth = config.w_hf * form(rows["p_error"].to_numpy())
        contrasts.append(worth[rows["label"] == 0].mean() - worth[rows["label"] == 1].mean())
    assert contrasts == pytest.approx([contrasts[0]] * len(contrasts), rel=0.01)


def test_a_matched_weight_makes_up_for_a_timid_decoder(beyond):
    tables, cases = dict(list(beyond.p_error.groupby("subject"))), beyond.cases("bias")
    told = {name: runs[0].w_hf * contrast(tables[runs[0].subject]) for name, runs in cases.items()}
    assert told["timid"] < 0.6 * told["calibrated"]
    assert told["timid, matched"] == pytest.approx(told["calibrated"], rel=0.01)


def test_a_person_s_calibrated_answers_are_right_as_often_as_they_say(beyond):
    tables = dict(list(beyond.p_error.groupby("subject")))
    own, calibrated = tables[beyond.person], tables[f"{beyond.person}_calibrated"]
    errors = [calibration_error(t["p_error"], t["label"]) for t in (own, calibrated)]
    assert errors[1] < 0.05 < errors[0]
    assert calibrated["p_error"].mean() == pytest.approx(own["label"].mean(), abs=1e-4)
    assert (np.diff(calibrated["p_error"].to_numpy()[np.argsort(own["p_error"])]) >= 0).all()


def test_cases_are_compared_with_cases_of_their_experiment(beyond):
    for name in EXPERIMENTS:
        cases = beyond.cases(name)
        others = against(beyond, name)
        assert {*others} | {*others.values()} <= {*cases}, name
        assert not [case for case, other in others.items() if case == other]


def test_the_budget_of_a_person_is_that_of_their_epochs(beyond):
    asking = {case: runs[0].asking for case, runs in beyond.cases("labels").items()}
    assert asking["every step"] == Asking()
    assert {a.when for case, a in asking.items() if "unsure" in case} == {"unsure"}
    assert [case for case, a in asking.items() if a.once and not a.budget] == [
        "each epoch once, model", "each epoch once, unsure",
    ]  # fmt: skip


def test_who_tires_is_decoded_ever_worse_and_else_parts_are_alike(beyond):
    aurocs = aurocs_by_part(beyond.session).T
    rested, tired, updated = (
        aurocs[f"{beyond.person}_{s}"] for s in ("rested", "tired", "updated")
    )
    assert np.ptp(rested) == 0 and tired.iloc[0] == rested.iloc[0]
    assert (np.diff(tired) < 0).sum() >= PARTS - 2 and tired.iloc[-1] < tired.iloc[0] - 0.05
    assert updated.iloc[-1] > tired.iloc[-1], "an update learns what has become late"
    cases = beyond.cases("tiring")
    assert {config.session for runs in cases.values() for config in runs} == {PARTS}
    assert cases["tired, by spread"][0].schedule == "spread"
    spread = beyond.session.query("subject == @beyond.person + '_tired'")["p_error"]
    n = len(spread) // PARTS
    assert spread[-n:].std() < 0.9 * spread[:n].std(), "so that the weight falls"


def test_observers_disagree_about_the_same_step(beyond):
    at_full_speed = moment(remaining=0.5, best=0.53, clearance=0.06, moved=0.03)
    slowly = moment(remaining=0.5, best=0.508, clearance=0.06, moved=0.01)
    watchers = {name: runs[0].observer for name, runs in beyond.cases("observers").items()}
    assert watchers["hates_speed"](at_full_speed) == 1 > watchers["hates_speed"](slowly)
    near = moment(remaining=0.5, best=0.53, clearance=0.02)
    assert watchers["planner"](near) == 0 < watchers["wary"](near) == 1
    farther = moment(remaining=0.5, best=0.53, clearance=0.05)
    assert path_observer(farther) == 0 < watchers["wary"](farther)


def test_a_decoder_may_be_startled_by_speed(beyond):
    jumpy = beyond.cases("bias")["jumpy"][0].observer
    wrong = dict(remaining=0.5, best=0.5, clearance=0.06)
    right = dict(remaining=0.5, best=0.53, clearance=0.06)
    assert jumpy(moment(**right, moved=0.01)) == 0
    assert jumpy(moment(**right, moved=0.03)) == 0.5 and jumpy(moment(**wrong, moved=0.03)) == 1
