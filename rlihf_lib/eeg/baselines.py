"""A classical decoder on the same folds, to know what the network is worth."""

import numpy as np
import pandas as pd
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

from rlihf_lib.eeg import scores
from rlihf_lib.eeg.decoding import load_subject
from rlihf_lib.eeg.fitting import DEFAULTS
from rlihf_lib.eeg.signals import InputFormat
from rlihf_lib.eeg.splits import leave_one_subject_out

STEP = 0.05  # s


def lda_loso(load, subjects, settings=DEFAULTS):
    """Shrinkage linear discriminant analysis on 50-ms means, leave-one-subject-out.

    Blankertz, Lemm, Treder, Haufe, Müller (2011), Single-trial analysis and classification of ERP
    components, NeuroImage 56, 814-825.

    Parameters
    ----------
    load, subjects, settings
        As for `decoding.run_loso`; the same window and channels are decoded.

    Returns
    -------
    DataFrame
        Columns subject, auroc_lda.

    Notes
    -----
    Every subject's channels are divided by their standard deviation over all epochs of that
    subject, without labels. That is more than the networks get, which see nothing of the held-out
    subject but the epoch to decode; LDA needs it.
    """
    data = {}
    for subject in subjects:
        epochs = load_subject(load, subject, settings)
        layout = InputFormat.of(epochs, settings.window)
        width = round(STEP * layout.sfreq)
        n_means = (layout.stop - layout.start) // width
        signals = layout.pick(epochs)[..., layout.start : layout.start + n_means * width]
        signals = signals / signals.std(axis=(0, 2), keepdims=True)
        means = signals.reshape(*signals.shape[:2], n_means, width).mean(-1)
        order = np.argsort(epochs.channels)
        data[subject] = means[:, order].reshape(len(means), -1), epochs.labels
    rows = []
    for fold in leave_one_subject_out(subjects):
        pool = fold.training_pool(data)
        x, y = (np.concatenate(parts) for parts in zip(*pool.values(), strict=True))
        lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto").fit(x, y)
        x, y = data[fold.test]
        rows.append((fold.test, scores.auroc(lda.decision_function(x), y)))
    return pd.DataFrame(rows, columns=["subject", "auroc_lda"])
