"""Samples in, time-aligned epochs out, p(error) out: replay today, a live amplifier tomorrow."""

import time

import numpy as np

from rlihf_lib.eeg.calibration import probability


class RingBuffer:
    """The latest samples of a stream, and the windows events ask for.

    Parameters
    ----------
    n_channels : int
    n_times : int
        Samples of a window.
    offset : int
        First sample of a window relative to its event.
    n_windows : int
        Capacity in windows; how late after its window's last sample an event may be marked.
    """

    def __init__(self, n_channels, n_times, offset=0, n_windows=4):
        self.n_times = n_times
        self.offset = offset
        self.n_received = 0
        self._pending = []
        self._samples = np.zeros((n_channels, n_windows * n_times))

    def mark(self, sample):
        """Ask for the window of an event.

        Parameters
        ----------
        sample : int
            When it happened, counted from the first sample of the stream; may lie in the future.

        Raises
        ------
        ValueError
            If the window starts before the stream or has been overwritten already.
        """
        start = int(sample) + self.offset
        oldest = max(0, self.n_received - self._samples.shape[1])
        if start < oldest:
            raise ValueError(
                f"the window of the event at sample {sample} starts at {start}, but the buffer "
                f"reaches back to {oldest} only; mark events earlier or buffer more windows"
            )
        self._pending.append(int(sample))

    def push(self, chunk):
        """Append samples.

        Parameters
        ----------
        chunk : ndarray, shape (n_channels, n)
            Any n.

        Yields
        ------
        sample : int
            An event whose window is complete.
        window : ndarray, shape (n_channels, n_times)
            A copy.

        Raises
        ------
        ValueError
            If the number of channels is wrong.
        """
        chunk = np.asarray(chunk)
        if chunk.ndim != 2 or len(chunk) != len(self._samples):
            raise ValueError(
                f"a chunk of shape {chunk.shape}; expected ({len(self._samples)} channels, n)"
            )
        capacity = self._samples.shape[1]
        # Piecewise, so that a chunk longer than the buffer overwrites nothing still needed.
        for first in range(0, chunk.shape[1], self.n_times):
            piece = chunk[:, first : first + self.n_times]
            where = (self.n_received + np.arange(piece.shape[1])) % capacity
            self._samples[:, where] = piece
            self.n_received += piece.shape[1]
            yield from self._complete()
        if chunk.shape[1] == 0:
            yield from self._complete()

    def _complete(self):
        for sample in sorted(self._pending):
            start = sample + self.offset
            if start + self.n_times <= self.n_received:
                self._pending.remove(sample)
                where = np.arange(start, start + self.n_times) % self._samples.shape[1]
                yield sample, self._samples[:, where]


class StreamDecoder:
    """Decode the events of a preprocessed stream as their epochs are complete.

    Parameters
    ----------
    decoder : decoder.Decoder
    channels : sequence of str, optional
        Channels of the stream; those of the decoder are picked by name. Default: the decoder's.

    Raises
    ------
    ValueError
        If the stream lacks a channel.
    """

    def __init__(self, decoder, channels=None):
        self.decoder = decoder
        layout = decoder.input_format
        channels = tuple(channels or layout.channels)
        missing = [name for name in layout.channels if name not in channels]
        if missing:
            raise ValueError(f"the stream lacks the channel(s) {', '.join(missing)}")
        self._picks = [channels.index(name) for name in layout.channels]
        self.buffer = RingBuffer(
            len(self._picks), layout.n_times, offset=round(layout.tmin * layout.sfreq)
        )
        self.latencies = []
        """Seconds from having an epoch's last sample to having its p(error), per event."""

    def mark(self, sample):
        """Announce a feedback event; see `RingBuffer.mark`."""
        self.buffer.mark(sample)

    def push(self, chunk):
        """Append samples and decode what is complete.

        Parameters
        ----------
        chunk : ndarray, shape (n_channels, n)
            Volts.

        Returns
        -------
        list of (int, float)
            Events (their samples) and their log-odds of error, before temperature.

        Raises
        ------
        ValueError
            On a wrong number of channels, or NaN within an epoch.
        """
        decoded = []
        for sample, window in self.buffer.push(np.asarray(chunk)[self._picks]):
            start = time.perf_counter()
            decoded.append((sample, float(self.decoder.log_odds(window[None])[0])))
            self.latencies.append(time.perf_counter() - start)
        return decoded

    def p_error(self, log_odds):
        """Return calibrated p(error) of a decoded event."""
        return float(probability(log_odds, self.decoder.temperature, self.decoder.prior))


def replay(decoder, signals, chunk=32):
    """Replay a subject's epochs, one after the other, through the ring buffer.

    Parameters
    ----------
    decoder : decoder.Decoder
    signals : ndarray, shape (n, n_channels, n_times)
        In the decoder's channel order, volts.
    chunk : int
        Samples per chunk, as an amplifier would deliver them.

    Returns
    -------
    log_odds : ndarray, shape (n,)
    latencies : ndarray, shape (n,)
        Seconds.
    """
    layout = decoder.input_format
    stream = StreamDecoder(decoder)
    offset = stream.buffer.offset
    for position in range(len(signals)):
        stream.mark(position * layout.n_times - offset)
    decoded = {}
    carried = np.empty((len(layout.channels), 0))
    for epoch in signals:
        carried = np.concatenate([carried, epoch], axis=1)
        while carried.shape[1] >= chunk:
            decoded.update(stream.push(carried[:, :chunk]))
            carried = carried[:, chunk:]
    decoded.update(stream.push(carried))
    log_odds = np.array([decoded[i * layout.n_times - offset] for i in range(len(signals))])
    return log_odds, np.array(stream.latencies)
