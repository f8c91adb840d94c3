"""The simulated recordings: same seed same bytes, the format of the real ones, what was planted."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rlihf_lib.eeg import eeglab, head, hri, simulated
from rlihf_lib.eeg.head import lead_field
from rlihf_lib.files import sha256


@pytest.fixture(autouse=True)
def small(monkeypatch, tmp_path):
    """Two blocks instead of ten, in a cache of their own."""
    monkeypatch.setattr(hri, "N_BLOCKS", 2)
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path / "cache"))


def test_one_seed_gives_bit_identical_files(tmp_path):
    paths = [tmp_path / name / "s03_cursor.set" for name in ("a", "b")]
    for path in paths:
        simulated.write_set(path, *simulated.simulate("s03"))
    for suffix in (".set", ".fdt"):
        first, second = (sha256(path.with_suffix(suffix)) for path in paths)
        assert first == second
    other, _ = simulated.simulate("s03", replace(simulated.MODEL, seed=1))
    assert not np.array_equal(other[:, :1000], simulated.simulate("s03")[0][:, :1000])


def test_reading_gives_back_exactly_what_was_generated():
    data, events = simulated.simulate("s03")
    raw = eeglab.read_eeglab(simulated.recording("s03"))
    np.testing.assert_array_equal(raw.get_data(), data.astype(float) * 1e-6)
    assert raw.ch_names == list(hri.CHANNELS)
    assert list(raw.annotations.description) == [name for _, name in events]


def test_a_recording_is_made_once_and_again_if_half_of_it_is_gone():
    path = simulated.recording("s03")
    made = path.stat().st_mtime_ns
    assert simulated.recording("s03").stat().st_mtime_ns == made
    path.with_suffix(".fdt").unlink()
    assert simulated.recording("s03").with_suffix(".fdt").is_file()


def test_other_parameters_go_to_another_folder():
    assert simulated.recording("s03") != simulated.recording(
        "s03", replace(simulated.MODEL, noise=2.0)
    )


def test_the_protocol_is_that_of_the_data_set(monkeypatch):
    monkeypatch.setattr(hri, "N_BLOCKS", 10)
    trials, events, duration = simulated.protocol(np.random.default_rng(0), simulated.MODEL)
    count = Counter(name for _, name in events)
    assert len(trials) == 500
    assert sum(count[name] for name in hri.FEEDBACKS) == 500
    assert 150 <= count[hri.MACHINE_ERROR] <= 200  # published: about 175
    assert 1 <= count[hri.HUMAN_ERROR] <= 20
    chances = [trial.chance for trial in trials[:: hri.N_TRIALS_PER_BLOCK]]
    assert sorted(chances) == [0.2] * 5 + [0.5] * 5
    times = np.array([at for at, _ in events])
    assert (np.diff(times) > 0).all()
    assert times[-1] < duration * hri.SFREQ
    assert 2.2 < duration / 10 / 60 < 2.9  # minutes a block; published: about 2.5


def test_errors_evoke_more_than_correct_feedback():
    """Without background activity, the difference wave is the error response, and no more."""
    quiet = replace(simulated.MODEL, background=1e-6, alpha=1e-6, noise=1e-6)
    silent = replace(quiet, people=dict.fromkeys(hri.SUBJECTS, (0.0, 0.0, 0.0)))
    cz, pz = hri.CHANNELS.index("Cz"), hri.CHANNELS.index("Pz")

    def difference(model):
        data, events = simulated.simulate("s04", model)
        names = [name for _, name in events]
        by_outcome = {}
        for outcome in (hri.CORRECT, hri.MACHINE_ERROR):
            at = [int(events[i - 1][0]) for i, name in enumerate(names) if name == outcome]
            by_outcome[outcome] = np.mean([data[:, n : n + 205] for n in at], axis=0)
        return by_outcome[hri.MACHINE_ERROR] - by_outcome[hri.CORRECT]

    # Same seed, same eye movements: their difference is the error response alone.
    wave = difference(quiet) - difference(silent)
    assert wave[cz, 55:67].mean() < -1  # error negativity, 215 to 260 ms
    assert wave[cz, 76:87].mean() > 1  # error positivity, 297 to 340 ms
    assert wave[pz, 95:120].mean() > 1
    assert np.abs(wave[:, :10]).max() < 0.1


def test_responses_are_smaller_where_errors_are_frequent():
    trials = [simulated.Trial(1.0, True, 0.2, 0), simulated.Trial(5.0, True, 0.5, 0)]
    model = replace(simulated.MODEL, trial_spread=0.0, jitter=0.0, lapse=0.0)
    silent = tuple(replace(component, moment=0.0) for component in model.feedback)
    model = replace(model, feedback=silent)
    data = np.zeros((30, 2048))
    rngs = np.random.default_rng(1), np.random.default_rng(0)
    head.add_responses(data, trials, "s04", model, rngs)
    rare, frequent = (np.abs(data[:, at : at + 256]).max() for at in (256, 1280))
    assert frequent == pytest.approx(simulated.MODEL.frequent * rare, rel=1e-3)


def test_blinks_are_largest_at_the_forehead():
    data = np.zeros((30, 60 * 256))
    head.add_eyes(data, [], simulated.MODEL, np.random.default_rng(0))
    size = dict(zip(hri.CHANNELS, np.ptp(data, axis=1), strict=True))
    assert 60 < size["Fp1"] < 200  # uV
    assert size["EOG3"] > size["Fz"] > size["Pz"]


def test_background_falls_with_frequency():
    noise = head.coloured((4, 2**16), lambda f: (f + 0.5) ** -1.2, np.random.default_rng(0))
    assert noise.std() == pytest.approx(1.0, abs=0.05)
    power = np.abs(np.fft.rfft(noise)) ** 2
    f = np.fft.rfftfreq(2**16, 1 / 256)
    low, high = (power[:, (f > a) & (f < b)].mean() for a, b in ((4, 6), (40, 60)))
    assert low / high == pytest.approx((50.5 / 5.5) ** 1.2, rel=0.1)


def test_a_radial_dipole_under_cz_is_positive_at_cz_and_symmetric():
    field = lead_field([[0.0, 0.0, 0.6]])[:, 0, 2]
    value = dict(zip(hri.CHANNELS, field, strict=True))
    assert max(value, key=value.get) == "Cz"
    for left, right in (("C3", "C4"), ("F7", "F8"), ("O1", "O2")):
        assert value[left] == pytest.approx(value[right], abs=0.1 * value["Cz"])
