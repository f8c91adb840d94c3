import numpy as np
import pytest

from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.eegnet import half_second_architecture
from rlihf_lib.eeg.ensemble import EEGNetBatch
from rlihf_lib.eeg.signals import InputFormat
from rlihf_lib.eeg.streaming import RingBuffer, StreamDecoder, replay

CHANNELS = ("Fz", "Cz", "Pz")


@pytest.fixture
def decoder():
    layout = InputFormat(CHANNELS, 128.0, -0.1, 100, start=13, stop=99, decimation=2)
    architecture = half_second_architecture(3, 43, layout.network_sfreq)
    return Decoder(layout, EEGNetBatch(architecture, [0, 1]), temperature=1.7)


@pytest.fixture
def stream():
    return np.random.default_rng(0).normal(0, 1e-5, (3, 3000))


EVENTS = (13, 400, 450, 451, 1500, 2900)


def offline(decoder, stream):
    windows = np.stack([stream[:, e - 13 : e - 13 + 100] for e in EVENTS])
    return decoder.log_odds(windows)


@pytest.mark.parametrize("chunk", [1, 7, 100, 256, 1024, 3000, "random"])
def test_streamed_equals_offline_whatever_the_chunks(decoder, stream, chunk):
    rng = np.random.default_rng(1)
    decoding = StreamDecoder(decoder)
    for event in EVENTS:
        decoding.mark(event)
    decoded, first = {}, 0
    while first < stream.shape[1]:
        size = int(rng.integers(0, 500)) if chunk == "random" else chunk
        decoded.update(decoding.push(stream[:, first : first + size]))
        first += size
    assert sorted(decoded) == sorted(EVENTS)
    streamed = np.array([decoded[event] for event in EVENTS])
    np.testing.assert_allclose(streamed, offline(decoder, stream), atol=1e-9)
    assert len(decoding.latencies) == len(EVENTS)


def test_events_may_be_marked_as_they_happen_or_a_little_later(decoder, stream):
    decoding = StreamDecoder(decoder)
    decoded = {}
    for first in range(0, 3000, 50):
        decoded.update(decoding.push(stream[:, first : first + 50]))
        for event in EVENTS:
            if first <= event < first + 50:
                decoding.mark(event)
    decoded.update(decoding.push(np.empty((3, 0))))
    assert sorted(decoded) == sorted(EVENTS)


def test_channels_of_a_stream_are_matched_by_name(decoder, stream):
    shuffled = StreamDecoder(decoder, channels=("EOG1", "Pz", "Cz", "Fz"))
    straight = StreamDecoder(decoder)
    for decoding in (shuffled, straight):
        decoding.mark(500)
    mixed = np.vstack([stream[:1] * 9, stream[::-1]])
    assert shuffled.push(mixed) == straight.push(stream)
    with pytest.raises(ValueError, match=r"lacks the channel.* Pz"):
        StreamDecoder(decoder, channels=("Fz", "Cz"))


def test_replayed_epochs_equal_offline(decoder):
    signals = np.random.default_rng(2).normal(0, 1e-5, (9, 3, 100))
    log_odds, latencies = replay(decoder, signals, chunk=33)
    np.testing.assert_allclose(log_odds, decoder.log_odds(signals), atol=1e-9)
    assert latencies.shape == (9,)


def test_a_window_that_is_gone_or_never_was_is_refused():
    buffer = RingBuffer(1, 10, n_windows=2)
    list(buffer.push(np.zeros((1, 35))))
    buffer.mark(20)
    with pytest.raises(ValueError, match="reaches back to 15 only"):
        buffer.mark(14)
    with pytest.raises(ValueError, match="starts at -3"):
        RingBuffer(1, 10, offset=-3).mark(0)


def test_wrong_shape_and_nan_are_refused(decoder, stream):
    with pytest.raises(ValueError, match=r"expected \(2 channels"):
        list(RingBuffer(2, 10).push(np.zeros((3, 5))))
    decoding = StreamDecoder(decoder)
    decoding.mark(50)
    stream[1, 60] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        decoding.push(stream)
