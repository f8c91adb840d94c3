"""Policies trained with feedback that is decoded live: the same runs, bit by bit.

It shows that the table of p(error), from which policies are trained otherwise, hides nothing.
"""

from functools import lru_cache

from rlihf_lib.rl.training import train_run
from rlihf_lib.study import EEG_SOURCES


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
