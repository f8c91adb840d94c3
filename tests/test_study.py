"""What a study is made of."""

import subprocess

import pandas as pd
import pytest

from rlihf_lib.__main__ import main
from rlihf_lib.files import write_sums
from rlihf_lib.rl.feedback import p_error_sha256
from rlihf_lib.study import PROFILES, REPOSITORY, STAGES, Study


def write_decoder(study, aurocs):
    study.decoder.mkdir(parents=True, exist_ok=True)
    subjects = [f"s{i + 2:02d}" for i in range(len(aurocs))]
    pd.DataFrame({"subject": subjects, "auroc": aurocs}).to_csv(
        study.decoder / "scores.csv", index=False
    )
    rows = [(who, epoch, epoch % 2, 0.5 + 0.01 * epoch) for who in subjects for epoch in range(8)]
    columns = ["subject", "epoch", "label", "p_error"]
    write_table(study, pd.DataFrame(rows, columns=columns))


def write_table(study, p_error):
    p_error.to_csv(study.decoder / "p_error.csv", index=False)
    write_sums(study.decoder, ["p_error.csv", "scores.csv"])


def of_epochs(folder):
    folder.mkdir()
    (folder / "sub-01_epo.fif").write_bytes(b"")
    return folder


def test_unknown_profiles_and_sources_are_named_with_the_choices(tmp_path):
    with pytest.raises(ValueError, match="'tiny'; choose one of smoke, class, quick, paper"):
        Study("tiny")
    with pytest.raises(ValueError, match="neither simulated nor hri nor a folder"):
        Study("smoke", tmp_path / "nothing")
    with pytest.raises(ValueError, match="rename the folder"):
        Study("smoke", of_epochs(tmp_path / "hri"))


@pytest.mark.parametrize("eeg", ["", " ", "/", "/nowhere", "."])
def test_what_is_no_folder_of_recordings_is_refused_at_once(eeg, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"nor a folder|has no name|no recording that can be used"):
        Study("smoke", eeg)
    with pytest.raises(SystemExit) as left:
        main(["--eeg", eeg, "--list"])
    assert left.value.code == 2 and "error: " in capsys.readouterr().err


def test_channels_can_be_dropped_from_a_folder_only(tmp_path):
    study = Study("smoke", of_epochs(tmp_path / "mine"), drop_channels=["Status", "EOG2"])
    assert study.drop_channels == ("Status", "EOG2") and study.name == "smoke-mine"
    for source in ("simulated", "hri"):
        with pytest.raises(ValueError, match=f"from a folder only, not from {source}"):
            Study("smoke", source, drop_channels=["Cz"])


def test_folders_follow_profile_and_source(tmp_path):
    study = Study("quick", of_epochs(tmp_path / "mydata"), tmp_path)
    assert study.name == "quick-mydata"
    assert study.runs == tmp_path / "results" / "quick-mydata" / "runs"
    assert not study.results.exists(), "nothing is created before it is written to"


def test_policy_subjects_are_the_weakest_the_median_and_the_strongest_decoder(tmp_path):
    pilots = Study("pilots", out=tmp_path)
    write_decoder(pilots, [0.9, 0.7, 0.8, 0.95, 0.6])
    assert pilots.policy_subjects() == ["s04", "s05", "s06"]
    assert len(pilots.run_configs("rlihf")) == 6
    study = Study("quick", out=tmp_path)
    write_decoder(study, [0.9, 0.7, 0.8, 0.95, 0.6])
    assert len(study.run_configs("rlihf")) == 10, "two seeds of everybody, up to eight people"
    ablation = study.run_configs("ablation")
    assert len(ablation) == 6 and {config.subject for config in ablation} == {"s04"}
    main = [config for config in ablation if config.w_hf == 0.7]
    assert set(main) <= set(study.run_configs("rlihf")), "the main weight's runs are shared"


def test_the_paper_profile_is_the_papers_protocol():
    profile = PROFILES["paper"]
    assert (profile.total_steps, profile.horizon, profile.eval_rollouts) == (150_000, 1000, 5)
    assert profile.seeds == tuple(range(5))
    assert profile.weights == (0.1, 0.4, 0.7)


