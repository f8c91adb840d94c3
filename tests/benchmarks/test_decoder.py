import sys
import types
from dataclasses import replace

import pytest

from rlihf_lib.eeg.eegnet import Architecture, EEGNet
from rlihf_lib.eeg.fitting import DEFAULTS
from tests.benchmarks import decoder
from tests.eeg.conftest import planted_epochs

SUBJECTS = ["s02", "s03", "s04"]


@pytest.fixture
def no_braindecode(monkeypatch):
    monkeypatch.setitem(sys.modules, "braindecode", None)


def test_both_are_trained_and_scored_on_the_same_folds(no_braindecode):
    data = {subject: planted_epochs(seed, n=90) for seed, subject in enumerate(SUBJECTS)}
    settings = replace(DEFAULTS, max_epochs=12, patience=12)
    compared = decoder.loso_comparison(data, SUBJECTS[:2], settings)
    # The target is 5 x; looser here, on tiny epochs and where other processes may be running.
    assert compared["loso_speedup"] > 1
    assert compared["loso_auroc"] > 0.75
    assert compared["loso_auroc_reference"] > 0.75
    assert "published layers" in compared["loso_reference"]


def test_without_braindecode_the_table_says_so_and_how_to_install_it(no_braindecode):
    network, name = decoder.reference_network(27, 256)
    assert isinstance(network, EEGNet)
    assert "braindecode not importable" in name and "pip install --no-deps braindecode" in name


def test_braindecode_is_the_reference_where_it_is_installed(monkeypatch):
    def network(n_chans, n_outputs, n_times, drop_prob):
        assert n_outputs == 2
        return EEGNet(Architecture(n_chans, n_times, dropout=drop_prob))

    fake = types.SimpleNamespace(__version__="9.9", models=types.SimpleNamespace(EEGNet=network))
    monkeypatch.setitem(sys.modules, "braindecode", fake)
    assert decoder.reference_network(27, 256)[1] == "braindecode 9.9 network"


def test_an_event_is_decoded_within_milliseconds():
    latency = decoder.decode_latency(n_events=40)
    assert 0 < latency["decode_ms_median"] < 5
    assert latency["decode_ms_p99"] >= latency["decode_ms_median"]


def test_preprocessing_is_timed_and_its_memory_measured(monkeypatch, tmp_path):
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path))
    cost = decoder.preprocessing_cost(["s03"])
    assert 0 < cost["preprocess_s"] < 120
    # A recording of 25 minutes alone is 90 MiB in double precision.
    assert 200 < cost["preprocess_peak_mib"] < 8000
