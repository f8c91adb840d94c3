"""Epochs of one's own, from the command line to p(error), under their own event names."""

import numpy as np
import pandas as pd
import pytest

from rlihf_lib.__main__ import main


@pytest.mark.filterwarnings("ignore")
def test_a_folder_of_ones_own_is_decoded_by_the_command(make_epochs, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "mine"
    folder.mkdir()
    for number, sessions in ((3, "ab"), (7, "a"), (9, "a")):
        for session in sessions:
            epochs = make_epochs(10 * number + ord(session), amplitude=6e-6)
            epochs.event_id = {"good": 1, "bad": 2}
            if number == 7:
                epochs.reorder_channels(epochs.ch_names[::-1])
            epochs.save(folder / f"sub-{number:02d}_ses-{session}_epo.fif", verbose="error")
    arguments = ["--profile", "smoke", "--eeg", str(folder), "--out", str(tmp_path / "out")]
    arguments += ["--events", "good", "bad", "--only", "01", "02", "--workers", "1"]
    assert main(arguments) == 0, capfd.readouterr().err
    decoder = tmp_path / "out" / "results" / "smoke-mine" / "decoder"
    table = pd.read_csv(decoder / "p_error.csv", dtype={"subject": str})
    assert table.groupby("subject").size().to_dict() == {"03": 120, "07": 60, "09": 60}
    assert pd.read_csv(decoder / "scores.csv")["auroc"].mean() > 0.8
    assert np.isfinite(table["p_error"]).all()
