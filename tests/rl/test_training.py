"""Short real training runs."""

import json

import pandas as pd
import pytest

from rlihf_lib.files import canonical_json, sha256
from rlihf_lib.rl.config import RunConfig, SACSettings
from rlihf_lib.rl.functions import given
from rlihf_lib.rl.observer import p_error_sha256
from rlihf_lib.rl.sweep import is_done, run_sweep
from rlihf_lib.rl.training import train_run

SHORT = {"total_steps": 300, "eval_every": 150, "horizon": 60, "eval_rollouts": 2}
SAC_SHORT = SACSettings(learning_starts=200, batch_size=64)
TABLE = pd.DataFrame(
    {"subject": "s02", "epoch": range(3), "label": [0, 1, 0], "p_error": [0.2, 0.7, 0.3]}
)


def config(**changes):
    digest = p_error_sha256(TABLE, "s02")
    fields = {
        "condition": "rlihf",
        "subject": "s02",
        "w_hf": 0.7,
        "seed": 1,
        "sac": SAC_SHORT,
        "p_error_sha256": digest,
    }
    return RunConfig(**{**SHORT, **fields, **changes})


def test_same_config_gives_identical_files(tmp_path):
    for name in ("first", "second"):
        train_run(config(), tmp_path / name, TABLE)
    for file in ("config.json", "train.csv", "eval.csv", "actor.safetensors"):
        first, second = ((tmp_path / name / file).read_bytes() for name in ("first", "second"))
        assert first == second, file


def test_run_folder_says_what_was_run_and_how_it_went(tmp_path):
    dense = config(condition="dense", subject="", w_hf=0.0, p_error_sha256="")
    train_run(dense, tmp_path)
    recorded = json.loads((tmp_path / "config.json").read_text())
    assert recorded["hash"] == dense.hash and recorded["condition"] == "dense"
    rows = pd.read_csv(tmp_path / "eval.csv")
    columns = "step rollout return success path_efficiency path_deviation collisions min_clearance"
    assert set(columns.split()) <= set(rows.columns)
    assert rows.groupby("step").size().to_dict() == {0: 2, 150: 2, 300: 2}
    assert json.loads((tmp_path / "provenance.json").read_text())["packages"]["mujoco"]


def test_unknown_subject_is_named_with_those_that_are_there(tmp_path):
    with pytest.raises(ValueError, match=r"'s99'.*there: s02"):
        train_run(config(subject="s99"), tmp_path, TABLE)
    assert not list(tmp_path.iterdir())


def test_training_is_summed_up_with_what_the_learner_and_the_observer_say(tmp_path):
    train_run(config(total_steps=2_000, eval_every=2_000), tmp_path, TABLE)
    table = pd.read_csv(tmp_path / "train.csv")
    assert table["step"].tolist() == [1_000, 2_000]
    assert (table["episodes"] > 0).all() and table["judged_wrong"].between(0, 1).all()
    assert table[["critic_loss", "ent_coef", "mean_q"]].notna().all(axis=None)


def test_an_edited_table_is_refused_under_the_old_name(tmp_path):
    edited = TABLE.assign(p_error=[0.2, 0.8, 0.3])
    with pytest.raises(ValueError, match="rows of s02 are not those"):
        train_run(config(), tmp_path, edited)
    with pytest.raises(ValueError, match="rows of s02 are not those"):
        run_sweep([config()], tmp_path, edited)
    assert not list(tmp_path.iterdir())


def test_every_setting_changes_the_hash():
    base = config()
    others = [
        config(seed=2), config(w_hf=0.4), config(sac=SACSettings()), config(protocol=0),
        config(observer="lay"), config(patience=10), config(reward=clear_reward),
    ]  # fmt: skip
    assert len({base.hash, *(c.hash for c in others)}) == 8
    assert len({base.run_id, *(c.run_id for c in others if c.protocol)}) == 7


def test_a_setting_at_its_default_leaves_the_hash_alone():
    plain = {"protocol": 6, "condition": "dense", "seed": 0, "total_steps": 10, "eval_every": 5}
    assert RunConfig("dense", 0, 10, 5).hash == sha256(canonical_json(plain))


WORTH = 2.0


def clear_reward(moment):
    return WORTH * moment.clearance


def test_a_function_is_known_by_its_source_and_by_the_values_it_refers_to(monkeypatch):
    first = given(clear_reward)
    assert first.name == "clear_reward" and given(clear_reward) == first
    monkeypatch.setitem(globals(), "WORTH", 3.0)
    assert given(clear_reward) != first
    monkeypatch.setitem(globals(), "WORTH", [3.0])
    with pytest.raises(ValueError, match="clear_reward refers to WORTH, a list"):
        given(clear_reward)


OWN = """
LIMIT = 2.0

def shy(moment):
    return float(moment.clearance < LIMIT)

def one(moment):
    return 1.0
"""


def test_functions_from_outside_reach_the_workers_and_the_run_folder(tmp_path, monkeypatch):
    (tmp_path / "own.py").write_text(OWN)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    import own

    configs = [
        config(observer=own.shy),
        config(condition="dense", subject="", w_hf=0, p_error_sha256="", reward=own.one),
    ]
    runs = tmp_path / "runs"
    assert run_sweep(configs, runs, TABLE, workers=1, progress=lambda _: None) == 2
    for run in configs:
        recorded = json.loads((runs / run.run_id / "config.json").read_text())
        assert recorded["hash"] == run.hash and is_done(run, runs)
    seen, paid = (pd.read_csv(runs / run.run_id / "train.csv") for run in configs)
    assert (seen["judged_wrong"] == 1).all()  # every clearance is below 2 m
    assert (paid["return"] >= 0.5 * paid["steps"]).all()
    assert configs[0].run_id.startswith("rlihf-w0.7-s02-shy.")


def test_an_unknown_observer_is_named_with_the_choices():
    with pytest.raises(ValueError, match="observer is 'mine'; choose one of path, lay"):
        config(observer="mine")
