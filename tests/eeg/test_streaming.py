import numpy as np
import pytest

from rlihf_lib.eeg import hri, simulated
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.eegnet import half_second_architecture
from rlihf_lib.eeg.ensemble import EEGNetBatch
from rlihf_lib.eeg.finetuning import fine_tune
from rlihf_lib.eeg.preprocessing import Preprocessing, load_epochs
from rlihf_lib.eeg.signals import InputFormat, SubjectEpochs
from rlihf_lib.eeg.streaming import CausalFilter, RingBuffer, StreamDecoder, replay

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


@pytest.mark.parametrize("n_next", [0, 1, 5, 10, 40])
def test_a_window_that_was_there_when_marked_is_given_whole(n_next):
    stream = np.arange(75.0)[None]
    buffer = RingBuffer(1, 10, n_windows=2)
    list(buffer.push(stream[:, :35]))
    buffer.mark(15)
    buffer.mark(26)
    windows = dict(buffer.push(stream[:, 35 : 35 + n_next]))
    assert windows.keys() == ({15, 26} if n_next else {15})
    for first, window in windows.items():
        np.testing.assert_array_equal(window, stream[:, first : first + 10])


def test_wrong_shape_and_nan_are_refused(decoder, stream):
    with pytest.raises(ValueError, match=r"expected \(2 channels"):
        list(RingBuffer(2, 10).push(np.zeros((3, 5))))
    decoding = StreamDecoder(decoder)
    decoding.mark(50)
    stream[1, 60] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        decoding.push(stream)


def test_p_error_comes_with_the_last_sample_that_is_decoded(decoder, stream):
    decoding = StreamDecoder(decoder)
    decoding.mark(400)
    layout = decoder.input_format
    last = 400 - 13 + layout.stop - 1  # of the window; the epoch goes on until 400 - 13 + 100 - 1
    assert last < 400 - 13 + layout.n_times - 1
    assert decoding.push(stream[:, :last]) == []
    ((sample, log_odds),) = decoding.push(stream[:, last : last + 1])
    epoch = stream[None, :, 400 - 13 : 400 - 13 + 100]
    assert (sample, log_odds) == (400, decoder.log_odds(epoch)[0])


def test_a_window_alone_is_decoded_as_the_epoch_it_is_cut_from(decoder):
    epochs = np.random.default_rng(2).normal(0, 1e-5, (9, 3, 100))
    windows = decoder.input_format.window(epochs)
    assert windows.shape == (9, 3, 86)
    np.testing.assert_array_equal(decoder.log_odds(windows), decoder.log_odds(epochs))
    with pytest.raises(ValueError, match="100 samples at 128 Hz, or the 86 it decodes"):
        decoder.log_odds(epochs[..., :99])


@pytest.mark.parametrize("chunks", [[1] * 3000, [7] * 500, [0, 1500, 1500], [3000]])
def test_a_causal_filter_gives_the_same_bits_whatever_the_chunks(stream, chunks):
    offset = 5e-3 + stream  # as electrodes have
    whole = CausalFilter((1.0, 20.0), 128.0)(offset)
    filtered = CausalFilter((1.0, 20.0), 128.0)
    parts = np.split(offset, np.cumsum(chunks)[:-1], axis=1)
    np.testing.assert_array_equal(np.hstack([filtered(part) for part in parts]), whole)
    assert np.abs(whole).max() < 1e-4, "the offset is not gone"


def test_a_causal_filter_knows_nothing_of_the_future_and_keeps_its_band(stream):
    changed = stream.copy()
    changed[:, 2000:] *= -3
    first, second = (CausalFilter((1.0, 20.0), 128.0)(x) for x in (stream, changed))
    np.testing.assert_array_equal(first[:, :2000], second[:, :2000])
    assert not np.allclose(first[:, 2000], second[:, 2000])
    time = np.arange(3000) / 128.0
    for frequency, low, high in ((0.1, 0.0, 0.12), (5.0, 0.9, 1.0), (50.0, 0.0, 0.12)):
        wave = CausalFilter((1.0, 20.0), 128.0)(np.sin(2 * np.pi * frequency * time)[None])
        assert low <= wave[0, 1500:].max() <= high, frequency


