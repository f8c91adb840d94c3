"""Policies trained with feedback that is decoded live: of recordings, or of whoever wears the cap.

From recordings it gives the same runs, bit by bit, which shows that the table of p(error), from
which policies are trained otherwise, hides nothing.
"""

from functools import lru_cache

from rlihf_lib.paths import EEG_SOURCES
from rlihf_lib.rl.training import train_run

FEEDBACK = "feedback"  # the marker that asks a person
WAIT = 5.0  # s for an answer
HOLD = 0.05  # s in which nothing new can have been seen: half a step of the robot


def train_live(
    study, config, p_error=None, progress=lambda step, success: None
) -> dict[str, bytes]:
    """Train a run as `rl.training.train_run` does, its feedback decoded live.

    The study names the recordings and holds the decoders' weights; of the table only the epochs'
    numbers and labels are used. A FileNotFoundError says if the subject's decoder has not been
    trained yet, a ValueError if a channel knows the answer (`channels.refuse_leaks`).
    """
    decode = None
    if config.subject:
        # Imports MNE, so only when asked.
        from rlihf_lib.eeg.loso import load_decoder
        from rlihf_lib.eeg.signals import SubjectEpochs
        from rlihf_lib.eeg.streaming import LiveFeedback

        decoder = load_decoder(study.decoder, config.subject)
        cohort = _cohort(study.eeg, tuple(study.subjects()), study.events, study.drop_channels)
        held_out = SubjectEpochs.from_mne(config.subject, cohort[config.subject])
        decode = LiveFeedback(decoder, held_out)
    return train_run(config, p_error, progress, decode)


@lru_cache(maxsize=1)
def _cohort(eeg, *arguments):
    """Epochs of a source, once its channels are known to be honest.

    A process looks at them once and not for every run; the built-in sources' are known.
    """
    from rlihf_lib.eeg.channels import single_channels
    from rlihf_lib.eeg.loso import recorded_cohort

    cohort = recorded_cohort(eeg, *arguments)
    if eeg not in EEG_SOURCES:
        single_channels(cohort, eeg)
    return cohort


class Person:
    """Whoever wears the cap, as the `decode` of `rl.training.train_run`; needs mne-lsl.

    A call sends the marker "feedback" and waits for its p(error), which comes from `python -m
    rlihf_lib live --markers rlihf-markers --events feedback`. Which epoch is asked for doesn't
    count: nobody knows what is seen. A TimeoutError says if no answer comes.
    """

    def __init__(self, out="rlihf-p-error", markers="rlihf-markers"):
        from rlihf_lib.eeg import lsl

        self._lsl, self._out, self._answers = lsl, out, None
        self._last, self._until = 0.0, 0.0
        self._outlet = lsl.StreamOutlet(lsl.StreamInfo(markers, "Markers", 1, 0, "string", markers))

    def __call__(self, epoch) -> float:
        """p(error) of what is seen now; asked again at once, the same answer."""
        if (now := self._lsl.local_clock()) > self._until:
            self._last = self.ask(now)
            self._until = self._lsl.local_clock() + HOLD
        return self._last

    def ask(self, stamp) -> float:
        """p(error) of what was seen at a time of LSL's clock."""
        if self._answers is None:  # what answers listens to the markers, so they come first
            self._answers, _ = self._lsl.connect(self._out)
        self._outlet.push_sample([FEEDBACK], stamp)
        while True:
            values, answered = self._answers.pull_sample(WAIT)
            if answered is None:
                raise TimeoutError(
                    f"no p(error) from {self._out!r} within {WAIT:g} s; is `python -m rlihf_lib "
                    "live` running, and does it hear the amplifier?"
                )
            if abs(answered - stamp) < HOLD:  # not a late one to an earlier question
                return float(values[0])
