"""What determines a run, and its folder."""

import json
import subprocess

import pandas as pd
import pytest

from rlihf_lib.files import canonical_json, sha256
from rlihf_lib.rl.runs import RunConfig, SACSettings, is_done, read_run, write_run


def config(**changes):
    feedback = {"condition": "rlihf", "subject": "s02", "w_hf": 0.7, "p_error_sha256": "abc"}
    return RunConfig(**{"seed": 1, "total_steps": 300, "eval_every": 150, **feedback, **changes})


def clear_reward(moment):
    return moment.clearance


def test_every_setting_changes_the_hash():
    base = config()
    others = [
        config(seed=2), config(w_hf=0.4), config(sac=SACSettings(tau=0.02)), config(protocol=0),
        config(observer="lay"), config(patience=10), config(reward=clear_reward),
    ]  # fmt: skip
    assert len({base.hash, *(c.hash for c in others)}) == 8
    assert len({base.run_id, *(c.run_id for c in others if c.protocol)}) == 7


def test_a_setting_at_its_default_leaves_the_hash_alone():
    plain = {"protocol": 6, "condition": "dense", "seed": 0, "total_steps": 10, "eval_every": 5}
    assert RunConfig("dense", 0, 10, 5).hash == sha256(canonical_json(plain))


def test_an_unknown_observer_is_named_with_the_choices():
    with pytest.raises(ValueError, match="observer is 'mine'; choose one of path, lay"):
        config(observer="mine")


def test_the_id_names_what_differs_from_the_default():
    tried = SACSettings(hidden=(64, 32), discount=0.98)
    changed = config(observer=clear_reward, patience=1000, sac=tried)
    word = f"clear_reward.{changed.observer.sha256[:6]}"
    assert changed.run_id == f"rlihf-w0.7-s02-{word}-patience1000-hidden64x32-discount0.98-seed1"
    assert config(observer="lay").run_id == "rlihf-w0.7-s02-lay-seed1"


def files(run, rows):
    recorded = json.dumps({"hash": run.hash}).encode()
    return {"config.json": recorded, "eval.csv": f"return,success\n{rows}\n".encode()}


def test_a_run_written_is_done_and_is_read_bit_by_bit(tmp_path):
    run = config()
    assert not is_done(run, tmp_path)
    with pytest.raises(FileNotFoundError, match="seed1 is missing or made from another config"):
        read_run(run, tmp_path)
    write_run(run, tmp_path, files(run, "0.1,1"))
    folder = write_run(run, tmp_path, files(run, "0.30000000000000004,1"))
    assert folder == tmp_path / run.run_id and is_done(run, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [run.run_id], "nothing is left over"
    expected = pd.DataFrame({"return": [0.1 + 0.2], "success": [1]})
    pd.testing.assert_frame_equal(read_run(run, tmp_path), expected, check_exact=True)
    longer = config(total_steps=600)
    assert longer.run_id == run.run_id and not is_done(longer, tmp_path)


def test_a_broken_table_is_named_with_its_line_or_column(tmp_path):
    run = config()
    write_run(run, tmp_path, files(run, "1,1\n,0"))
    with pytest.raises(ValueError, match=r"eval.csv, line 3: return or success is empty"):
        read_run(run, tmp_path)
    with pytest.raises(ValueError, match=r"lacks the column\(s\) step"):
        read_run(run, tmp_path, columns=("step", "return"))


WHOLE = ("config.json", "provenance.json", "train.csv", "eval.csv", "actor.safetensors")


@pytest.mark.parametrize("name", WHOLE)
def test_a_file_that_was_changed_is_named_and_nothing_of_the_run_is_read(name, tmp_path):
    run = config()
    folder = write_run(run, tmp_path, dict.fromkeys(WHOLE, b"1") | files(run, "1,1"))
    (folder / name).write_bytes((folder / name).read_bytes().replace(b"1", b"7"))
    for read in (is_done, read_run):
        with pytest.raises(ValueError, match=rf"{name} is not what was written .* restore it"):
            read(run, tmp_path)


@pytest.mark.parametrize("cut", [1, -1])
@pytest.mark.parametrize("name", WHOLE)
def test_a_file_that_was_cut_is_named(name, cut, tmp_path):
    run = config()
    folder = write_run(run, tmp_path, dict.fromkeys(WHOLE, b"12") | files(run, "1,1\n2,0"))
    (folder / name).write_bytes((folder / name).read_bytes()[:cut])
    with pytest.raises(ValueError, match=rf"{name} is not what was written"):
        is_done(run, tmp_path)


def test_a_run_that_cannot_be_written_is_named_with_a_remedy(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"cannot write .*w0.7-s02-seed1 .*another folder: --out"):
        write_run(config(), tmp_path / "file", files(config(), "1,1"))


def test_another_runs_evaluations_are_not_taken_for_this_ones(tmp_path):
    first, second = config(), config(seed=2)
    for run, rows in ((first, "1,1"), (second, "2,1")):
        write_run(run, tmp_path, files(run, rows))
    (tmp_path / first.run_id / "eval.csv").replace(tmp_path / second.run_id / "eval.csv")
    with pytest.raises(ValueError, match=r"seed2/eval.csv is not what was written"):
        is_done(second, tmp_path)
    with pytest.raises(ValueError, match=r"seed1/eval.csv is gone"):
        is_done(first, tmp_path)


def test_actors_need_not_be_shipped_and_sums_are_those_of_sha256sum(tmp_path):
    run = config()
    folder = write_run(run, tmp_path, {**files(run, "1,1"), "actor.safetensors": b"weights"})
    checked = subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=folder)
    assert checked.returncode == 0
    (folder / "actor.safetensors").unlink()
    assert is_done(run, tmp_path)
    (folder / "SHA256SUMS").unlink()
    assert not is_done(run, tmp_path), "who wrote it is unknown"
