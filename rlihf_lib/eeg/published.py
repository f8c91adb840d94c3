"""What is published about ErrP-HRI's cursor scenario, to hold simulated or decoded EEG against.

Waves and accuracy within subjects: Ehrlich & Cheng (2019, see `hri`). Across subjects:
published leave-one-subject-out results on the same recordings (27 channels, 0-0.8 s, 1-10 Hz).
"""

#: Difference wave at Cz, error minus correct: sign, from, to (s).
CZ = ((1, 0.086, 0.199), (-1, 0.199, 0.273), (1, 0.273, 0.375), (-1, 0.375, 0.515))
#: Latency of its largest peak, of either sign: mean and standard deviation between subjects, s.
PEAK_LATENCY = (0.282, 0.040)
#: That peak divided by the standard deviation from trial to trial, 1-10 Hz.
PEAK_OVER_SD = 0.59
#: Accuracy of decoders trained and tested on one subject: mean and SD between subjects.
ACCURACY_WITHIN = (0.906, 0.039)

_SUBJECTS = ("s02", "s03", "s04", "s05", "s06", "s07", "s08", "s09", "s10", "s11", "s13")
_AUROC = (0.82, 0.83, 0.98, 0.78, 0.90, 0.93, 0.90, 0.96, 0.67, 0.86, 0.93)
_BALANCED = (0.73, 0.76, 0.91, 0.69, 0.80, 0.73, 0.79, 0.91, 0.59, 0.72, 0.85)
#: Of EEGNet on each held-out subject; there is none for s12.
AUROC = dict(zip(_SUBJECTS, _AUROC, strict=True))
BALANCED_ACCURACY = dict(zip(_SUBJECTS, _BALANCED, strict=True))
