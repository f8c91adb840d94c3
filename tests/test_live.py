"""Feedback decoded live is the feedback of the table."""

import dataclasses
import io

import mne
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.eeg.fitting import DecoderSettings
from rlihf_lib.eeg.loso import load_decoder, recorded_cohort, run_loso
from rlihf_lib.eeg.signals import SubjectEpochs
from rlihf_lib.eeg.streaming import LiveFeedback
from rlihf_lib.live import train_live
from rlihf_lib.rl.feedback import p_error_sha256
from rlihf_lib.rl.runs import RunConfig, SACSettings
from rlihf_lib.rl.training import train_run
from rlihf_lib.study import Study

SETTINGS = DecoderSettings(
    max_epochs=2, patience=2, ensemble=2, n_permutations=10, n_validation=1, batch_size=16
)
CONFIG = RunConfig(
    condition="rlihf", subject="s03", w_hf=0.7, seed=1, total_steps=300, eval_every=150,
    horizon=60, eval_rollouts=1, sac=SACSettings(learning_starts=200, batch_size=64),
)  # fmt: skip


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Three decoded subjects, from a folder of recorded epochs."""
    folder = tmp_path_factory.mktemp("recorded")
    rng = np.random.default_rng(0)
    for subject in ("s02", "s03", "s04"):
        info = mne.create_info(["Fz", "Cz", "Pz"], 128.0, "eeg")
        events = np.column_stack([np.arange(40), np.zeros(40, int), np.arange(40) % 3 // 2 + 1])
        epochs = mne.EpochsArray(
            rng.normal(0, 5e-6, (40, 3, 102)), info, events,
            event_id={"correct": 1, "error": 2}, verbose="error",
        )  # fmt: skip
        epochs.save(folder / f"sub-{subject[1:]}_epo.fif", verbose="error")
    study = Study("smoke", folder, tmp_path_factory.mktemp("out"))
    cohort = recorded_cohort(study.eeg, study.subjects())
    run_loso(cohort, study.decoder, SETTINGS, workers=1)
    return study


def test_live_decoding_gives_the_table_bit_by_bit(study):
    cohort = recorded_cohort(study.eeg, study.subjects())
    for subject, rows in study.p_error().groupby("subject"):
        held_out = SubjectEpochs.from_mne(subject, cohort[subject])
        live = LiveFeedback(load_decoder(study.decoder, subject), held_out)
        assert [live(epoch) for epoch in rows["epoch"]] == rows["p_error"].tolist()


def test_live_run_is_the_run_from_the_table(study):
    table = study.p_error()
    subject = table["subject"].iloc[0]
    # What it decodes cannot come from a table that says nothing.
    silent = table.assign(p_error=0.5)
    config, live = (
        dataclasses.replace(CONFIG, subject=subject, p_error_sha256=p_error_sha256(t, subject))
        for t in (table, silent)
    )
    looked_up, decoded = train_run(config, table), train_live(study, live, silent)
    for file in ("train.csv", "eval.csv", "actor.safetensors"):
        assert decoded[file] == looked_up[file]
    assert pd.read_csv(io.BytesIO(decoded["train.csv"]))["return"].gt(0).any()
