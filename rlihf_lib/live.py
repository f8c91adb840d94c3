"""Feedback decoded live: every event's epoch goes through the ring buffer and EEGNet anew.

Policies are trained from a table of p(error), because decoding the same epochs again gives the
same numbers. This module does it all the same, as it would be with somebody wearing the cap, and
so shows that the table hides nothing: the run is the same, bit by bit.
"""

from functools import lru_cache

from rlihf_lib.eeg.streaming import StreamDecoder
from rlihf_lib.rl.training import train_run
from rlihf_lib.study import EEG_SOURCES

CHUNK = 32  # samples an amplifier delivers at a time


class LiveFeedback:
    """One person's held-out epochs as a stream, decoded event by event.

    Parameters
    ----------
    decoder : rlihf_lib.eeg.decoder.Decoder
        One that never saw this person.
    held_out : rlihf_lib.eeg.signals.SubjectEpochs
        Their epochs.
    """

    def __init__(self, decoder, held_out):
        self._stream = StreamDecoder(decoder)
        self._signals = dict(zip(held_out.index, decoder.input_format.pick(held_out), strict=True))

    def __call__(self, epoch):
        """Stream an epoch and decode it; return p(error).

        Parameters
        ----------
        epoch : int
            Its number, as in the column `epoch` of the p(error) table.
        """
        buffer, signal = self._stream.buffer, self._signals[epoch]
        self._stream.mark(buffer.n_received - buffer.offset)
        decoded = []
        for first in range(0, signal.shape[1], CHUNK):
            decoded += self._stream.push(signal[:, first : first + CHUNK])
        ((_, log_odds),) = decoded
        return self._stream.p_error(log_odds)


def train_live(study, config, p_error=None, progress=lambda step: None) -> dict[str, bytes]:
    """Train a run as `rl.training.train_run` does, its feedback decoded live.

    Parameters
    ----------
    study : Study
        Names the recordings and holds the decoders' weights.
    config, p_error, progress
        As for `train_run`; of the table only the epochs' numbers and labels are used.

    Raises
    ------
    FileNotFoundError
        If the subject's decoder has not been trained yet.
    ValueError
        If a channel of a folder of epochs knows the answer (`leaks.refuse_leaks`).
    """
    decode = None
    if config.subject:
        # Imports MNE, so only when asked.
        from rlihf_lib.eeg.decoding import load_decoder, load_subject

        decoder = load_decoder(study.decoder, config.subject)
        load = _loader(study.eeg, study.events, study.drop_channels, tuple(study.subjects()))
        held_out = load_subject(load, config.subject)
        decode = LiveFeedback(decoder, held_out)
    return train_run(config, p_error, progress, decode)


@lru_cache(maxsize=1)
def _loader(eeg, events, drop_channels, subjects):
    """Return the loader of a source, once its channels are known to be honest.

    A process looks at them once and not for every run; the built-in sources' are known.
    """
    from rlihf_lib.eeg.decoding import loader
    from rlihf_lib.eeg.leaks import single_channels

    load = loader(eeg, events, drop_channels)
    if eeg not in EEG_SOURCES:
        single_channels(load, subjects, eeg)
    return load
