"""A session in which a simulated person tires, and a decoder that is, or isn't, kept up to date.

Responses shrink and come later from part to part of the session, as in mental fatigue, and as much
later in the end as they may from one task to another (Iturrate, Montesano & Minguez 2013, J. Neural
Eng. 10:026024); else parts are alike, with the same events. Whoever is decoded presses keys now and
then, so that some events of each part have labels: on all of these so far the decoder may be
fine-tuned (`finetuning`), the paper's infrequent online update, at ten times the usual rate.
Amount of the drift, and rate, were settled with s04 and s07: there what had become late was learnt
(AUROC in the last part .77 to .92, and .50 to .54), but 40 events alone made it worse (.97 to .95,
.92 to .81).
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from rlihf_lib.eeg import hri, simulated
from rlihf_lib.eeg.eeglab import read_eeglab
from rlihf_lib.eeg.finetuning import fine_tune
from rlihf_lib.eeg.preprocessing import Preprocessing, cut
from rlihf_lib.eeg.scores import auroc
from rlihf_lib.eeg.signals import SubjectEpochs

PARTS, STATES = 5, ("rested", "tired", "updated")  # of the session; of who is decoded in it
N_LABELLED = 40  # events of each part, others in each
SMALLEST, LATEST = 0.7, 0.1  # at its end: amplitude, relative to the first part's; s added
LEARNING_RATE = 1e-3  # of the update
SETTINGS = N_LABELLED, SMALLEST, LATEST, LEARNING_RATE


def session_table(subject: str, decoder) -> pd.DataFrame:
    """p(error) over a session of a simulated person, by the decoder that never saw them.

    Columns as in the p(error) table, in each of `PARTS` of the events that nobody has labelled in
    any. Subjects are "<subject>_rested", who does not tire; "<subject>_tired", by the decoder as it
    is; "<subject>_updated", by the decoder fine-tuned in every part.
    """
    session = [_epochs(subject, part / (PARTS - 1)) for part in range(PARTS)]
    rested = decoder.input_format.pick(session[0])
    order = np.random.default_rng(0).permutation(len(rested))  # or parts have blocks of their own
    asked = np.sort(order[PARTS * N_LABELLED :])
    always = decoder.p_error(rested[asked])
    rows, seen, labels = [], [], []
    for part, tired in enumerate(session):
        labelled = np.sort(order[part * N_LABELLED : (part + 1) * N_LABELLED])
        signals = decoder.input_format.pick(tired)
        seen.append(signals[labelled])
        labels.append(tired.labels[labelled])
        known = np.concatenate(seen), np.concatenate(labels)
        updated = fine_tune(decoder, *known, learning_rate=LEARNING_RATE)
        answers = always, decoder.p_error(signals[asked]), updated.p_error(signals[asked])
        for state, p in zip(STATES, answers, strict=True):
            epoch = part * (tired.index.max() + 1) + tired.index[asked]
            told = {"epoch": epoch, "label": tired.labels[asked], "p_error": p}
            rows.append(pd.DataFrame({"subject": f"{subject}_{state}", **told}))
    return pd.concat(rows).sort_values(["subject", "epoch"], ignore_index=True)


def aurocs_by_part(table: pd.DataFrame) -> pd.DataFrame:
    """AUROC in each of `PARTS`, columns 1 to `PARTS`, of each subject of a `session_table`."""
    rows = {}
    for subject, own in table.sort_values("epoch").groupby("subject"):
        parts = [own.iloc[part] for part in np.array_split(np.arange(len(own)), PARTS)]
        rows[subject] = {
            n: auroc(part["p_error"], part["label"]) for n, part in enumerate(parts, 1)
        }
    return pd.DataFrame(rows).T


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
