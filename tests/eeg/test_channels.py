"""A channel that isn't EEG, or that knows the answer, is refused by name."""

import mne
import numpy as np
import pytest

from rlihf_lib.eeg import channels, loso, overview
from rlihf_lib.eeg.loso import recorded_cohort, run_loso
from rlihf_lib.live import train_live
from rlihf_lib.rl.runs import RunConfig
from rlihf_lib.study import Study

SUBJECTS = ["01", "02", "03"]


def labels_of(epochs):
    return (epochs.events[:, 2] == epochs.event_id["error"]).astype(float)


def write(folder, make_epochs, signal=None, name="P10", kind="eeg"):
    """Epochs of three people, with a further channel `signal(labels, times)`, volts."""
    folder.mkdir(exist_ok=True)
    for number, subject in enumerate(SUBJECTS):
        epochs = make_epochs(number)
        if signal:
            values = signal(labels_of(epochs)[:, None], epochs.times) + 0 * epochs.times
            info = mne.create_info([name], epochs.info["sfreq"], kind)
            extra = mne.EpochsArray(
                values[:, None], info, epochs.events, epochs.tmin, epochs.event_id, verbose="error"
            )
            epochs.add_channels([extra], force_update_info=True)
        epochs.save(folder / f"sub-{subject}_epo.fif", verbose="error")
    return folder


def read(folder, subject, drop=()):
    return recorded_cohort(folder, SUBJECTS, drop_channels=drop)[subject]


def noise(scale):
    return np.random.default_rng(0).normal(0, scale, (60, 1))


LEAKS = {
    "constant": lambda labels, times: 1e-5 * labels,
    "inverted": lambda labels, times: -1e-5 * labels,
    "a volt": lambda labels, times: labels,
    "pulse": lambda labels, times: 1e-5 * labels * (abs(times - 0.4) < 0.02),
    "noisy": lambda labels, times: 1e-5 * labels + noise(2e-6),
}


@pytest.mark.parametrize("kind", LEAKS)
def test_a_channel_that_carries_the_label_is_refused(kind, make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs, LEAKS[kind])
    message = r"channel P10 \(AUROC .*\) alone tells .* --drop-channels P10"
    with pytest.raises(ValueError, match=message):
        run_loso(recorded_cohort(folder, SUBJECTS), tmp_path / "out")
    with pytest.raises(ValueError, match=message):
        channels.single_channels(recorded_cohort(folder, SUBJECTS), "mine")
    remedied = recorded_cohort(folder, SUBJECTS, drop_channels=["P10"])
    left = channels.single_channels(remedied, "mine")
    assert left.max() < channels.MAX_AUROC and "P10" not in left


def test_an_eeg_channel_without_a_position_is_refused(make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs, LEAKS["constant"], "label")
    with pytest.raises(ValueError, match=r"sub-01_epo.fif: EEG channel label has no position"):
        read(folder, "01")
    assert "label" not in read(folder, "01", ["label"]).ch_names


def test_an_electrode_keeps_its_own_position_beside_those_that_get_one_by_name(
    make_epochs, tmp_path
):
    folder = write(tmp_path / "mine", make_epochs, lambda labels, times: noise(1e-6), "E17")
    path, own = folder / "sub-01_epo.fif", (0.0, 0.09, 0.04)
    epochs = mne.read_epochs(path, verbose="error")
    epochs.info["chs"][-1]["loc"][:3] = own
    epochs.save(path, overwrite=True, verbose="error")
    places = read(folder, "01").get_montage().get_positions()["ch_pos"]
    np.testing.assert_allclose(places["E17"], own, atol=1e-6)
    assert np.isfinite(list(places.values())).all() and len(places) == 6


@pytest.mark.parametrize("name", ["O9", "o10", "FFT7h"])
def test_names_of_either_system_have_a_position(name, make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs, lambda labels, times: noise(1e-6), name)
    assert name in read(folder, "01").ch_names


def test_both_systems_agree_where_both_have_an_electrode():
    first, second = (
        mne.channels.make_standard_montage(name).get_positions()["ch_pos"]
        for name in ("standard_1020", "standard_1005")
    )
    assert set(first) - set(second) == {"O9", "O10"}
    assert all(np.array_equal(first[name], second[name]) for name in set(first) & set(second))


def test_channels_of_other_types_are_told_and_never_decoded(make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs, LEAKS["constant"], "STI 014", "stim")
    assert overview.notes(folder) == ["left out: STI 014 (of type stim)"]
    assert "STI 014" not in read(folder, "01").ch_names


def test_a_channel_to_drop_that_is_not_there_is_named(make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs)
    with pytest.raises(ValueError, match=r"has no channel Q7 to drop; it has .*Cz"):
        read(folder, "01", ["Q7"])


def test_dropping_every_channel_is_refused(make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs, LEAKS["constant"], "STI 014", "stim")
    with pytest.raises(ValueError, match=r"no EEG channel .*sub-01_epo.fif: Fz, .* drop fewer"):
        read(folder, "01", ["Fz", "Cz", "Pz", "C3", "C4"])


def test_a_channel_that_only_one_person_has_is_left_out_and_can_be_dropped(make_epochs, tmp_path):
    folder = write(tmp_path / "mine", make_epochs)
    spare = write(tmp_path / "spare", make_epochs, LEAKS["constant"], "Status")
    (spare / "sub-03_epo.fif").replace(folder / "sub-03_epo.fif")
    assert overview.notes(folder) == ["left out: Status (not in sub-01_epo.fif, sub-02_epo.fif)"]
    assert overview.notes(folder, ["Status"]) == ["left out: Status (--drop-channels)"]
    for drop in ((), ["Status"]):
        assert len(read(folder, "03", drop).ch_names) == 5


def test_live_decoding_does_not_go_round_the_check(make_epochs, tmp_path, monkeypatch):
    folder = write(tmp_path / "mine", make_epochs, LEAKS["pulse"])
    study = Study("smoke", folder, tmp_path / "out")
    config = RunConfig("rlihf", 1, 300, 150, subject="01", w_hf=0.7)
    monkeypatch.setattr(loso, "load_decoder", lambda *_: None)
    with pytest.raises(ValueError, match=r"channel P10 \(AUROC .*\) alone tells"):
        train_live(study, config)


def test_auroc_of_one_channel_is_that_of_its_ranks():
    signals = np.array([3.0, 1, 2, 4])[:, None, None]
    auroc = channels.channel_auroc(signals, np.array([1, 0, 1, 0]))
    assert auroc.shape == (1, 2) and auroc[0, 0] == 0.5