def test_the_papers_study_is_balanced_over_people_and_has_its_controls(tmp_path):
    study = Study("paper", out=tmp_path)
    write_decoder(study, [0.9, 0.7, 0.8, 0.95, 0.6, 0.75])
    runs = {stage: study.run_configs(stage) for stage in STAGES}
    sizes = {stage: len(configs) for stage, configs in runs.items()}
    assert sizes == {
        "sparse": 5, "tuned": 5, "dense": 5, "rlihf": 6 * 5, "controls": 5 + 2 * 3,
        "ablation": 3 * 6 * 2,
    }  # fmt: skip
    assert {c.sac.discount for c in runs["tuned"]} == {0.98}
    assert {c.patience for c in runs["tuned"]} == {1000}
    assert {c.subject for c in runs["controls"]} == {"ideal", "s07-mean", "s07-shuffled"}
    every = {config.run_id for configs in runs.values() for config in configs}
    shared = 6 * 2  # of the main weight
    assert len(every) == sum(sizes.values()) - shared


def test_controls_answer_alike_whatever_is_seen(tmp_path):
    study = Study("smoke", out=tmp_path)
    write_decoder(study, [0.9, 0.7, 0.8])
    table = study.feedback()
    own, mean, shuffled = (table[table["subject"] == f"s04{c}"] for c in ("", "-mean", "-shuffled"))
    assert mean["p_error"].nunique() == 1 and mean["p_error"].iloc[0] == own["p_error"].mean()
    assert sorted(shuffled["p_error"]) == sorted(own["p_error"])
    assert (shuffled["p_error"].to_numpy() != own["p_error"].to_numpy()).any()
    ideal = table[table["subject"] == "ideal"]
    assert (ideal["p_error"] == ideal["label"]).all()
    assert study.feedback().equals(table), "shuffled alike every time"


def test_changed_feedback_changes_the_run(tmp_path):
    study = Study("smoke", out=tmp_path)
    write_decoder(study, [0.9, 0.7, 0.8])
    (before,) = study.run_configs("rlihf")
    table = study.p_error()
    table.loc[table["subject"] == before.subject, "p_error"] = 0.25
    write_table(study, table)
    (after,) = study.run_configs("rlihf")
    assert before.run_id == after.run_id and before.hash != after.hash
    with pytest.raises(ValueError, match=r"subject 's99' is not in the p\(error\) table"):
        p_error_sha256(table, "s99")


def test_a_table_with_an_impossible_probability_is_refused(tmp_path):
    study = Study("smoke", out=tmp_path)
    write_decoder(study, [0.9, 0.7, 0.8])
    table = study.p_error()
    write_table(study, table.replace({"p_error": {0.5: 1.5}}))
    with pytest.raises(ValueError, match=r"p_error.csv, line 2: p_error is 1.5"):
        study.p_error()
    write_table(study, table[["subject", "epoch"]])
    with pytest.raises(ValueError, match="lacks the column"):
        study.p_error()


def test_decoding_that_was_interrupted_or_edited_is_not_believed(tmp_path):
    study = Study("smoke", out=tmp_path)
    write_decoder(study, [0.9, 0.7, 0.8])
    assert study.status()["done"][0] == 3
    for name in ("p_error.csv", "scores.csv"):
        path = study.decoder / name
        whole = path.read_text()
        path.write_text(whole[:-2])
        for read in (study.p_error, study.scores, study.status):
            with pytest.raises(ValueError, match=rf"{name} is not what was written"):
                read()
        path.write_text(whole)
    # Killed between two tables: each is whole, but they may be of different people.
    (study.decoder / "SHA256SUMS").unlink()
    with pytest.raises(FileNotFoundError, match="run notebook 02"):
        study.run_configs("rlihf")
    assert study.status()["missing"][0] == 3


def test_a_reader_leaves_what_is_shipped_as_it_is(tmp_path):
    reader, shipped = Study(ship=False), Study()
    assert reader.runs == shipped.runs and reader.decoder == shipped.decoder
    ignored = [reader.figures / "a.png", reader.tables / "a.csv"]
    done = subprocess.run(["git", "check-ignore", *map(str, ignored)], cwd=REPOSITORY)
    assert done.returncode == 0, "git would show them as changed"
    assert reader.find_table("lda.csv") == shipped.tables / "lda.csv", "until there is another"
    assert Study(out=tmp_path, ship=False).figures == tmp_path / "figures/paper-simulated"
