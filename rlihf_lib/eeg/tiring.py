"""A session in which a simulated person tires, and a decoder that is, or isn't, kept up to date.

Responses shrink and come later from part to part of the session, as in mental fatigue. Whoever is
decoded presses keys now and then, so that the first events of each part have labels: on these the
decoder may be fine-tuned (`finetuning`), the paper's infrequent online update.
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from rlihf_lib.eeg import hri, simulated
from rlihf_lib.eeg.eeglab import read_eeglab
from rlihf_lib.eeg.finetuning import fine_tune
from rlihf_lib.eeg.preprocessing import Preprocessing, cut
from rlihf_lib.eeg.signals import SubjectEpochs

PARTS = 5  # of the session
N_LABELLED = 20  # events at the beginning of each part
SMALLEST, LATEST = 0.5, 0.03  # at its end: amplitude, relative to the first part's; s added


def session_table(subject: str, decoder) -> pd.DataFrame:
    """p(error) over a session of a simulated person, by the decoder that never saw them.

    Columns as in the p(error) table, of the events that nobody has labelled, in their order, as
    many in each of `PARTS`. Subjects are "<subject>_rested", who does not tire; "<subject>_tired",
    by the decoder as it is; "<subject>_updated", by the decoder fine-tuned in every part.
    """
    session = [_epochs(subject, part / (PARTS - 1)) for part in range(PARTS)]
    rested = decoder.input_format.pick(session[0])
    n = len(rested) // PARTS
    rows, updated = [], decoder
    for part, tired in enumerate(session):
        labelled = slice(part * n, part * n + N_LABELLED)
        asked = slice(part * n + N_LABELLED, (part + 1) * n)
        signals = decoder.input_format.pick(tired)
        updated = fine_tune(updated, signals[labelled], tired.labels[labelled])
        p_error = {
            "rested": decoder.p_error(rested[asked]),
            "tired": decoder.p_error(signals[asked]),
            "updated": updated.p_error(signals[asked]),
        }
        for state, p in p_error.items():
            told = {"epoch": tired.index[asked], "label": tired.labels[asked], "p_error": p}
            rows.append(pd.DataFrame({"subject": f"{subject}_{state}", **told}))
    return pd.concat(rows).sort_values(["subject", "epoch"], ignore_index=True)


def _epochs(subject, tiredness):
    """The person's epochs in a recording all of which is of a tiredness, 0 to 1."""
    model, settings = simulated.MODEL, Preprocessing(reference="recorded")
    gain, latency, oddness = model.people[subject]
    gain, latency = gain * (1 - (1 - SMALLEST) * tiredness), latency + LATEST * tiredness
    model = replace(model, people={**model.people, subject: (gain, latency, oddness)})
    raw = read_eeglab(simulated.recording(subject, model))
    raw.filter(settings.l_freq, settings.h_freq, picks=["eeg", "eog"], verbose="error")
    events = hri.feedback_events(raw)
    events["sample"] = np.round(events["onset"] * raw.info["sfreq"]).astype(int)
    return SubjectEpochs.from_mne(subject, cut(raw, events, settings))