def test_a_raw_stream_is_decoded_as_epochs_that_were_filtered_as_a_whole(decoder, stream):
    decoder.band = (1.0, 20.0)
    whole = CausalFilter(decoder.band, 128.0)(stream)
    decoding = StreamDecoder(decoder, live=True)
    for event in EVENTS:
        decoding.mark(event)
    decoded = {}
    for first in range(0, 3000, 11):
        decoded.update(decoding.push(stream[:, first : first + 11]))
    assert list(decoded) == list(EVENTS)
    for event in EVENTS:
        epoch = whole[None, :, event - 13 : event - 13 + 100]
        assert decoded[event] == decoder.log_odds(epoch)[0]
    assert not np.allclose(list(decoded.values()), offline(decoder, stream))


@pytest.mark.parametrize("band", [None, (1.0, 20.0)])
@pytest.mark.parametrize(
    ("spoil", "flaw"),
    [
        (lambda x: x.__setitem__((1, slice(455, 460)), np.nan), "samples were lost"),
        (lambda x: x.__setitem__((1, slice(455, 480)), 1e-3), "µV peak to peak in Cz"),
        (lambda x: x.__setitem__(2, 0.0), "0 µV peak to peak in Pz"),
    ],
)
def test_what_cannot_be_decoded_is_said_and_leaves_the_prior(decoder, stream, spoil, flaw, band):
    decoder.band, decoder.prior = band, 0.3
    spoil(stream)
    decoding = StreamDecoder(decoder, live=True)
    decoding.mark(450)
    ((sample, log_odds),) = decoding.push(stream)
    assert sample == 450 and np.isnan(log_odds)
    assert flaw in decoding.flaws[450]
    assert decoding.p_error(log_odds) == pytest.approx(0.3)


def test_lost_samples_spoil_nothing_later(decoder, stream):
    decoder.band = (1.0, 20.0)
    gap = stream.copy()
    gap[:, 1000:1040] = np.nan
    decoded = []
    for recording in (stream, gap):
        decoding = StreamDecoder(decoder, live=True)
        decoding.mark(2500)
        decoded += decoding.push(recording)
    assert decoded[1][1] == pytest.approx(decoded[0][1], abs=1e-6)


def test_a_decoder_for_live_use_keeps_its_band(decoder, tmp_path):
    decoder.band = (1.0, 20.0)
    decoder.save(tmp_path / "live.safetensors")
    assert Decoder.load(tmp_path / "live.safetensors").band == (1.0, 20.0)
    assert fine_tune(decoder, np.ones((2, 3, 100)), np.array([0, 1])).band == (1.0, 20.0)
    decoder.band = None
    decoder.save(tmp_path / "offline.safetensors")
    assert Decoder.load(tmp_path / "offline.safetensors").band is None
    assert b"band" not in (tmp_path / "offline.safetensors").read_bytes()


def test_an_amplifiers_samples_are_decoded_as_the_recordings_causal_epochs(tmp_path, monkeypatch):
    monkeypatch.setattr(hri, "N_BLOCKS", 2)
    monkeypatch.setenv("RLIHF_CACHE", str(tmp_path))
    settings = Preprocessing(reference="recorded", phase="minimum")
    recorded = load_epochs("simulated", "s03", settings)
    epochs = SubjectEpochs.from_mne("s03", recorded)
    layout = InputFormat.of(epochs, (0.0, 1.0))
    networks = EEGNetBatch(half_second_architecture(27, 32, layout.network_sfreq), [0])
    decoder = Decoder(layout, networks, band=(settings.l_freq, settings.h_freq))
    microvolts, _ = simulated.simulate("s03")
    decoding = StreamDecoder(decoder, hri.CHANNELS, live=True)
    samples = recorded.metadata["sample"].to_numpy()[:20]
    for sample in samples:
        decoding.mark(sample)
    streamed = []
    for first in range(0, samples[-1] + 300, 8):
        chunk = 1e-6 * microvolts[:, first : first + 8].astype(float)
        streamed += [log_odds for _, log_odds in decoding.push(chunk)]
    assert streamed == [decoder.log_odds(epoch[None])[0] for epoch in epochs.signals[:20]]
