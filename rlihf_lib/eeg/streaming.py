"""Samples in, time-aligned epochs out, p(error) out: replay today, a live amplifier tomorrow."""

import time
from collections.abc import Iterator

import numpy as np

from rlihf_lib.eeg.scores import probability

CHUNK = 32  # samples an amplifier delivers at a time


class RingBuffer:
    """The latest samples of a stream, and the windows events ask for.

    A window is `n_times` samples long and starts `offset` samples after its event. The capacity is
    `n_windows`: so late after its window's last sample an event may be marked.
    """

    def __init__(self, n_channels, n_times, offset=0, n_windows=4):
        self.n_times = n_times
        self.offset = offset
        self.n_received = 0
        self._pending = []
        self._samples = np.zeros((n_channels, n_windows * n_times))

    def mark(self, sample) -> None:
        """Ask for the window of an event at a sample of the stream, which may be still to come.

        A ValueError says if it starts before the stream or has been overwritten already.
        """
        start = int(sample) + self.offset
        oldest = max(0, self.n_received - self._samples.shape[1])
        if start < oldest:
            raise ValueError(
                f"the window of the event at sample {sample} starts at {start}, but the buffer "
                f"reaches back to {oldest} only; mark events earlier or buffer more windows"
            )
        self._pending.append(int(sample))

    def push(self, chunk) -> Iterator[tuple[int, np.ndarray]]:
        """Append samples, shape (n_channels, any n); of events now complete, sample and window.

        The windows are copies, shape (n_channels, n_times).
        """
        chunk = np.asarray(chunk)
        if chunk.ndim != 2 or len(chunk) != len(self._samples):
            raise ValueError(
                f"a chunk of shape {chunk.shape}; expected ({len(self._samples)} channels, n)"
            )
        # Piecewise, so that a chunk longer than the buffer overwrites nothing still needed; at
        # least once, for an event may have been marked after its samples.
        for first in range(0, max(chunk.shape[1], 1), self.n_times):
            piece = chunk[:, first : first + self.n_times]
            where = (self.n_received + np.arange(piece.shape[1])) % self._samples.shape[1]
            self._samples[:, where] = piece
            self.n_received += piece.shape[1]
            for sample in sorted(self._pending):
                start = sample + self.offset
                if start + self.n_times <= self.n_received:
                    self._pending.remove(sample)
                    where = np.arange(start, start + self.n_times) % self._samples.shape[1]
                    yield sample, self._samples[:, where]


class StreamDecoder:
    """Decode the events of a preprocessed stream as their epochs are complete.

    Of the channels of the stream, by default the decoder's, those of the decoder are picked by
    name; a ValueError says which are lacking.
    """

    def __init__(self, decoder, channels=None):
        self.decoder = decoder
        layout = decoder.input_format
        channels = tuple(channels or layout.channels)
        if missing := [name for name in layout.channels if name not in channels]:
            raise ValueError(f"the stream lacks the channel(s) {', '.join(missing)}")
        self._picks = [channels.index(name) for name in layout.channels]
        offset = round(layout.tmin * layout.sfreq)
        self.buffer = RingBuffer(len(self._picks), layout.n_times, offset)
        self.latencies: list[float] = []  # s from an event's last sample to its p(error)

    def mark(self, sample) -> None:
        """Announce a feedback event; see `RingBuffer.mark`."""
        self.buffer.mark(sample)

    def push(self, chunk) -> list[tuple[int, float]]:
        """Append samples, shape (n_channels, any n); sample and log-odds of events now decoded."""
        decoded = []
        for sample, window in self.buffer.push(np.asarray(chunk)[self._picks]):
            start = time.perf_counter()
            decoded.append((sample, float(self.decoder.log_odds(window[None])[0])))
            self.latencies.append(time.perf_counter() - start)
        return decoded

    def p_error(self, log_odds) -> float:
        """Calibrated p(error) of a decoded event."""
        return float(probability(log_odds, self.decoder.temperature, self.decoder.prior))


def replay(decoder, signals, chunk=CHUNK) -> tuple[np.ndarray, np.ndarray]:
    """Replay a subject's epochs, one after the other, in chunks of so many samples.

    From signals as for `Decoder.log_odds` to their log-odds and latencies in s, shape (n,).
    """
    stream = StreamDecoder(decoder)
    n, n_channels, n_times = signals.shape
    for event in np.arange(n) * n_times - stream.buffer.offset:
        stream.mark(event)
    recording = signals.transpose(1, 0, 2).reshape(n_channels, -1)
    log_odds = [log_odds for _, log_odds in _stream(stream, recording, chunk)]
    return np.array(log_odds), np.array(stream.latencies)


def _stream(stream, recording, chunk):
    """What `StreamDecoder.push` gives for a recording, in chunks of so many samples."""
    for first in range(0, recording.shape[1], chunk):
        yield from stream.push(recording[:, first : first + chunk])


class LiveFeedback:
    """A person's `SubjectEpochs` as a stream, decoded by a decoder that never saw this person.

    Policies are trained from a table of p(error), because decoding the same epochs again gives the
    same numbers; this does it all the same, as it would be with somebody wearing the cap.
    """

    def __init__(self, decoder, held_out):
        self._stream = StreamDecoder(decoder)
        self._signals = dict(zip(held_out.index, decoder.input_format.pick(held_out), strict=True))

    def __call__(self, epoch) -> float:
        """Stream the epoch of that number, as in the p(error) table, and decode it."""
        buffer, signal = self._stream.buffer, self._signals[epoch]
        self._stream.mark(buffer.n_received - buffer.offset)
        ((_, log_odds),) = _stream(self._stream, signal, CHUNK)
        return self._stream.p_error(log_odds)
