"""EEG of one's own, from the command line to p(error): event names, a leak and its remedy."""

import mne
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.__main__ import main
from tests.eeg import writers


def with_label(epochs):
    """Add a channel that carries the label."""
    signal = 1e-5 * epochs.metadata["label"].to_numpy()[:, None, None]
    signal = np.repeat(signal, len(epochs.times), axis=2)
    info = mne.create_info(["P10"], epochs.info["sfreq"], "eeg")
    extra = mne.EpochsArray(signal, info, epochs.events, epochs.tmin, epochs.event_id)
    return epochs.add_channels([extra], force_update_info=True)


@pytest.mark.filterwarnings("ignore")
def test_a_folder_of_ones_own_is_decoded_by_the_command(make_epochs, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "mine"
    folder.mkdir()
    for number, sessions in ((3, "ab"), (7, "a"), (9, "a")):
        for session in sessions:
            epochs = with_label(make_epochs(10 * number + ord(session), amplitude=6e-6))
            epochs.event_id = {"good": 1, "bad": 2}
            if number == 7:
                epochs.reorder_channels(epochs.ch_names[::-1])
            epochs.save(folder / f"sub-{number:02d}_ses-{session}_epo.fif", verbose="error")
    command = ["--profile", "smoke", "--eeg", str(folder), "--out", str(tmp_path / "out")]
    command += ["--events", "good", "bad", "--workers", "1", "--only", "01"]
    assert main(command) == 1
    assert "channel P10 (AUROC 1.000) alone tells" in capfd.readouterr().err
    assert main([*command, "02", "--drop-channels", "P10"]) == 0, capfd.readouterr().err
    decoder = tmp_path / "out" / "results" / "smoke-mine" / "decoder"
    table = pd.read_csv(decoder / "p_error.csv", dtype={"subject": str})
    assert table.groupby("subject").size().to_dict() == {"03": 120, "07": 60, "09": 60}
    assert pd.read_csv(decoder / "scores.csv")["auroc"].mean() > 0.8
    assert np.isfinite(table["p_error"]).all()


@pytest.mark.filterwarnings("ignore")
def test_recordings_of_ones_own_are_shown_by_the_command(tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    for number in (1, 2, 3):
        signal, events = writers.planted(number, 40, amplitude=4.0)
        inside = tmp_path / "mine" / f"sub-{number:02d}" / "eeg"
        inside.mkdir(parents=True)
        writers.brainvision(inside / f"sub-{number:02d}_task-errp_eeg.vhdr", signal, events)
    (tmp_path / "mine" / "derivatives").mkdir()
    folders = ["--eeg", str(tmp_path / "mine"), "--out", str(tmp_path / "out")]
    command = ["--profile", "smoke", *folders]
    assert main([*command, "--list"]) == 0
    told = capfd.readouterr().out
    assert "3 people, 3 sessions, 3 recordings" in told and "Stimulus/error" in told
    command += ["--events", "correct", "error", "--workers", "1", "--only", "01"]
    assert main(command) == 0, capfd.readouterr().err
    tables = tmp_path / "out" / "results" / "smoke-mine" / "tables"
    assert pd.read_csv(tables / "trial_counts.csv")["error"].tolist() == [14] * 3
    assert pd.read_csv(tables / "spectra.csv")["frequency"].max() == 60
    assert pd.read_csv(tables / "classical.csv")["auroc"].mean() > 0.8
