"""Lab Streaming Layer (LSL): EEG and markers of whoever wears the cap in, p(error) out.

`python -m rlihf_lib live` is this module's `main`.
"""

import argparse
from typing import NamedTuple

import numpy as np

from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.streaming import StreamDecoder

try:
    from mne_lsl.lsl import StreamInfo, StreamInlet, StreamOutlet, local_clock, resolve_streams
except ModuleNotFoundError as missing:
    needs = "a live stream needs mne-lsl; install it with: pip install '.[live]'"
    raise ModuleNotFoundError(needs) from missing

OUT = "rlihf-p-error"
WAIT = 5.0  # s to find a stream
POLL = 0.005  # s that samples are waited for at a time
SILENCE = 2.0  # s without a sample after which it is said
JITTER = 0.02  # s that a time stamp may be late before samples count as lost
#: Volts of units as amplifiers name them; MNE writes powers of ten.
UNITS = dict.fromkeys(("volts", "v", "0"), 1.0) | dict.fromkeys(("millivolts", "mv", "-3"), 1e-3)
UNITS |= dict.fromkeys(("microvolts", "microvolt", "uv", "µv", "-6"), 1e-6)


class Answer(NamedTuple):
    """What is known of an event."""

    stamp: float  # when it was, s of LSL's clock
    p_error: float  # the prior, if nothing could be decoded
    log_odds: float  # NaN, if nothing could be decoded
    latency: float  # s from the event to the answer
    flaw: str  # why nothing could be decoded, or ""


class LiveDecoder:
    """Decode the events of an LSL stream of EEG, and send p(error) out as another stream.

    That stream, `out`, has a sample for each event, with the event's time stamp: p_error and
    log_odds, which is NaN where nothing could be decoded (`streaming.StreamDecoder`).

    Parameters
    ----------
    decoder : Decoder
        Of `loso.train_decoder`; one without a `band` takes the stream for preprocessed.
    stream : str
        Name of the EEG's stream, which has the decoder's channels, by name, and sampling rate.
    events : sequence of str
        What to decode: words of the stream `markers`, or numbers of the channel `trigger`.
    markers : str
        Name of a stream of words; each belongs to the sample with the nearest time stamp.
    trigger : str
        Instead, a channel of the EEG's stream; an event is the very sample that changes to a code.
    delay : float
        Seconds by which the EEG's time stamps are later than the markers'.
    out : str
    say : callable
        Gets in words what the experimenter should know.

    Raises
    ------
    ValueError
        If a stream is not there, or lacks a channel, or has another rate or another unit than volt.
    """

    def __init__(
        self, decoder, stream, events, markers="", trigger="", delay=0.0, out=OUT, say=print
    ):
        self._inlet, info = connect(stream)
        layout, names = decoder.input_format, tuple(map(str, info.get_channel_names() or ()))
        if info.sfreq != layout.sfreq:
            raise ValueError(
                f"the LSL stream {stream!r} has {info.sfreq:g} Hz, the decoder {layout.sfreq:g} "
                "Hz; set the amplifier to that, or train a decoder at the amplifier's rate"
            )
        self.rate, self._name, self._delay, self._say = layout.sfreq, stream, delay, say
        self.stream = StreamDecoder(decoder, names, live=True)
        self._volts = _volts(info.get_channel_units() or [""] * len(names), names, layout, say)
        self._events, self._markers, self._codes = tuple(events), None, None
        if not trigger:
            self._markers, told = connect(markers)
            if told.dtype != "string":
                raise ValueError(f"the LSL stream {markers!r} has no words; markers are strings")
        elif names.count(trigger) != 1 or not all(event.lstrip("-").isdigit() for event in events):
            raise ValueError(
                f"events {', '.join(events)} of the channel {trigger!r}: they are numbers, and the "
                f"LSL stream {stream!r} has the channels {', '.join(names)}"
            )
        else:
            self._trigger, self._codes = names.index(trigger), [float(code) for code in events]
        self._code, self._heard, self._stamps = np.nan, local_clock(), np.empty(0)
        self._waiting: list[float] = []  # stamps of markers whose sample hasn't come
        self._asked: dict[int, float] = {}  # stamps of events by their sample
        self._answers: list[Answer] = []
        description = StreamInfo(out, "p(error)", 2, 0, "float64", out)
        description.set_channel_names(["p_error", "log_odds"])
        self._outlet = StreamOutlet(description)

    def poll(self, timeout=POLL) -> list[Answer]:
        """Take in what comes within `timeout` s, and answer the events whose window is full."""
        samples, stamps = self._inlet.pull_chunk(timeout)
        if self._markers:
            pairs = zip(*self._markers.pull_chunk(0.0), strict=True)
            self._waiting += [stamp for (word, *_), stamp in pairs if word in self._events]
        if len(stamps):
            self._heard = local_clock()
            self._take(samples, stamps)
        elif local_clock() - self._heard > SILENCE:
            self._heard = np.inf
            self._say(f"no sample from {self._name!r} for {SILENCE:g} s; is the amplifier on?")
        if len(self._stamps):
            for stamp in [t for t in self._waiting if t + self._delay <= self._stamps[-1]]:
                self._waiting.remove(stamp)
                self._mark(self._sample_at(stamp + self._delay), stamp)
            self._push(np.empty((0, len(self._volts))), np.empty(0))
        answers, self._answers = self._answers, []
        return answers

    def _take(self, samples, stamps):
        """Push samples, NaN in the place of those that were lost."""
        previous = self._stamps[-1] if len(self._stamps) else stamps[0] - 1 / self.rate
        steps, first = np.diff(stamps, prepend=previous), 0
        for gap in np.flatnonzero(steps > 1 / self.rate + JITTER):
            self._push(samples[first:gap], stamps[first:gap])
            n = round(steps[gap] * self.rate) - 1
            self._say(f"{n} samples lost ({1000 * n / self.rate:.0f} ms)")
            n = min(n, self.stream.buffer.capacity)
            nothing = np.full((n, samples.shape[1]), np.nan)
            self._push(nothing, stamps[gap] - np.arange(n, 0, -1) / self.rate)
            first = gap
        self._push(samples[first:], stamps[first:])

    def _push(self, samples, stamps):
        """Push samples (n, n_channels), mark events among them, and answer those that are full."""
        buffer = self.stream.buffer
        self._stamps = np.append(self._stamps, stamps)[-buffer.capacity :]
        if self._codes is not None:
            codes = np.nan_to_num(samples[:, self._trigger].astype(float), nan=self._code)
            codes = np.append(self._code, codes)
            # Of the very first sample nobody knows whether the value is new.
            for i in np.flatnonzero((abs(np.diff(codes)) > 0) & np.isin(codes[1:], self._codes)):
                self._mark(buffer.n_received + int(i), stamps[i])
            self._code = codes[-1]
        for sample, log_odds in self.stream.push((samples * self._volts).T):
            flaw = self.stream.flaws.pop(sample, "")
            self._answer(self._asked.pop(sample), log_odds, flaw)

    def _sample_at(self, stamp):
        """Number of the sample that was nearest to a time."""
        oldest = self.stream.buffer.n_received - len(self._stamps)
        if stamp < self._stamps[0]:
            return oldest + round((stamp - self._stamps[0]) * self.rate)
        return oldest + int(np.abs(self._stamps - stamp).argmin())

    def _mark(self, sample, stamp):
        if sample not in self._asked:
            try:
                self.stream.mark(sample)
                self._asked[sample] = stamp
            except ValueError as late:
                self._answer(stamp, np.nan, str(late))

    def _answer(self, stamp, log_odds, flaw):
        p_error = self.stream.p_error(log_odds)
        self._outlet.push_sample(np.array([p_error, log_odds]), stamp)
        self._answers.append(Answer(stamp, p_error, log_odds, local_clock() - stamp, flaw))


