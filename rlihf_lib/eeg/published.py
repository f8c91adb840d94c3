"""What is published about ErrP-HRI's cursor scenario, to hold simulated or decoded EEG against.

Waves and accuracy within subjects: Ehrlich & Cheng (2019, see `hri`). Across subjects:
published leave-one-subject-out results on the same recordings (27 channels, 0-0.8 s, 1-10 Hz).
"""

from collections.abc import Mapping

import pandas as pd

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

#: What the twelve simulated people were calibrated to: the published value, least and most.
WAVES = {
    "largest peak over trial-to-trial SD at Cz": (PEAK_OVER_SD, 0.5, 0.7),
    "latency of that peak, mean (s)": (PEAK_LATENCY[0], 0.262, 0.302),
    "latency of that peak, SD over people, n - 1 (s)": (PEAK_LATENCY[1], 0.025, 0.055),
    "accuracy within subjects": (ACCURACY_WITHIN[0], 0.87, 0.94),
}
_area, _NONE = pd.Series(AUROC), float("nan")
DECODING = {
    "AUROC, mean over people": (_area.mean(), 0.84, 0.90),
    "AUROC, SD over people, n - 1": (_area.std(), 0.06, 0.11),
    "AUROC, lowest": (_area.min(), 0.65, 0.72),
    "AUROC, highest": (_area.max(), 0.96, 1.0),
    "AUROC, farthest from what is published of a person": (_NONE, 0.0, 0.04),
    "AUROC of s12 (not published) minus the mean": (_NONE, -0.04, 0.04),
    "balanced accuracy, mean over people": (pd.Series(BALANCED_ACCURACY).mean(), 0.74, 0.81),
}


def against(simulated: Mapping[str, float], calibrated: Mapping[str, tuple]) -> pd.DataFrame:
    """Simulated values by measure beside the published ones, and the range they were set to.

    `calibrated` is `WAVES` or `DECODING`, whose measures `simulated` has.
    """
    rows = {measure: (simulated[measure], *told) for measure, told in calibrated.items()}
    columns = ["simulated", "published", "at_least", "at_most"]
    table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
    return table.rename_axis("measure")


def decoding(scores: pd.DataFrame) -> dict[str, float]:
    """Values of `DECODING` of a table with a row per subject, as `loso.run_loso` returns it."""
    table = scores.set_index("subject")
    found = table["auroc"]
    values = [
        found.mean(), found.std(), found.min(), found.max(),
        (found - _area).abs().max(), found["s12"] - found.mean(),
        table["balanced_accuracy"].mean(),
    ]  # fmt: skip
    return dict(zip(DECODING, values, strict=True))


def middles_at_cz(wave: pd.Series) -> list[tuple[float, float, int, float]]:
    """From, to (s), published sign, and the mean of a wave by time (s) in the middle of each `CZ`.

    The middle leaves 20 ms at either end, where one component passes into the next.
    """
    found = []
    for sign, start, stop in CZ:
        middle = (wave.index > start + 0.02) & (wave.index < stop - 0.02)
        found.append((start, stop, sign, float(wave[middle].mean())))
    return found
