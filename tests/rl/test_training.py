"""Short real training runs."""

import io
import json

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.rl.asking import Asking
from rlihf_lib.rl.feedback import p_error_sha256
from rlihf_lib.rl.runs import RunConfig, SACSettings, is_done, write_run
from rlihf_lib.rl.sac import make_sac
from rlihf_lib.rl.sweep import run_sweep
from rlihf_lib.rl.timing import Timing
from rlihf_lib.rl.training import processor, train_run, training_reward

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


def test_same_config_gives_identical_files():
    first, second = (train_run(config(), TABLE) for _ in range(2))
    assert set(first) == {
        "config.json", "provenance.json", "train.csv", "eval.csv", "actor.safetensors"
    }  # fmt: skip
    for file in set(first) - {"provenance.json"}:
        assert first[file] == second[file], file


def test_run_folder_says_what_was_run_and_how_it_went(tmp_path):
    dense = config(condition="dense", subject="", w_hf=0.0, p_error_sha256="")
    folder = write_run(dense, tmp_path, train_run(dense))
    recorded = json.loads((folder / "config.json").read_text())
    assert recorded["hash"] == dense.hash and recorded["condition"] == "dense"
    rows = pd.read_csv(folder / "eval.csv")
    columns = "step rollout return success path_efficiency path_deviation collisions min_clearance"
    assert set(columns.split()) <= set(rows.columns)
    assert rows.groupby("step").size().to_dict() == {0: 2, 150: 2, 300: 2}
    provenance = json.loads((folder / "provenance.json").read_text())
    assert provenance["packages"]["mujoco"] and provenance["kernels"]
    assert provenance["machine"].endswith(f" cores, {processor()}") and processor()


@pytest.mark.parametrize(
    ("steps", "changes"),
    [
        (300, {"timing": Timing(10, 8, credit="window")}),
        (1_100, {"asking": Asking(300, model=True)}),
        (1_100, {"schedule": "fading"}),
    ],
)
def test_what_is_known_later_of_a_step_is_what_the_learner_remembers(monkeypatch, steps, changes):
    made, paid = [], []

    def wrapped(*told):
        env = training_reward(*told)
        step = env.step

        def recorded(action):
            result = step(action)
            paid.append(result[1])
            for ago, change in zip(*result[-1].get("late", ((), ())), strict=True):
                paid[-1 - ago] += change
            return result

        env.step = recorded
        return env

    def kept(*told):
        made.append(make_sac(*told))
        return made[0]

    monkeypatch.setattr("rlihf_lib.rl.training.training_reward", wrapped)
    monkeypatch.setattr("rlihf_lib.rl.training.make_sac", kept)
    sac = SACSettings(learning_starts=steps - 50, batch_size=64)
    train_run(config(total_steps=steps, eval_every=steps, sac=sac, **changes), TABLE)
    (memory,) = (model.replay_buffer for model in made)
    np.testing.assert_allclose(memory.rewards[:steps, 0], paid, atol=1e-5)


def test_a_run_that_diverges_is_named_with_its_settings(tmp_path):
    hot = config(sac=SACSettings(learning_starts=200, batch_size=64, learning_rate=1e30))
    message = r"learning_rate1e\+30-.*seed1 has diverged: .* after \d+ steps, with SACSettings"
    with pytest.raises(FloatingPointError, match=message):
        train_run(hot, TABLE)


def test_unknown_subject_is_named_with_those_that_are_there():
    with pytest.raises(ValueError, match=r"'s99'.*there: s02"):
        train_run(config(subject="s99"), TABLE)


def test_training_is_summed_up_with_what_the_learner_and_the_observer_say():
    files = train_run(config(total_steps=2_000, eval_every=2_000), TABLE)
    table = pd.read_csv(io.BytesIO(files["train.csv"]))
    assert table["step"].tolist() == [1_000, 2_000]
    assert (table["episodes"] > 0).all() and table["judged_wrong"].between(0, 1).all()
    assert table[["critic_loss", "ent_coef", "mean_q"]].notna().all(axis=None)


def test_an_edited_table_is_refused_under_the_old_name(tmp_path):
    edited = TABLE.assign(p_error=[0.2, 0.8, 0.3])
    with pytest.raises(ValueError, match="rows of s02 are not those"):
        train_run(config(), edited)
    with pytest.raises(ValueError, match="rows of s02 are not those"):
        run_sweep([config()], tmp_path, edited)
    assert not list(tmp_path.iterdir())


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
    assert run_sweep(configs, runs, TABLE, workers=1) == 2
    for run in configs:
        recorded = json.loads((runs / run.run_id / "config.json").read_text())
        assert recorded["hash"] == run.hash and is_done(run, runs)
    seen, paid = (pd.read_csv(runs / run.run_id / "train.csv") for run in configs)
    assert (seen["judged_wrong"] == 1).all()  # every clearance is below 2 m
    assert (paid["return"] >= 0.5 * paid["steps"]).all()
    assert configs[0].run_id.startswith("rlihf-w0.7-s02-shy.")
