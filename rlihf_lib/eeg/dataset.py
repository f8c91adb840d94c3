"""What an ErrP-HRI recording looks like, and where recordings are kept on this computer.

Source: the documentation that lies beside the recordings of Ehrlich & Cheng (2019),
*A feasibility study for validating robot actions using EEG-based error-related potentials*,
Int. J. Soc. Robotics 11, 271-283, doi:10.1007/s12369-018-0501-8.
"""

import os
from pathlib import Path

import platformdirs

#: Subjects of the study, as its files name them.
SUBJECTS = tuple(f"s{number:02d}" for number in range(2, 14))

#: Channels in the order of the files: 27 EEG and 3 EOG, recorded against the mean of TP9 and TP10.
CHANNELS = tuple(
    "Fp1 Fz F3 F7 EOG1 FC5 FC1 C3 T7 CP5 CP1 Pz P3 P7 O1 EOG3 O2 P4 P8 CP6 CP2 Cz C4 T8 EOG2 "
    "FC6 FC2 F4 F8 Fp2".split()
)
EOG_CHANNELS = ("EOG1", "EOG2", "EOG3")
EEG_CHANNELS = tuple(name for name in CHANNELS if name not in EOG_CHANNELS)

#: Sampling rate of the files, in Hz (recorded at 1000 Hz).
SFREQ = 256.0

#: Event names (two spaces each). A trial runs from one stimulus to the next.
STIMULI = ("S  1", "S  2", "S  3")
RESPONSES = ("R  1", "R  2", "R  3")
FEEDBACKS = ("FB1", "FB2", "FB3")
CORRECT, HUMAN_ERROR, MACHINE_ERROR = "S  4", "S  5", "S  6"
FRAME, BACK, TRIAL_END = "S  7", "S  8", "S  9"

N_BLOCKS, N_TRIALS_PER_BLOCK = 10, 50


def cache_dir():
    """Folder for recordings and epochs, outside the repository.

    Returns
    -------
    Path
        The environment variable ``RLIHF_CACHE`` if it is set, else the user's cache folder
        (``~/.cache/rlihf`` on Linux).
    """
    return Path(os.environ.get("RLIHF_CACHE") or platformdirs.user_cache_dir("rlihf"))


def check_subject(subject, subjects, source):
    """Return `subject` if it is one of `subjects`, else say which there are.

    Raises
    ------
    ValueError
        Naming the subject, the source and the subjects it has.
    """
    if subject not in subjects:
        raise ValueError(
            f"unknown subject {subject!r} in {source}; choose one of {', '.join(subjects)}"
        )
    return subject
