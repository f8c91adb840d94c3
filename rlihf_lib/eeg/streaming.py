"""Samples in, time-aligned windows out, p(error) out: of a replay, or of an amplifier (`lsl`)."""

import time
from bisect import insort
from collections.abc import Iterator

import numpy as np
import pandas as pd
from scipy.signal import butter, sosfilt, sosfilt_zi

from rlihf_lib.eeg.scores import probability

CHUNK = 8  # samples an amplifier delivers at a time, 31 ms at 256 Hz; p(error) is as much late
#: Orders of the causal filter at its lower and its upper edge. The less steep, the sooner a
#: response is through: with 2, 2 the AUROC of 0.6 s was .02 lower (LDA, simulated people).
ORDERS = 1, 2
#: Peak to peak on any channel, V: less is no signal, more an artefact.
FLAT, ARTEFACT = 0.1e-6, 200e-6


class CausalFilter:
    """Band-pass a stream by what has come so far: any chunks give the same bits.

    Butterworth's, so of minimum phase, with its state kept between chunks. It begins as if the
    first sample had always been there. Lost samples (not finite) stay lost; meanwhile the last one
    that came is held. Returns single precision, as epochs are cached in.
    """

    def __init__(self, band, sfreq):
        edges = zip(ORDERS, band, ("highpass", "lowpass"), strict=True)
        self._sos = np.vstack([butter(*edge, fs=sfreq, output="sos") for edge in edges])
        self._last, self._state = np.empty(0), np.empty(0)

    def __call__(self, chunk) -> np.ndarray:
        """Filter samples, shape (n_channels, any n)."""
        chunk = np.where(np.isfinite(chunk), chunk, np.nan)
        if not chunk.size:
            return chunk.astype(np.float32)
        if not self._state.size:
            self._last = np.nan_to_num(chunk[:, :1])
            self._state = sosfilt_zi(self._sos)[:, None] * self._last
        held = np.hstack([self._last, chunk])
        lost = np.isnan(held)
        if lost.any():
            held = pd.DataFrame(held).ffill(axis=1).to_numpy()
        filtered, self._state = sosfilt(self._sos, held[:, 1:], zi=self._state)
        self._last = held[:, -1:]
        filtered[lost[:, 1:]] = np.nan
        return filtered.astype(np.float32)


class RingBuffer:
    """The latest samples of a stream, and the windows events ask for.

    A window is `n_times` samples long and starts `offset` samples after its event. The capacity is
    `n_windows`: so late after its window's last sample an event may be marked.
    """

    def __init__(self, n_channels, n_times, offset=0, n_windows=4):
        self.n_times = n_times
        self.offset = offset
        self.n_received = 0
        self.capacity = n_windows * n_times
        self._pending = []
        self._samples = np.zeros((n_channels, self.capacity))

    def mark(self, sample) -> None:
        """Ask for the window of an event at a sample of the stream, which may be still to come.

        A ValueError says if it starts before the stream or has been overwritten already.
        """
        start = int(sample) + self.offset
        oldest = max(0, self.n_received - self.capacity)
        if start < oldest:
            raise ValueError(
                f"the window of the event at sample {sample} starts at {start}, but the buffer "
                f"reaches back to {oldest} only; mark events earlier or buffer more windows"
            )
        insort(self._pending, int(sample))

    def push(self, chunk) -> Iterator[tuple[int, np.ndarray]]:
        """Append samples, shape (n_channels, any n); of events now complete, sample and window.

        The windows are copies, shape (n_channels, n_times).
        """
        chunk = np.asarray(chunk)
        if chunk.ndim != 2 or len(chunk) != len(self._samples):
            raise ValueError(
                f"a chunk of shape {chunk.shape}; expected ({len(self._samples)} channels, n)"
            )
        # Piecewise, and only after the windows that are complete, which overwrites nothing needed.
        for first in range(0, chunk.shape[1], self.n_times):
            yield from self._complete()
            piece = chunk[:, first : first + self.n_times]
            where = (self.n_received + np.arange(piece.shape[1])) % self.capacity
            self._samples[:, where] = piece
            self.n_received += piece.shape[1]
        yield from self._complete()

    def _complete(self):
        reach = self.n_received - self.n_times - self.offset
        while self._pending and self._pending[0] <= reach:
            sample = self._pending.pop(0)
            where = (sample + self.offset + np.arange(self.n_times)) % self.capacity
            yield sample, self._samples[:, where]


