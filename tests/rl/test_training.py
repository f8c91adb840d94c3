"""Short real training runs."""

import json

import pandas as pd
import pytest

from rlihf_lib.rl.config import RunConfig, SACSettings
from rlihf_lib.rl.training import train_run

SHORT = {"total_steps": 300, "eval_every": 150, "horizon": 60, "eval_rollouts": 2}
SAC_SHORT = SACSettings(learning_starts=200, batch_size=64)
TABLE = pd.DataFrame(
    {"subject": "s02", "epoch": range(3), "label": [0, 1, 0], "p_error": [0.2, 0.7, 0.3]}
)


def config(**changes):
    fields = {"condition": "rlihf", "subject": "s02", "w_hf": 0.7, "seed": 1, "sac": SAC_SHORT}
    return RunConfig(**{**SHORT, **fields, **changes})


def test_same_config_gives_identical_files(tmp_path):
    for name in ("first", "second"):
        train_run(config(), tmp_path / name, TABLE)
    for file in ("config.json", "train.csv", "eval.csv", "actor.safetensors"):
        first, second = ((tmp_path / name / file).read_bytes() for name in ("first", "second"))
        assert first == second, file


def test_run_folder_says_what_was_run_and_how_it_went(tmp_path):
    dense = config(condition="dense", subject="", w_hf=0.0)
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


def test_every_setting_changes_the_hash():
    base = config()
    others = [config(seed=2), config(w_hf=0.4), config(sac=SACSettings()), config(protocol=0)]
    assert len({base.hash, *(c.hash for c in others)}) == 5
