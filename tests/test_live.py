"""Feedback decoded live is the feedback of the table."""

import dataclasses
import io
import sys
import threading
import time
from types import SimpleNamespace

import mne
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.__main__ import main
from rlihf_lib.eeg.fitting import DecoderSettings
from rlihf_lib.eeg.loso import load_decoder, recorded_cohort, run_loso
from rlihf_lib.eeg.signals import SubjectEpochs
from rlihf_lib.eeg.streaming import LiveFeedback
from rlihf_lib.live import FEEDBACK, Person, train_live
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


def streams():
    """The module of streams, and an amplifier's class, where mne-lsl is installed."""
    amplifier = pytest.importorskip("tests.eeg.amplifier")
    return pytest.importorskip("rlihf_lib.eeg.lsl"), amplifier.Amplifier


def test_a_closed_loop_through_lsl_is_the_run_from_the_table(study):
    """Amplifier, decoder and policy talk by LSL alone; the decoder works in a thread of its own."""
    lsl, amplifier_of = streams()
    table = study.p_error()
    subject = table["subject"].iloc[0]
    decoder = load_decoder(study.decoder, subject)
    layout, cohort = decoder.input_format, recorded_cohort(study.eeg, study.subjects())
    held_out = SubjectEpochs.from_mne(subject, cohort[subject])
    epochs = dict(zip(held_out.index, layout.pick(held_out), strict=True))
    amplifier = amplifier_of("cap", layout.channels, layout.sfreq)

    class Played(Person):
        def __call__(self, epoch):
            onset = amplifier.stamp(amplifier.n_sent)
            amplifier.send(epochs[epoch])
            return self.ask(onset)

    person, done = Played("answers", "questions"), threading.Event()
    decoding = lsl.LiveDecoder(decoder, "cap", [FEEDBACK], markers="questions", out="answers")

    def decode():
        while not done.is_set():
            decoding.poll(0.001)

    thread = threading.Thread(target=decode)
    thread.start()
    try:
        silent = table.assign(p_error=0.5)
        config, unheard = (
            dataclasses.replace(CONFIG, subject=subject, p_error_sha256=p_error_sha256(t, subject))
            for t in (table, silent)
        )
        decoded = train_run(unheard, silent, decode=person)
    finally:
        done.set()
        thread.join()
    looked_up = train_run(config, table)
    for file in ("train.csv", "eval.csv", "actor.safetensors"):
        assert decoded[file] == looked_up[file]


def test_a_person_without_an_answer_is_an_error(monkeypatch):
    lsl, _ = streams()
    monkeypatch.setattr("rlihf_lib.live.WAIT", 0.2)
    silent = lsl.StreamOutlet(lsl.StreamInfo("silent", "p(error)", 2, 0, "float64", "silent"))
    with pytest.raises(TimeoutError, match=r"from 'silent' within 0.2 s; is .* live` running"):
        Person("silent", "asked")(0)
    assert silent.name == "silent"


def test_a_moment_is_asked_once(monkeypatch):
    """When an episode ends, feedback is asked a hundred times at once (`rl.rewards`)."""
    streams()
    monkeypatch.setattr("rlihf_lib.live.HOLD", 0.2)
    asked, person = [], Person("silent", "asked")
    person.ask = lambda stamp: asked.append(stamp) or 0.1 * len(asked)
    assert [person(epoch) for epoch in range(100)] == [0.1] * 100
    time.sleep(0.25)
    assert person(0) == 0.2 and len(asked) == 2


def test_a_fault_in_live_decoding_is_a_sentence_unless_one_looks_for_it(monkeypatch, capsys):
    def fault(_):
        raise RuntimeError("the stream is gone")

    monkeypatch.setitem(sys.modules, "rlihf_lib.eeg.lsl", SimpleNamespace(main=fault))
    assert main(["live"]) == 1
    assert capsys.readouterr().err == "rlihf_lib: the stream is gone\n"
    with pytest.raises(RuntimeError):
        main(["live", "--debug"])


def test_without_mne_lsl_the_command_says_what_to_install(monkeypatch, capsys):
    for name in ("mne_lsl", "mne_lsl.lsl"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "rlihf_lib.eeg.lsl", raising=False)
    assert main(["live", "--stream", "cap"]) == 1
    assert "needs mne-lsl; install it with: pip install '.[live]'" in capsys.readouterr().err