class StreamDecoder:
    """Decode the events of a stream, each as soon as the window that is decoded is full.

    Of the channels of the stream, by default the decoder's, those of the decoder are picked by
    name; a ValueError says which are lacking or there twice. A `live` stream is filtered here, in
    the decoder's `band` if it has one, and a window of it that cannot be decoded, of which `flaws`
    says why, has log-odds of NaN; any other stream is preprocessed.
    """

    def __init__(self, decoder, channels=None, live=False):
        self.decoder = decoder
        layout = decoder.input_format
        channels = layout.channels if channels is None else tuple(channels)
        if unclear := [name for name in layout.channels if channels.count(name) != 1]:
            raise ValueError(
                f"the stream lacks the channel(s) {', '.join(unclear)} of the decoder, or has them "
                f"twice; it has {', '.join(channels) or 'no names'}: name them alike, or train on "
                "those that both have"
            )
        self._picks = [channels.index(name) for name in layout.channels]
        self._live, band = live, decoder.band
        self._filter = CausalFilter(band, layout.sfreq) if live and band else None
        self.buffer = RingBuffer(len(self._picks), layout.stop - layout.start, layout.offset)
        self.latencies: list[float] = []  # s from a window's last sample to its p(error)
        self.flaws: dict[int, str] = {}  # by the event's sample

    def mark(self, sample) -> None:
        """Announce a feedback event; see `RingBuffer.mark`."""
        self.buffer.mark(sample)

    def push(self, chunk) -> list[tuple[int, float]]:
        """Append samples, shape (n_channels, any n); sample and log-odds of events now decoded."""
        chunk = np.asarray(chunk)[self._picks]
        decoded = []
        for sample, window in self.buffer.push(self._filter(chunk) if self._filter else chunk):
            start = time.perf_counter()
            if self._live and (flaw := self._flaw(window)):
                self.flaws[sample] = flaw
                decoded.append((sample, np.nan))
            else:
                decoded.append((sample, float(self.decoder.log_odds(window[None])[0])))
            self.latencies.append(time.perf_counter() - start)
        return decoded

    def _flaw(self, window):
        height = np.ptp(window, axis=1)
        if np.isnan(height).any():
            return "samples were lost"
        for channel in (height.argmin(), height.argmax()):
            if not FLAT <= height[channel] <= ARTEFACT:
                name = self.decoder.input_format.channels[channel]
                return f"{1e6 * height[channel]:.3g} µV peak to peak in {name}"
        return ""

    def p_error(self, log_odds) -> float:
        """Calibrated p(error) of an event; where nothing could be decoded (NaN), the prior."""
        known = np.nan_to_num(log_odds)
        return float(probability(known, self.decoder.temperature, self.decoder.prior))


def replay(decoder, signals, chunk=CHUNK) -> tuple[np.ndarray, np.ndarray]:
    """Replay the windows of a subject's epochs, one after the other, in chunks of so many samples.

    From signals as for `Decoder.log_odds` to their log-odds and latencies in s, shape (n,).
    """
    stream = StreamDecoder(decoder)
    log_odds = [_stream(stream, window, chunk) for window in decoder.input_format.window(signals)]
    return np.array(log_odds), np.array(stream.latencies)


def _stream(stream, window, chunk=CHUNK):
    """Log-odds of a window, which comes as the next samples of a stream."""
    stream.mark(stream.buffer.n_received - stream.buffer.offset)
    pieces = (window[:, first : first + chunk] for first in range(0, window.shape[1], chunk))
    ((_, log_odds),) = (decoded for piece in pieces for decoded in stream.push(piece))
    return log_odds


class LiveFeedback:
    """A person's `SubjectEpochs` as a stream, decoded by a decoder that never saw this person.

    Policies are trained from a table of p(error), because decoding the same epochs again gives the
    same numbers; this does it all the same, as it would be with somebody wearing the cap.
    """

    def __init__(self, decoder, held_out):
        self._stream = StreamDecoder(decoder)
        layout = decoder.input_format
        windows = layout.window(layout.pick(held_out))
        self._windows = dict(zip(held_out.index, windows, strict=True))

    def __call__(self, epoch) -> float:
        """Stream the epoch of that number, as in the p(error) table, and decode it."""
        return self._stream.p_error(_stream(self._stream, self._windows[epoch]))
