"""What has a law holds for any values (hypothesis)."""

import argparse
import io
import string
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sklearn.metrics import roc_auc_score

from rlihf_lib.__main__ import MOST_WORKERS, parser
from rlihf_lib.eeg.scores import auroc, fit_temperature, probability
from rlihf_lib.eeg.streaming import RingBuffer
from rlihf_lib.files import write_csv
from rlihf_lib.report import statistics
from rlihf_lib.rl.runs import RunConfig, SACSettings
from rlihf_lib.task.path import Polyline, path_efficiency

settings.register_profile("laws", max_examples=60, deadline=None, derandomize=True, database=None)
settings.load_profile("laws")

lengths = st.floats(0, 10)
shares = st.floats(0, 1)
points = arrays(float, 3, elements=st.floats(-1, 1))
values = arrays(float, st.integers(2, 9), elements=st.floats(-100, 100).map(lambda x: round(x, 3)))


@given(lengths, lengths, shares)
def test_path_efficiency_is_a_share_and_falls_with_the_way_made(ideal, executed, completed):
    efficiency = path_efficiency(ideal, executed, completed)
    assert 0 <= efficiency <= 1
    assert path_efficiency(ideal, executed + 1, completed) <= efficiency or executed == 0
    assert path_efficiency(ideal, executed, completed / 2) <= efficiency


@given(arrays(float, (4, 3), elements=st.floats(-1, 1)), points, points, st.floats(1.1, 4))
def test_remaining_path_is_the_cheapest_way_back_and_never_jumps(vertices, x, y, detour):
    path = Polyline(vertices, detour)
    left, _ = path.remaining(x)
    assert -1e-9 <= left <= detour * path.distance(x) + path.length + 1e-9
    assert abs(left - path.remaining(y)[0]) <= detour * np.linalg.norm(x - y) + 1e-9
    on_it = path.at(path.length / 3)
    assert path.remaining(on_it)[0] <= path.length * 2 / 3 + 1e-6
    assert left <= detour * np.linalg.norm(x - on_it) + path.length * 2 / 3 + 1e-6


@given(values, st.floats(-10, 10), st.randoms(use_true_random=False))
def test_interquartile_mean_lies_within_and_moves_with_its_runs(scores, shift, random):
    mean = statistics.iqm(scores)
    assert scores.min() - 1e-9 <= mean <= scores.max() + 1e-9
    assert statistics.iqm(scores + shift) == pytest.approx(mean + shift, abs=1e-6)
    assert statistics.iqm(random.sample(list(scores), len(scores))) == pytest.approx(mean)


@given(arrays(float, st.integers(1, 8), elements=shares))
def test_holm_never_lowers_p_and_keeps_the_order(p):
    corrected = statistics.holm(p)
    assert (corrected >= p).all() and (corrected <= 1).all()
    assert corrected.min() <= min(1, len(p) * p.min()) + 1e-12
    order = np.argsort(p, kind="stable")
    assert (np.diff(corrected[order]) >= 0).all()


@settings(max_examples=15)
@given(arrays(float, (2, 4), elements=shares), st.booleans())
def test_a_test_does_not_depend_on_who_is_called_first(groups, paired):
    p, smallest = statistics.permutation_test(*groups, paired)
    assert statistics.permutation_test(*groups[::-1], paired) == pytest.approx((p, smallest))
    assert smallest - 1e-12 <= p <= 1


@given(st.lists(st.tuples(st.booleans(), st.integers(-5, 5)), min_size=2, max_size=30))
def test_auroc_is_scikit_learns_whatever_the_scale(rows):
    labels, scores = (np.array(column) for column in zip(*rows, strict=True))
    if labels.all() or not labels.any():
        return
    area = auroc(scores, labels.astype(int))
    assert area == pytest.approx(roc_auc_score(labels, scores))
    assert auroc(np.exp(scores), labels.astype(int)) == pytest.approx(area)
    assert auroc(-scores, labels.astype(int)) == pytest.approx(1 - area)


@given(arrays(float, 20, elements=st.integers(-40, 40).map(lambda n: n / 10)), st.floats(0.3, 3))
def test_the_temperature_undoes_a_scale(log_odds, scale):
    labels = (np.arange(20) % 3 == 0).astype(int)
    temperature, scaled = (
        fit_temperature(log_odds, labels),
        fit_temperature(scale * log_odds, labels),
    )
    if log_odds.any() and 0.2 < temperature < 5:  # within the bounds with any of the scales
        assert scaled == pytest.approx(scale * temperature, rel=1e-3)
    assert np.all(np.diff(probability(np.sort(log_odds), temperature)) >= 0)


@given(st.lists(st.integers(0, 25), max_size=30), st.lists(st.integers(0, 150), max_size=6))
def test_windows_of_a_stream_do_not_depend_on_how_it_is_cut(sizes, events):
    recording = np.arange(2 * 200, dtype=float).reshape(2, 200)
    buffer, found = RingBuffer(2, 20, offset=3, n_windows=20), []
    for event in events:
        buffer.mark(event)
    edges = [*np.cumsum([0, *sizes]), 200]
    for first, last in pairwise(edges):
        found += buffer.push(recording[:, first : max(first, last)])
    assert sorted(sample for sample, _ in found) == sorted(e for e in events if e + 23 <= 200)
    for sample, window in found:
        assert np.array_equal(window, recording[:, sample + 3 : sample + 23])


configs = st.builds(
    RunConfig, st.sampled_from(["sparse", "dense"]), st.integers(0, 9), st.integers(1, 9),
    st.integers(1, 9), horizon=st.integers(1, 3), patience=st.integers(1, 3),
    sac=st.builds(SACSettings, discount=st.sampled_from([0.9, 0.99]), tau=st.just(0.01)),
)  # fmt: skip


@given(configs, configs)
def test_runs_are_equal_exactly_if_their_hashes_are(first, second):
    assert (first == second) == (first.hash == second.hash)
    assert set(first.run_id) <= set(string.ascii_letters + string.digits + "-._")
    written_out = RunConfig(**{n: getattr(first, n) for n in first.__dataclass_fields__})
    assert written_out.hash == first.hash, "a default that is written out changes nothing"


@given(arrays(float, st.integers(1, 5), elements=st.floats(allow_nan=False, allow_infinity=False)))
def test_numbers_come_back_from_a_table_bit_by_bit(tmp_path_factory, numbers):
    path = tmp_path_factory.getbasetemp() / "numbers.csv"
    write_csv(path, pd.DataFrame({"x": numbers}))
    back = pd.read_csv(io.StringIO(path.read_text()), float_precision="round_trip")["x"]
    assert np.array_equal(back.to_numpy(float), numbers)


@given(st.text(max_size=6) | st.integers(-5, 2_000).map(str))
def test_a_number_of_workers_is_one_or_is_refused(text):
    try:
        options = parser().parse_args([f"--workers={text}"])
    except (SystemExit, argparse.ArgumentError):
        assert not (text.isascii() and text.isdigit() and int(text) <= MOST_WORKERS)
    else:
        assert options.workers == int(text) and 0 <= options.workers <= MOST_WORKERS