def connect(name) -> tuple[StreamInlet, StreamInfo]:
    """Open the LSL stream of that name, else a ValueError; its inlet and its description."""
    found = resolve_streams(WAIT, name=name)
    if not found:
        there = ", ".join(sorted(info.name for info in resolve_streams())) or "none"
        raise ValueError(f"no LSL stream {name!r} within {WAIT:g} s; there are: {there}")
    inlet = StreamInlet(found[0], processing_flags=["clocksync"])
    try:
        inlet.open_stream(WAIT)
        inlet.time_correction(WAIT)  # half a second, for which else the first pull would wait
        return inlet, inlet.get_sinfo(WAIT)
    except TimeoutError as late:
        message = f"the LSL stream {name!r} is announced but can't be opened; by a firewall?"
        raise ValueError(message) from late


def _volts(units, names, layout, say):
    """Volts that 1 means in each channel; those that are not decoded may have any unit."""
    units = [str(unit).lower() for unit in units]
    told = {units[names.index(name)] for name in layout.channels}
    if told <= {"", "none"}:
        say("the stream doesn't tell its units; taken for microvolts")
        units = ["microvolts"] * len(units)
    elif unknown := told - UNITS.keys():
        raise ValueError(
            f"the stream's channels are in {', '.join(sorted(unknown))}; let the amplifier's "
            "software tell volts, millivolts or microvolts"
        )
    return np.array([UNITS.get(unit, 1.0) for unit in units])


def main(argv=None) -> int:
    """Run the command line until ctrl-C; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m rlihf_lib live",
        description="Decode a live LSL stream: EEG and markers in, p(error) out.",
    )
    add, either = parser.add_argument, parser.add_mutually_exclusive_group(required=True)
    add("--decoder", required=True, metavar="FILE",
        help="decoder for live use, saved by loso.train_decoder(...).save")  # fmt: skip
    add("--stream", required=True, metavar="NAME", help="stream of the EEG")
    either.add_argument("--markers", default="", metavar="NAME", help="stream of the markers")
    either.add_argument("--trigger", default="", metavar="CH", help="or channel of the triggers")
    add("--events", required=True, nargs="+", metavar="NAME",
        help="markers (or numbers of the trigger channel) that are feedback")  # fmt: skip
    add("--delay", type=float, default=0.0, metavar="S",
        help="by which the EEG's time stamps are later than the markers'")  # fmt: skip
    add("--out", default=OUT, metavar="NAME", help=f"stream of p(error) (default {OUT})")
    add("--debug", action="store_true", help="where in the program an error comes from, too")
    options = parser.parse_args(argv)
    count = 0
    try:
        decoder = Decoder.load(options.decoder)
        if decoder.band is None:
            raise ValueError(
                f"{options.decoder} was trained on epochs filtered forward and backward, which no "
                "live stream can be; train one with loso.recorded_cohort(..., phase='minimum')"
            )
        told = options.markers, options.trigger, options.delay, options.out, _say
        live = LiveDecoder(decoder, options.stream, options.events, *told)
        buffer = live.stream.buffer
        _say(f"listening to {options.stream!r}; p(error) of {', '.join(options.events)} comes "
             f"{(buffer.offset + buffer.n_times) / live.rate:.2f} s after it, as {options.out!r}; "
             "ctrl-C ends")  # fmt: skip
        while True:
            for answer in live.poll():
                count += 1
                said = answer.flaw and f" (the prior: {answer.flaw})"
                _say(f"p(error) {answer.p_error:.3f} after {answer.latency:.3f} s{said}")
    except KeyboardInterrupt:
        _say(f"\n{count} events answered")
        return 0


def _say(text):
    print(text, flush=True)
